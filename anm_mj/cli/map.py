"""``anm-mj map``: a recorded RGB-D sequence becomes a run folder."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import Any

from anm_mj.cli.option_types import place
from anm_mj.planning.policies.registry import DEFAULT_POLICY

TALLEST_M = 100.0
"""No robot is higher [m]."""


def add_map(commands: Any) -> None:
    """Add ``map`` to the commands of the program."""
    parser = commands.add_parser(
        "map",
        help="map a recorded RGB-D sequence with poses, and write a run folder",
        epilog="layouts: TUM RGB-D, nerfstudio's transforms.json with depth, Replica as NICE-SLAM and Co-SLAM read it, "
        "our own, a run folder with images, and ROS bags (1 and 2, MCAP). See docs/results.md.",
    )
    parser.add_argument(
        "sequence", type=Path, metavar="SEQUENCE", help="folder of the sequence, a transforms.json, or a bag"
    )
    parser.add_argument("--out", type=place, metavar="DIR", help="run folder (default: a new one in runs/)")
    parser.add_argument(
        "--layout", help="run, anm-mj, tum, nerfstudio, replica or rosbag (default: recognised by its files)"
    )
    parser.add_argument("--camera", metavar="FX,FY,CX,CY", help="intrinsics [px], if the files are wrong or silent")
    parser.add_argument("--depth-unit", type=float, metavar="M", help="metres per unit of a depth image")
    parser.add_argument(
        "--up", default="z", help="axis of the sequence's world that points up: z, -z, y, -y (default: z)"
    )
    parser.add_argument("--floor", type=float, metavar="M", help="height of the floor (default: found from the depth)")
    parser.add_argument(
        "--topic",
        action="append",
        default=[],
        dest="topics",
        metavar="ROLE=NAME",
        help="topic of a bag for colour, depth, camera or pose (a topic or tf), where several fit; may be repeated",
    )
    parser.add_argument("--every", type=int, default=1, metavar="N", help="read every Nth frame only (default: 1)")
    parser.add_argument(
        "--shadow", action="store_true", help="record at each frame where the policy would have gone (plans.jsonl)"
    )
    parser.add_argument("--policy", default=DEFAULT_POLICY, help=f"of --shadow (default: {DEFAULT_POLICY})")
    parser.add_argument("--radius", type=float, default=0.18, metavar="M", help="radius of the robot (default: 0.18)")
    parser.add_argument("--height", type=float, default=1.35, metavar="M", help="height of the robot (default: 1.35)")
    parser.add_argument("--preset", default="default", help="mapping effort: quick, default, paper (default: default)")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of map and policy (default: 0)")
    parser.add_argument("--device", default="auto", help="where the map trains: auto, cpu or cuda (default: auto)")
    parser.add_argument(
        "--keep-images",
        dest="settings",
        action="append_const",
        const="record.images=full",
        help="keep the colour images at full size (record.images=full)",
    )
    parser.add_argument(
        "--set",
        action="append",
        metavar="NAME=VALUE",
        dest="settings",
        help="any setting of config.json; may be repeated",
    )
    parser.set_defaults(command=_map, settings=[])


def _map(parsed: argparse.Namespace) -> int:
    from anm_mj.cli.bar import progress_bar
    from anm_mj.cli.folder_line import print_folder
    from anm_mj.cli.progress import FrameLine, Interrupt
    from anm_mj.config import ConfigError, make_config
    from anm_mj.io.sequence_layouts import SequenceOptions, open_sequence
    from anm_mj.map_sequence import map_sequence
    from anm_mj.types import Footprint

    # As with python -m, the modules of the working directory can be imported: a policy of the user's own.
    sys.path.insert(0, os.getcwd())
    if not 0.0 < parsed.radius < parsed.height <= TALLEST_M:
        raise ConfigError(f"A robot of radius {parsed.radius:g} m and height {parsed.height:g} m makes no sense here.")
    from anm_mj.cli.console import PlainConsole

    console = PlainConsole()
    options = SequenceOptions(
        parsed.layout,
        _camera(parsed.camera),
        parsed.depth_unit,
        parsed.up,
        parsed.floor,
        parsed.every,
        _topics(parsed.topics),
    )
    config = make_config(
        parsed.preset,
        parsed.settings,
        scene=str(parsed.sequence),
        policy=parsed.policy,
        seed=parsed.seed,
        device=parsed.device,
    )
    sequence, layout = open_sequence(parsed.sequence, options)
    height_m = sequence.frames[0].T_world_camera[2, 3]
    console.print(
        f"{len(sequence)} frames, layout {layout}; the first camera is {height_m:.2f} m above the floor.",
        highlight=False,
        soft_wrap=True,
    )
    footprint = Footprint(parsed.radius, 0.05, parsed.height)
    with Interrupt(console) as interrupt, progress_bar(console, "map") as on_progress:
        observers = (FrameLine(console, on_progress), interrupt)
        folder = map_sequence(sequence, config, footprint, out=parsed.out, shadow=parsed.shadow, observers=observers)
    print_folder(console, folder.path)
    return 0


def _topics(words: list[str]) -> dict[str, str]:
    from anm_mj.config import ConfigError

    for word in words:
        if "=" not in word:
            raise ConfigError(f"--topic is '{word}'; give ROLE=NAME, as in colour=/camera/color/image_raw.")
    return dict(word.split("=", 1) for word in words)


def _camera(text: str | None) -> tuple[float, float, float, float] | None:
    from anm_mj.config import ConfigError

    if text is None:
        return None
    try:
        fx, fy, cx, cy = (float(part) for part in text.split(","))
    except ValueError as err:
        raise ConfigError(f"--camera is '{text}'; give FX,FY,CX,CY in pixels, as in 525,525,320,240.") from err
    return fx, fy, cx, cy
