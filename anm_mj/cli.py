"""The command line: ``anm-mj explore | eval | scene | doctor``.

Wrong input ends with one sentence and exit status 2. Heavy packages are imported by the commands that need them, so
that ``--help`` and a mistyped option answer at once.
"""

from __future__ import annotations

import argparse
import logging
import math
import os
import sys
from pathlib import Path
from typing import Any, NoReturn

from rich.console import Console
from rich.logging import RichHandler

from anm_mj.errors import AnmError

USAGE_ERROR = 2
INTERRUPTED = 130
"""Exit status of a program that a second Ctrl-C has ended, by custom 128 + SIGINT."""


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one sentence, without the usage in front of it."""

    def error(self, message: str) -> NoReturn:
        self.exit(USAGE_ERROR, f"{self.prog}: {message}; see {self.prog} --help.\n")


def main(argv: list[str] | None = None) -> int:
    """Run a command line and return its exit status."""
    arguments = _with_joined_start(sys.argv[1:] if argv is None else argv)
    parsed = _parser().parse_args(arguments)
    _log_to(Console(stderr=True))
    try:
        return parsed.command(parsed)
    except AnmError as err:
        Console(stderr=True).print(f"anm-mj: {err}", style="red", markup=False, highlight=False, soft_wrap=True)
        return USAGE_ERROR
    except KeyboardInterrupt:
        return INTERRUPTED


def _log_to(console: Console) -> None:
    """Send what the project logs to a console, and of other packages only warnings."""
    handler = RichHandler(console=console, show_time=False, show_level=False, show_path=False)
    logging.basicConfig(level=logging.WARNING, format="%(message)s", handlers=[handler], force=True)
    logging.getLogger("anm_mj").setLevel(logging.INFO)


def _with_joined_start(argv: list[str]) -> list[str]:
    """The same words with ``--start -1,2,0`` as one: alone, a word that begins with '-' is taken for an option."""
    words = list(argv)
    if "--start" in words[:-1]:
        at = words.index("--start")
        words[at : at + 2] = [f"--start={words[at + 1]}"]
    return words


def _parser() -> _Parser:
    parser = _Parser(prog="anm-mj", description="Active neural mapping of indoor scenes with a MuJoCo robot.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_explore(commands)
    evaluate = commands.add_parser("eval", help="compute the numbers of a run anew from its folder alone")
    evaluate.add_argument("run", type=Path, metavar="RUN", help="a run folder")
    evaluate.set_defaults(command=_evaluate)
    _add_scene(commands)
    doctor = commands.add_parser("doctor", help="what this machine has, and what will be used")
    doctor.set_defaults(command=_doctor)
    return parser


def _add_explore(commands: Any) -> None:
    explore = commands.add_parser(
        "explore",
        help="let the robot explore a scene and write a run folder",
        epilog="example: anm-mj explore home --steps 500",
    )
    explore.add_argument("scene", metavar="SCENE", help="name from the catalogue (anm-mj scene list) or a scene folder")
    explore.add_argument(
        "--policy", default="gvg", help="gvg, anm-s (the paper's), random, or module:Class (default: gvg)"
    )
    explore.add_argument(
        "--steps", type=int, metavar="N", help="budget of actions; turns count (default: the scene's own)"
    )
    explore.add_argument("--seed", type=int, default=0, metavar="S", help="one seed, same steps (default: 0)")
    explore.add_argument("--start", metavar="X,Y,YAW_DEG", help="start pose in m, m, deg (default: the scene's first)")
    explore.add_argument("--out", type=Path, metavar="DIR", help="run folder (default: a new one in runs/)")
    explore.add_argument(
        "--preset", default="default", help="mapping effort: quick, default or paper (default: default)"
    )
    explore.add_argument(
        "--drive",
        default="kinematic",
        help="kinematic (exact actions) or physics (wheels, contact) (default: kinematic)",
    )
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


def _add_scene(commands: Any) -> None:
    scene = commands.add_parser("scene", help="import scenes and list them")
    actions = scene.add_subparsers(required=True, metavar="ACTION")
    imported = actions.add_parser("import", help="turn a mesh file into a scene folder")
    imported.add_argument("src", type=Path, metavar="SRC", help="a .glb, .gltf, .obj or .ply file")
    imported.add_argument("out", type=Path, metavar="OUT", help="the scene folder to make")
    imported.add_argument("--up", default="auto", help="axis that points up in SRC: x, y, z or auto")
    imported.add_argument("--scale", type=float, help="metres per unit of SRC (default: found from its size)")
    imported.add_argument("--name", help="name of the scene (default: the file's)")
    imported.add_argument("--licence", help="licence of SRC, kept in the folder")
    imported.add_argument("--source", help="where SRC comes from, kept in the folder (default: the file's name)")
    imported.set_defaults(command=_scene_import)
    actions.add_parser("list", help="the scenes that can be named").set_defaults(command=_scene_list)


def _explore(parsed: argparse.Namespace) -> int:
    from anm_mj.config import make_config
    from anm_mj.progress import Interrupt, ProgressLine, print_metrics
    from anm_mj.run import run

    # As with python -m, a policy of the user's own is found beside where the command is given.
    sys.path.insert(0, os.getcwd())
    config = make_config(
        parsed.preset,
        parsed.settings,
        scene=parsed.scene,
        policy=parsed.policy,
        steps=parsed.steps,
        seed=parsed.seed,
        start=_start(parsed.start),
        drive=parsed.drive,
        device=parsed.device,
    )
    console = Console()
    if console.is_terminal:
        _log_to(console)  # The live line knows how to make room for what its own console prints.
    viewer = _viewer(parsed)
    try:
        with Interrupt(console) as interrupt, ProgressLine(console) as line:
            folder, metrics = run(
                config, out=parsed.out, viewer=viewer, stop_requested=interrupt.requested, on_step=line.update
            )
    finally:
        if viewer is not None:
            viewer.close()
    print_metrics(console, metrics, folder.path)
    return 0


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


def _evaluate(parsed: argparse.Namespace) -> int:
    from anm_mj.evaluation.evaluate import evaluate_run
    from anm_mj.progress import print_metrics

    print_metrics(Console(), evaluate_run(parsed.run), parsed.run)
    return 0


def _scene_import(parsed: argparse.Namespace) -> int:
    from anm_mj.scene.importer import import_scene

    scene = import_scene(
        parsed.src,
        parsed.out,
        up=parsed.up,
        scale=parsed.scale,
        name=parsed.name,
        licence=parsed.licence,
        source=parsed.source,
    )
    size = scene.bounds_m[1] - scene.bounds_m[0]
    start = scene.starts[0]
    Console().print(
        f"{scene.name}: {scene.num_triangles} triangles, {size[0]:.1f} x {size[1]:.1f} x {size[2]:.1f} m, "
        f"start {start.x_m:.2f},{start.y_m:.2f}. Explore it: anm-mj explore {parsed.out}",
        highlight=False,
        soft_wrap=True,
    )
    return 0


def _scene_list(parsed: argparse.Namespace) -> int:
    del parsed
    from rich.table import Table

    from anm_mj.scene.catalogue import list_scenes

    table = Table("name", "rooms", "size [m]", "triangles", "licence", "folder", box=None)
    for scene in list_scenes():
        size = scene.bounds_m[1] - scene.bounds_m[0]
        rooms = "" if scene.rooms is None else str(scene.rooms)
        extent = " x ".join(f"{length:.1f}" for length in size)
        table.add_row(scene.name, rooms, extent, str(scene.num_triangles), scene.licence, str(scene.folder))
    Console().print(table)
    return 0


def _doctor(parsed: argparse.Namespace) -> int:
    del parsed
    from anm_mj.doctor import main as doctor

    return doctor()


if __name__ == "__main__":
    sys.exit(main())
