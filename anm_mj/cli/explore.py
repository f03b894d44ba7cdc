"""``anm-mj explore``: one run."""

from __future__ import annotations

import argparse
import math
import os
import sys
from pathlib import Path
from typing import Any

from rich.console import Console

from anm_mj.cli.log import log_to


def add_explore(commands: Any) -> None:
    """Add ``explore`` to the commands of the program."""
    explore = commands.add_parser(
        "explore",
        help="let the robot explore a scene and write a run folder",
        epilog="example: anm-mj explore home --steps 500",
    )
    explore.add_argument("scene", metavar="SCENE", help="name from the catalogue (anm-mj scene list) or a scene folder")
    explore.add_argument(
        "--policy",
        default="gvg",
        help="gvg, anm-s (the paper's), anm, upen, frontier, frontier-full, random, oracle (which knows the scene), "
        "or module:Class (default: gvg)",
    )
    explore.add_argument(
        "--steps", type=int, metavar="N", help="budget of actions; turns count (default: the scene's own)"
    )
    explore.add_argument("--seed", type=int, default=0, metavar="S", help="one seed, same steps (default: 0)")
    explore.add_argument("--start", metavar="X,Y,YAW_DEG", help="start pose in m, m, deg (default: the scene's first)")
    explore.add_argument("--out", type=Path, metavar="DIR", help="run folder (default: a new one in runs/)")
    explore.add_argument(
        "--preset",
        default="default",
        help="mapping effort: quick, default or paper; policy anm has its own (default: default)",
    )
    explore.add_argument(
        "--drive",
        default="kinematic",
        help="kinematic (exact actions) or physics (wheels, contact) (default: kinematic)",
    )
    explore.add_argument(
        "--robot",
        default="diff_drive",
        metavar="FILE",
        help="your robot's MJCF, with two wheel hinges and a camera (default: diff_drive, see docs/robot.md)",
    )
    explore.add_argument(
        "--pose",
        default="true",
        help="where the robot believes to be: true, or odometry (its wheels alone) (default: true)",
    )
    ablation = explore.add_argument_group("ablations of the paper, for --policy anm-s")
    ablation.add_argument(
        "--target", help="hierarchical, best-anchored or random: how a vertex is chosen (default: hierarchical)"
    )
    ablation.add_argument(
        "--no-visibility-guidance", action="store_true", help="neither prefer regions of interest nor turn to them"
    )
    ablation.add_argument("--no-bootstrap", action="store_true", help="no full turn before the first decision")
    explore.add_argument("--device", default="auto", help="where the map is trained: auto, cpu or cuda (default: auto)")
    explore.add_argument("--view", action="store_true", help="show the run in the browser, on this machine only")
    explore.add_argument("--port", type=int, help="port of --view (default: the next free one from 7000)")
    explore.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        dest="settings",
        help="any setting of config.json, as in planning.margin_m=0.06; may be repeated",
    )
    explore.set_defaults(command=_explore)


def _explore(parsed: argparse.Namespace) -> int:
    from anm_mj.cli.progress import Interrupt, ProgressLine, print_metrics
    from anm_mj.config import make_config
    from anm_mj.run import run

    # As with python -m, a policy of the user's own is found beside where the command is given.
    sys.path.insert(0, os.getcwd())
    config = make_config(
        parsed.preset,
        [*_ablation(parsed), *parsed.settings],
        scene=parsed.scene,
        policy=parsed.policy,
        steps=parsed.steps,
        seed=parsed.seed,
        start=_start(parsed.start),
        robot=parsed.robot,
        drive=parsed.drive,
        pose=parsed.pose,
        device=parsed.device,
    )
    console = Console()
    if console.is_terminal:
        log_to(console)  # The live line knows how to make room for what its own console prints.
    viewer = _viewer(parsed)
    try:
        with Interrupt(console) as interrupt, ProgressLine(console) as line:
            folder, metrics = run(
                config,
                out=parsed.out,
                viewer=viewer,
                stop_requested=interrupt.requested,
                on_step=line.update,
                on_survey=line.surveying,
            )
    finally:
        if viewer is not None:
            viewer.close()
    print_metrics(console, metrics, folder.path)
    return 0


def _ablation(parsed: argparse.Namespace) -> list[str]:
    """The paper's ablations as single settings."""
    from anm_mj.config import ConfigError

    asked = {
        "--target": parsed.target and f"planning.target={parsed.target}",
        "--no-visibility-guidance": parsed.no_visibility_guidance and "planning.visibility_guidance=False",
        "--no-bootstrap": parsed.no_bootstrap and "planning.bootstrap_turns=0",
    }
    settings = {option: setting for option, setting in asked.items() if setting}
    if settings and parsed.policy != "anm-s":
        raise ConfigError(f"{next(iter(settings))} is for --policy anm-s alone, but the policy is {parsed.policy}.")
    return list(settings.values())


def _viewer(parsed: argparse.Namespace) -> Any:
    from anm_mj.config import ConfigError

    if not parsed.view:
        if parsed.port is not None:
            raise ConfigError(f"--port is {parsed.port}, but nothing is shown; add --view.")
        return None
    from anm_mj.viz.meshcat_viewer import MeshcatViewer

    return MeshcatViewer(port=parsed.port)


def _start(text: str | None) -> tuple[float, float, float] | None:
    from anm_mj.config import ConfigError

    if text is None:
        return None
    try:
        x, y, yaw_deg = (float(part) for part in text.split(","))
        if not math.isfinite(x + y + yaw_deg):
            raise ValueError("not finite")
    except ValueError as err:
        raise ConfigError(f"--start is '{text}'; give X,Y,YAW_DEG in m, m and deg, as in 4.68,-1.98,0.") from err
    return x, y, yaw_deg
