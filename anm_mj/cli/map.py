"""``anm-mj map``: a recorded RGB-D sequence becomes a run folder."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from anm_mj.cli.command_line import Option, Report
from anm_mj.cli.option_types import Count, NewFolder, Port, Settings, refuse_idle, run_fields
from anm_mj.errors import ConfigError, RunFolderError
from anm_mj.utils.own_modules import let_import_from

if TYPE_CHECKING:
    from anm_mj.geometry.lens_distortion import LensDistortion

_PRIOR = "The sequence's poses are a prior of the motion between frames; localisation in the map corrects them."
_UNPOSED = (
    "The poses are found by localisation in the map; the first camera defines the world: {} (--up), and the floor is "
    "the lowest level that its depth shows (--floor)."
)
TALLEST_M = 100.0
"""No robot is higher [m]."""


Metres = Annotated[float, Option("M")]
Seconds = Annotated[float, Option("S")]


def map_recorded(
    sequence: Path,
    *,
    out: NewFolder | None = None,
    layout: str | None = None,
    camera: Annotated[tuple[float, float, float, float] | None, Option("FX,FY,CX,CY")] = None,
    depth_unit: Metres | None = None,
    distortion: Annotated[str | None, Option("[MODEL,]K1,K2,...")] = None,
    up: str | None = None,
    floor: Metres | None = None,
    topics: Annotated[Sequence[str], Option("--topic ROLE=NAME")] = (),
    poses: str = "camera-to-world",
    axes: str = "RDF",
    pose_scale: float = 1.0,
    ray_depth: bool = False,
    mirrored: bool = False,
    time_offset: Seconds = 0.0,
    colour_offset: Seconds = 0.0,
    fix: bool = False,
    match: Seconds = 0.02,
    max_gap: Seconds = 0.5,
    max_bad: float = 0.2,
    every: Count = 1,
    track: bool = False,
    reference: Path | None = None,
    resume: Annotated[Path | None, Option("RUN")] = None,
    shadow: bool = False,
    radius: Metres = 0.18,
    height: Metres = 1.35,
    keep_images: bool = False,
    view: bool = False,
    port: Port | None = None,
    settings: Settings = (),
    **options: Annotated[Any, run_fields("policy", "preset", "seed", "device")],
) -> Report:
    """Map a recorded RGB-D sequence, and write a run folder.

    Layouts: TUM RGB-D, ETH3D, ICL-NUIM, nerfstudio's transforms.json with depth, Replica as NICE-SLAM and Co-SLAM read
    it, 7-Scenes, ScanNet's export, ARKitScenes, Open3D's, those of Stray Scanner, Polycam and Record3D, our own, a run
    folder with images, and ROS bags (1 and 2, MCAP). See docs/results.md, and docs/localisation.md for --track.

    Args:
        sequence: folder of the sequence, a transforms.json, or a bag
        out: run folder; by default a new one in runs/
        layout: name of the layout, as in docs/results.md; by default recognised by its files
        camera: intrinsics [px], if the files are wrong or silent
        depth_unit: metres per unit of a depth image
        distortion: of the lens in the order of OpenCV, as fisheye,K1,K2,K3,K4, or none; by default as the files say
        up: axis of the world that points up: z, -z, y, -y; without poses also floor; by default the layout's, or -y
        floor: height of the floor along it; by default found from the depth
        topics: topic of a bag for colour, depth, camera or pose (a topic or tf), where several fit; may be repeated
        poses: what a pose is: camera-to-world, world-to-camera, conjugate, scalar-first or scalar-first-inverse
        axes: where x, y, z of the camera point: RDF (right, down, forward; OpenCV), RUB (OpenGL), FLU (ROS) or others
        pose_scale: metres per unit of the positions
        ray_depth: depth is the distance along the ray, not planar
        mirrored: the images are mirrored left to right
        time_offset: added to the times of images to find their poses
        colour_offset: added to the times of colour images to find their depth
        fix: apply what the check of the sequence finds
        match: colour and depth with times of their own belong together up to this difference
        max_gap: poses with times of their own, or of the reference, are interpolated between two no farther apart
        max_bad: largest share of frames that may be left out because they cannot be used
        every: read every Nth frame only
        track: find the poses by localisation in the map; those of the sequence, if any, are a prior
        reference: poses in TUM format that the found ones are compared with; a sequence's own are no prior then
        resume: go on with a run of the same command that was killed, interrupted or ended in an error, from its folder
        shadow: record at each frame where the policy would have gone (plans.jsonl)
        radius: radius of the robot
        height: height of the robot
        keep_images: keep the colour images at full size (record.images=full)
        view: show the mapping in the browser, on this machine only
        port: port of --view; by default the next free one from 7000
        settings: any setting of config.json; may be repeated
        **options: fields of ``RunConfig``
    """
    from anm_mj.cli.console import PlainConsole, progress_bar
    from anm_mj.cli.progress import FrameLine, Interrupt, live_view
    from anm_mj.cli.run_summary import print_fit, print_folder, print_tracking
    from anm_mj.config import DEFAULT_PRESET, make_config
    from anm_mj.evaluation.trajectory_error import read_reference
    from anm_mj.io.read_run import read_json
    from anm_mj.io.sequence_layouts import SequenceOptions, open_sequence
    from anm_mj.map_sequence import map_sequence
    from anm_mj.sequence_check.correction import Correction
    from anm_mj.sequence_check.warn_and_fix import BeforeMapping
    from anm_mj.types import Footprint

    let_import_from([os.getcwd()])
    if not 0.0 < radius < height <= TALLEST_M:
        raise ConfigError(f"A robot of radius {radius:g} m and height {height:g} m makes no sense here.")
    if not view:
        refuse_idle({"--port": port}, "nothing is shown; add --view")
    if resume is not None and out is not None:
        raise ConfigError(f"--resume goes on in {resume}; leave out --out.")
    by_role = topics_by_role(topics)
    if reference is not None and not track:
        raise ConfigError("--reference is for poses that --track finds; give both, or none.")
    measured = None if reference is None else read_reference(reference, max_gap)
    # A camera that is held before a desk sees all of it again and again: closing loops brought nothing there.
    usual = [*["record.images=full"] * keep_images, *["localisation.graph.loops=false"] * track]
    settings = [*usual, *settings]
    config = make_config(options.pop("preset", DEFAULT_PRESET), settings, scene=str(sequence), **options)
    wanted = SequenceOptions(layout, camera, depth_unit, up, floor, every, by_role)
    wanted = replace(wanted, match_s=match, max_gap_s=max_gap, max_bad=max_bad, distortion=lens_distortion(distortion))
    if track:
        config = replace(config, pose="slam")
        judged = reference is not None and is_of_sequence(reference, sequence)
        wanted = replace(wanted, needs_poses=False, ignores_poses=judged)
    given = Correction(
        poses,
        axes,
        pose_scale,
        ray_depth=ray_depth,
        mirrored=mirrored,
        time_offset_s=time_offset,
        colour_offset_s=colour_offset,
    )
    judged_before = BeforeMapping(given, fix=fix, keeps_up=up is not None)
    frames, layout = open_sequence(sequence, replace(wanted, judge=judged_before))
    console = PlainConsole()
    if frames.distortion is not None:
        console.say(f"Lens distortion is taken out, {frames.distortion.source}: {frames.distortion}.")
    if track:
        held = "up is as its floor says" if up == "floor" else f"its {up or '-y'} axis points up"
        console.say(_PRIOR if frames.has_poses else _UNPOSED.format(held))
    height_m = frames.frames[0].T_world_camera[2, 3]
    console.say(f"{len(frames)} frames, layout {layout}; the first camera is {height_m:.2f} m above the floor.")
    footprint = Footprint(radius, 0.05, height)
    title = f"{sequence.resolve().name}, recorded" if view else None
    with (
        Interrupt(console) as interrupt,
        live_view(title, port, interrupt) as views,
        progress_bar(console, "map") as on_progress,
    ):
        folder = map_sequence(
            frames,
            config,
            footprint,
            out=out,
            shadow=shadow,
            reference=measured,
            verdict=judged_before.verdict,
            corrections=judged_before.applied,
            observers=[FrameLine(console, on_progress), interrupt, *views],
            resume=resume,
        )
    metrics = read_json(folder.metrics)
    print_fit(console, metrics)
    if track:
        print_tracking(console, metrics)
    print_folder(console, folder.path)
    if not folder.mesh.is_file():
        raise RunFolderError(
            f"{sequence} shows no surface that the map could hold: check the unit of depth (--depth-unit), the poses "
            "and the camera."
        )
    return Report({"folder": folder.path, **metrics})


def is_of_sequence(reference: Path, sequence: Path) -> bool:
    """Whether a reference lies in the folder of a sequence, which may be given as a file in it."""
    folder = sequence if sequence.is_dir() else sequence.parent
    return reference.resolve().is_relative_to(folder.resolve())


def topics_by_role(topics: Sequence[str]) -> dict[str, str]:
    """What ``--topic`` says; raises ConfigError."""
    for topic in topics:
        if "=" not in topic:
            raise ConfigError(f"--topic is '{topic}'; give ROLE=NAME, as in colour=/camera/color/image_raw.")
    return dict(topic.split("=", 1) for topic in topics)


def lens_distortion(words: str | None) -> LensDistortion | Literal["files"] | None:
    """What ``--distortion`` says, ``files`` where it is not given; raises ConfigError."""
    from anm_mj.geometry.lens_distortion import LensDistortion

    if words is None or words == "none":
        return None if words else "files"
    try:
        return LensDistortion.read(words)
    except ValueError as err:
        raise ConfigError(
            f"--distortion is '{words}' ({err}); give none, K1,K2,P1,P2,K3 and so on (12 numbers at most), or "
            "fisheye,K1,K2,K3,K4."
        ) from err
