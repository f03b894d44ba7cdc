"""``anm-mj map``: a recorded RGB-D sequence becomes a run folder."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from anm_mj.cli.command_line import Fields, Option
from anm_mj.cli.option_types import Count, NewFolder, Settings
from anm_mj.errors import ConfigError

TALLEST_M = 100.0
"""No robot is higher [m]."""


def _map_fields() -> tuple[type, Mapping[str, Option]]:
    from anm_mj.config import OPTIONS, RunConfig

    return RunConfig, {field: Option(OPTIONS[field]) for field in ("policy", "preset", "seed", "device")}


Metres = Annotated[float, Option("M")]


def map_recorded(
    sequence: Path,
    *,
    out: NewFolder | None = None,
    layout: str | None = None,
    camera: Annotated[tuple[float, float, float, float] | None, Option("FX,FY,CX,CY")] = None,
    depth_unit: Metres | None = None,
    up: str = "z",
    floor: Metres | None = None,
    topics: Annotated[Sequence[str], Option("--topic ROLE=NAME")] = (),
    every: Count = 1,
    shadow: bool = False,
    radius: Metres = 0.18,
    height: Metres = 1.35,
    keep_images: bool = False,
    settings: Settings = (),
    **options: Annotated[Any, Fields(_map_fields)],
) -> int:
    """Map a recorded RGB-D sequence with poses, and write a run folder.

    Layouts: TUM RGB-D, nerfstudio's transforms.json with depth, Replica as NICE-SLAM and Co-SLAM read it, our own, a
    run folder with images, and ROS bags (1 and 2, MCAP). See docs/results.md.

    Args:
        sequence: folder of the sequence, a transforms.json, or a bag
        out: run folder; by default a new one in runs/
        layout: run, anm-mj, tum, nerfstudio, replica or rosbag; by default recognised by its files
        camera: intrinsics [px], if the files are wrong or silent
        depth_unit: metres per unit of a depth image
        up: axis of the sequence's world that points up: z, -z, y, -y
        floor: height of the floor; by default found from the depth
        topics: topic of a bag for colour, depth, camera or pose (a topic or tf), where several fit; may be repeated
        every: read every Nth frame only
        shadow: record at each frame where the policy would have gone (plans.jsonl)
        radius: radius of the robot
        height: height of the robot
        keep_images: keep the colour images at full size (record.images=full)
        settings: any setting of config.json; may be repeated
        **options: fields of ``RunConfig``
    """
    from anm_mj.cli.bar import progress_bar
    from anm_mj.cli.console import PlainConsole
    from anm_mj.cli.progress import FrameLine, Interrupt
    from anm_mj.cli.run_summary import print_folder
    from anm_mj.config import DEFAULT_PRESET, make_config
    from anm_mj.io.sequence_layouts import SequenceOptions, open_sequence
    from anm_mj.map_sequence import map_sequence
    from anm_mj.types import Footprint

    # As with python -m, the modules of the working directory can be imported: a policy of the user's own.
    sys.path.insert(0, os.getcwd())
    if not 0.0 < radius < height <= TALLEST_M:
        raise ConfigError(f"A robot of radius {radius:g} m and height {height:g} m makes no sense here.")
    for topic in topics:
        if "=" not in topic:
            raise ConfigError(f"--topic is '{topic}'; give ROLE=NAME, as in colour=/camera/color/image_raw.")
    by_role = dict(topic.split("=", 1) for topic in topics)
    settings = [*["record.images=full"] * keep_images, *settings]
    config = make_config(options.pop("preset", DEFAULT_PRESET), settings, scene=str(sequence), **options)
    frames, layout = open_sequence(sequence, SequenceOptions(layout, camera, depth_unit, up, floor, every, by_role))
    console = PlainConsole()
    height_m = frames.frames[0].T_world_camera[2, 3]
    console.say(f"{len(frames)} frames, layout {layout}; the first camera is {height_m:.2f} m above the floor.")
    footprint = Footprint(radius, 0.05, height)
    with Interrupt(console) as interrupt, progress_bar(console, "map") as on_progress:
        observers = (FrameLine(console, on_progress), interrupt)
        folder = map_sequence(frames, config, footprint, out=out, shadow=shadow, observers=observers)
    print_folder(console, folder.path)
    return 0
