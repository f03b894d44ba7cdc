"""``anm-mj localise``: where images were taken, in the map of a finished run."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from anm_mj.cli.command_line import Option
from anm_mj.cli.map import Metres, lens_distortion, topics_by_role
from anm_mj.cli.option_types import Count, NewFolder, Settings, require_read, run_fields

NOTHING_FOUND = 1
"""Exit status where no image was found in the map."""
_LEVEL_M = 1.0
"""Height of images that nobody knows yet [m]; the search has heights of its own."""


def localise(
    run: Path,
    images: Path,
    *,
    out: NewFolder | None = None,
    single: bool = False,
    reference: Path | None = None,
    layout: str | None = None,
    camera: Annotated[tuple[float, float, float, float] | None, Option("FX,FY,CX,CY")] = None,
    depth_unit: Metres | None = None,
    distortion: Annotated[str | None, Option("[MODEL,]K1,K2,...")] = None,
    topics: Annotated[Sequence[str], Option("--topic ROLE=NAME")] = (),
    every: Count = 1,
    settings: Settings = (),
    **options: Annotated[Any, run_fields("seed", "device")],
) -> int:
    """Find where RGB-D images were taken, in the map of a finished run.

    Poses of the images are not used. The first is looked for in the whole map, the others are tracked. The map stays
    as it is. Exit status 1 if no image was found.

    Args:
        run: folder of a run, of anm-mj explore or anm-mj map
        images: a recorded sequence in any layout that anm-mj map reads
        out: folder for the poses, poses.tum and poses.json; by default they are only counted
        single: look for each image on its own: they do not follow one another
        reference: poses in TUM format, in the world of the map, that the found ones are compared with
        layout: name of the layout, as in docs/results.md; by default recognised by its files
        camera: intrinsics [px], if the files are wrong or silent
        depth_unit: metres per unit of a depth image
        distortion: of the lens in the order of OpenCV, as fisheye,K1,K2,K3,K4, or none; by default as the files say
        topics: topic of a bag for colour, depth or camera, where several fit; may be repeated
        every: read every Nth image only
        settings: any setting of localisation, as in localisation.relocalisation.least_score=0.8; may be repeated
        **options: fields of ``RunConfig``
    """
    from anm_mj.cli.console import PlainConsole, progress_bar
    from anm_mj.config import DEFAULT_PRESET, make_config
    from anm_mj.evaluation.trajectory_error import read_reference
    from anm_mj.io.sequence import ranges_text
    from anm_mj.io.sequence_layouts import SequenceOptions, open_sequence
    from anm_mj.localise_images import localise_images, pose_error, require_new, why_not_found, write_poses

    config = make_config(DEFAULT_PRESET, list(settings), scene=str(images), pose="slam", **options)
    require_read(settings, "localisation")
    measured = None if reference is None else read_reference(reference)
    if out is not None:
        require_new(out)
    wanted = SequenceOptions(
        layout,
        camera,
        depth_unit,
        up="-y",
        floor_m=-_LEVEL_M,
        every=every,
        topics=topics_by_role(topics),
        needs_poses=False,
        ignores_poses=True,
        distortion=lens_distortion(distortion),
    )
    sequence, _ = open_sequence(images, wanted)
    console = PlainConsole()
    with progress_bar(console, "localise") as on_progress:
        poses = localise_images(run, sequence, config, single=single, on_image=on_progress)
    error = None if measured is None else pose_error(poses, measured)
    found = [pose for pose in poses if pose.T_world_camera is not None]
    console.say(f"{len(found)} of {len(poses)} images found.")
    for reason, steps in why_not_found(poses).items():
        console.say(f"Not found: {ranges_text(steps)} ({reason}).")
    deviations = [(pose.deviation_m, pose.deviation_rad) for pose in found]
    if deviations:
        most_m, most_rad = (max(values) for values in zip(*deviations, strict=True))
        console.say(f"Standard deviation at most {100.0 * most_m:.1f} cm and {math.degrees(most_rad):.2f} deg.")
    if error is not None:
        console.say(
            f"Position RMSE {error.position_rmse_cm:.2f} cm, ATE RMSE {error.ate_rmse_cm:.2f} cm after alignment, "
            f"by {reference}."
        )
    elif measured is not None:
        console.say(f"{reference} has fewer than 3 poses at the times of the images that were found.")
    if out is not None:
        write_poses(out, run, images, poses, error)
        console.say(f"Poses: {out}")
    return 0 if found else NOTHING_FOUND
