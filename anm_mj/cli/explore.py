"""``anm-mj explore``: one run."""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from anm_mj.cli.option_types import place, port
from anm_mj.planning.policies.registry import DEFAULT_POLICY, policies
from anm_mj.sim.sensors.sensor_presets import SENSORS

if TYPE_CHECKING:
    from anm_mj.evaluation.metrics import Metrics
    from anm_mj.events import Observer
    from anm_mj.io.run_folder import RunFolder

RUN_FAILED = 2
"""Exit status of a run that an error of its policy or of its map has ended; its files are complete."""


def add_explore(commands: Any) -> None:
    """Add ``explore`` to the commands of the program."""
    explore = commands.add_parser(
        "explore",
        help="let the robot explore a scene and write a run folder",
        epilog="example: anm-mj explore home --steps 500",
    )
    explore.add_argument(
        "scene",
        metavar="SCENE",
        nargs="?",
        help="name from the catalogue (anm-mj scene list), a scene folder, or a file to import",
    )
    explore.add_argument(
        "--resume",
        type=Path,
        metavar="RUN",
        help="go on with a run that was killed or interrupted, from its folder; takes no scene and no settings",
    )
    explore.add_argument(
        "--continue",
        dest="continue_from",
        metavar="RUN",
        help="begin with the map and the explored state of a former run, from its folder, and mark what has changed",
    )
    explore.add_argument(
        "--return",
        dest="return_to_start",
        action="store_true",
        help="drive back to the start before the run ends, in time for the budget",
    )
    explore.add_argument(
        "--policy",
        default=DEFAULT_POLICY,
        help=f"{', '.join(_policies())}, or module:Class (default: {DEFAULT_POLICY})",
    )
    explore.add_argument(
        "--goal",
        default="both",
        help="coverage (see all surface, then stop), reconstruction (know it well), or both in this order (default: "
        "both)",
    )
    explore.add_argument(
        "--steps", type=int, metavar="N", help="budget of discrete actions, including turns (default: the scene's own)"
    )
    explore.add_argument("--seed", type=int, default=0, metavar="S", help="one seed, same steps (default: 0)")
    explore.add_argument("--start", metavar="X,Y,YAW_DEG", help="start pose in m, m, deg (default: the scene's first)")
    explore.add_argument("--out", type=place, metavar="DIR", help="run folder (default: a new one in runs/)")
    explore.add_argument(
        "--preset",
        default="default",
        help="mapping effort: quick, default or paper; some policies have their own (default: default)",
    )
    explore.add_argument(
        "--drive",
        default="kinematic",
        help="kinematic (exact actions) or physics (wheels, contact) (default: kinematic)",
    )
    explore.add_argument(
        "--robot",
        default="diff_drive",
        metavar="ROBOT",
        help="your robot's MJCF, or a name: diff_drive, stretch3, turtlebot3_burger, turtlebot3_waffle_pi or one of "
        "the package robot_descriptions (default: diff_drive, see docs/robot.md)",
    )
    explore.add_argument(
        "--pose",
        default="true",
        help="pose in the observations: true, or odometry (from the wheels alone) (default: true)",
    )
    explore.add_argument(
        "--sensor",
        default="exact",
        help=f"errors of the camera: {', '.join(SENSORS)}; details with --set sensor.NAME=VALUE (default: exact)",
    )
    ablation = explore.add_argument_group("ablations of the paper: settings of policies that have them")
    ablation.add_argument(
        "--target",
        dest="settings",
        action="append",
        type="policy.target={}".format,
        metavar="NAME",
        help="how the policy chooses a vertex: hierarchical, best-anchored or random (policy.target=NAME)",
    )
    for option, setting, text in (
        ("--no-visibility-guidance", "policy.visibility_guidance=false", "neither prefer nor turn to regions"),
        ("--no-bootstrap", "policy.bootstrap_turns=0", "no rotation before the first decision"),
    ):
        ablation.add_argument(option, dest="settings", action="append_const", const=setting, help=f"{text} ({setting})")
    explore.add_argument(
        "--keep-images",
        dest="settings",
        action="append_const",
        const="record.images=full",
        help="keep the colour images at full size, for NeRF, splats and COLMAP (record.images=full)",
    )
    explore.add_argument("--device", default="auto", help="where the map trains: auto, cpu or cuda (default: auto)")
    explore.add_argument("--view", action="store_true", help="show the run in the browser, on this machine only")
    explore.add_argument("--port", type=port, help="port of --view (default: the next free one from 7000)")
    explore.add_argument(
        "--set",
        action="append",
        metavar="NAME=VALUE",
        dest="settings",
        help="any setting of config.json, as in planning.margin_m=0.06 [m] or, of the policy, policy.replan_steps=8; "
        "may be repeated",
    )
    explore.set_defaults(command=_explore, settings=[])
    options = {action.dest for action in explore._actions if action.default is not argparse.SUPPRESS}
    explore.set_defaults(defaults={name: explore.get_default(name) for name in options})


def _explore(parsed: argparse.Namespace) -> int:
    from anm_mj.config import ConfigError, make_config
    from anm_mj.run import run
    from anm_mj.scene.importing.import_on_demand import folder_of
    from anm_mj.sim.gl import select_backend

    # As with python -m, the modules of the working directory can be imported: a policy of the user's own.
    sys.path.insert(0, os.getcwd())
    if parsed.resume is not None:
        from anm_mj.resume import resume

        _require_only(parsed, "--resume", _RESUME_OPTIONS)
        policy = None if parsed.policy == DEFAULT_POLICY else parsed.policy
        return _show(parsed, lambda observers: resume(parsed.resume, policy=policy, observers=observers))
    if parsed.scene is None:
        raise ConfigError("No scene is named; give one of anm-mj scene list, a scene folder, or --resume RUN.")
    # A MuJoCo world is compiled before the run begins, and the back-end must be chosen before that.
    if not os.path.isdir(parsed.scene):
        select_backend()
    config = make_config(
        parsed.preset,
        parsed.settings,
        scene=folder_of(parsed.scene),
        policy=parsed.policy,
        goal=parsed.goal,
        steps=parsed.steps,
        seed=parsed.seed,
        start=_start(parsed.start),
        robot=parsed.robot,
        drive=parsed.drive,
        pose=parsed.pose,
        device=parsed.device,
        sensor=parsed.sensor,
        continue_from=parsed.continue_from,
        return_to_start=parsed.return_to_start,
    )
    return _show(parsed, lambda observers: run(config, out=parsed.out, observers=observers))


_RESUME_OPTIONS = ("resume", "policy", "view", "port", "verbose")
"""Options that go with --resume: all others are those of the run."""


def _require_only(parsed: argparse.Namespace, option: str, allowed: tuple[str, ...]) -> None:
    """Raises ConfigError for an option that does not go with another one."""
    from anm_mj.config import ConfigError

    for name, default in parsed.defaults.items():
        if name not in allowed and getattr(parsed, name) != default:
            named = {"settings": "set", "continue_from": "continue", "return_to_start": "return"}
            given = "a scene" if name == "scene" else f"--{named.get(name, name)}"
            raise ConfigError(f"{option} goes on with the run as it was set up; leave out {given}.")


def _show(parsed: argparse.Namespace, start: Callable[[list[Observer]], tuple[RunFolder, Metrics]]) -> int:
    """Run, show how it goes, and print the metrics at the end.

    Args:
        parsed: the options of the viewer.
        start: makes the run, given its observers.
    """
    from anm_mj.cli.console import PlainConsole
    from anm_mj.cli.folder_line import print_folder
    from anm_mj.cli.log import log_to
    from anm_mj.cli.metrics_table import print_metrics
    from anm_mj.cli.progress import Interrupt, ProgressLine
    from anm_mj.types import StopReason

    console = PlainConsole()
    if console.is_terminal:
        log_to(console, verbose=parsed.verbose)  # The live line makes room for what its own console prints.
    viewer = _viewer(parsed)
    try:
        with Interrupt(console) as interrupt, ProgressLine(console, details=parsed.verbose) as line:
            folder, metrics = start([interrupt, line, *([] if viewer is None else [viewer])])
    finally:
        if viewer is not None:
            viewer.close()
    print_metrics(console, metrics)
    print_folder(console, folder.path)
    return RUN_FAILED if metrics.stop_reason in (StopReason.POLICY_ERROR, StopReason.MAP_ERROR) else 0


def _policies() -> list[str]:
    """The names of the policies, with a few words where one has any."""
    return [f"{name} ({entry.summary})" if entry.summary else name for name, entry in policies().items()]


def _viewer(parsed: argparse.Namespace) -> Any:
    from anm_mj.config import ConfigError

    if not parsed.view:
        if parsed.port is not None:
            raise ConfigError(f"--port is {parsed.port}, but nothing is shown; add --view.")
        return None
    from anm_mj.viz.meshcat_viewer import MeshcatViewer

    return MeshcatViewer(port=parsed.port, title=f"{Path(parsed.scene).name}, {parsed.policy}, seed {parsed.seed}")


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
