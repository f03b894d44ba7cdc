"""``anm-mj scene``: make, import, check and list scenes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from anm_mj.cli.scene_check import add_check


def add_scene(commands: Any) -> None:
    """Add ``scene`` and its actions to the commands of the program."""
    scene = commands.add_parser("scene", help="import, generate, check and list scenes")
    actions = scene.add_subparsers(required=True, metavar="ACTION")
    imported = actions.add_parser(
        "import", help="turn a mesh, a Gazebo or MuJoCo world, a scan or a floor plan into a scene folder"
    )
    imported.add_argument("src", type=Path, metavar="SRC", help="a file, a folder or a name (docs/scenes.md)")
    imported.add_argument("out", type=Path, metavar="OUT", help="the scene folder to make")
    imported.add_argument(
        "--format",
        "--kind",
        default="auto",
        help="format of SRC: gazebo, mjcf, hssd, replicacad, habitat, hm3d, matterport3d, gibson, replica, floorplan, "
        "mesh",
    )
    imported.add_argument(
        "--up", choices=("x", "y", "z", "auto"), default="auto", help="axis of SRC that points up (default: found)"
    )
    imported.add_argument("--scale", type=float, help="metres per unit of SRC (default: found from its size)")
    imported.add_argument("--name", help="name of the scene (default: the file's)")
    imported.add_argument("--licence", help="licence of SRC, kept in the folder (default: the data set's)")
    imported.add_argument("--source", help="where SRC comes from, kept in the folder (default: the file's name)")
    imported.add_argument(
        "--model-path",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="a folder of models that SRC refers to; may be given several times",
    )
    imported.add_argument("--no-furniture", action="store_true", help="leave the rooms of a floor plan empty")
    imported.add_argument("--root", type=Path, metavar="DIR", help="folder of the data set that SRC names a scene of")
    imported.add_argument("--force", action="store_true", help="replace a scene that OUT holds already")
    _add_choice(imported)
    imported.set_defaults(command=_scene_import)
    generated = actions.add_parser("generate", help="generate a furnished building")
    generated.add_argument("out", type=Path, metavar="OUT", help="the scene folder to make")
    generated.add_argument("--rooms", type=int, default=5, help="number of rooms, corridors included (default: 5)")
    generated.add_argument("--seed", type=int, default=0, help="seed of the generator (default: 0)")
    generated.add_argument(
        "--kind", choices=("apartment", "office"), default="apartment", help="type of building (default: apartment)"
    )
    generated.add_argument("--name", help="name of the scene (default: the folder's)")
    generated.add_argument(
        "--moved",
        type=int,
        default=0,
        metavar="N",
        help="N pieces of furniture stand somewhere else than without this option; moved.json says which (default: 0)",
    )
    generated.add_argument("--force", action="store_true", help="replace a scene that OUT holds already")
    generated.set_defaults(command=_scene_generate)
    add_check(actions)
    actions.add_parser("list", help="the scenes that can be named").set_defaults(command=_scene_list)


def _add_choice(imported: argparse.ArgumentParser) -> None:
    """Add the options that say what of a source is wanted, and in what state."""
    choice = imported.add_argument_group("what of SRC is imported")
    choice.add_argument(
        "--only",
        nargs="+",
        default=[],
        metavar="PATTERN",
        help="only parts with a matching name, as in 'floor*' 'wall*'",
    )
    choice.add_argument(
        "--leave-out", nargs="+", default=[], metavar="PATTERN", help="no parts with a matching name, as in 'door_*'"
    )
    choice.add_argument(
        "--doors", choices=("as-is", "open", "closed"), default="as-is", help="state of door leaves (default: as-is)"
    )
    choice.add_argument(
        "--storey",
        metavar="N|Z",
        help="one storey: its number from 1 at the bottom, or the height of its floor, as in 3.2",
    )
    choice.add_argument("--settle", action="store_true", help="MuJoCo worlds: drop all bodies until they rest")
    choice.add_argument(
        "--movable", action="store_true", help="MuJoCo worlds: the robot may push free bodies (--drive physics)"
    )
    choice.add_argument(
        "--groups",
        metavar="N,N,...",
        help="MuJoCo worlds: geom groups that the camera sees (default: 0,1,2, as MuJoCo draws)",
    )


def _groups(text: str | None) -> list[int] | None:
    """The geom groups of --groups."""
    from anm_mj.errors import SceneError

    if text is None:
        return None
    words = text.split(",")
    if not all(word.strip() in ("0", "1", "2", "3", "4", "5") for word in words):
        raise SceneError(f"--groups is '{text}'; give numbers of geom groups from 0 to 5, as in 0,2.")
    return [int(word) for word in words]


def _scene_import(parsed: argparse.Namespace) -> int:
    from anm_mj.cli.bar import busy
    from anm_mj.cli.console import PlainConsole
    from anm_mj.scene.folder import remember_folder
    from anm_mj.scene.importing.import_scene import import_scene

    with busy(PlainConsole(), "import"):
        scene = import_scene(
            parsed.src,
            parsed.out,
            source_format=parsed.format,
            up=parsed.up,
            scale=parsed.scale,
            name=parsed.name,
            licence=parsed.licence,
            source=parsed.source,
            model_paths=parsed.model_path,
            furniture=not parsed.no_furniture,
            only=parsed.only,
            leave_out=parsed.leave_out,
            doors=parsed.doors,
            storey=parsed.storey,
            settle=parsed.settle,
            movable=parsed.movable,
            groups=_groups(parsed.groups),
            root=parsed.root,
            overwrite=parsed.force,
        )
    remember_folder(scene.folder)
    size = scene.bounds_m[1] - scene.bounds_m[0]
    start = scene.starts[0]
    rooms = "" if scene.rooms is None else f"{scene.rooms} room{'s' * (scene.rooms > 1)}, "
    return _say(
        f"{scene.name}: {rooms}{scene.num_triangles} triangles, {size[0]:.1f} x {size[1]:.1f} x {size[2]:.1f} m, "
        f"start {start.x_m:.2f},{start.y_m:.2f}. Explore it: anm-mj explore {parsed.out}"
    )


def _scene_generate(parsed: argparse.Namespace) -> int:
    from anm_mj.cli.bar import busy
    from anm_mj.cli.console import PlainConsole
    from anm_mj.scene.folder import remember_folder
    from anm_mj.scene.generation.generate_scene import generate_scene

    with busy(PlainConsole(), "generate"):
        scene = generate_scene(
            parsed.out,
            parsed.rooms,
            parsed.seed,
            parsed.kind,
            parsed.name,
            overwrite=parsed.force,
            moved=parsed.moved,
        )
    remember_folder(scene.folder)
    size = scene.bounds_m[1] - scene.bounds_m[0]
    return _say(
        f"{scene.name}: {scene.rooms} rooms, {size[0]:.1f} x {size[1]:.1f} m, {scene.num_triangles} triangles. "
        f"Explore it: anm-mj explore {parsed.out}"
    )


def _say(sentence: str) -> int:
    """Print what was made; the exit status of success."""
    from anm_mj.cli.console import PlainConsole

    PlainConsole().print(sentence, highlight=False, soft_wrap=True)
    return 0


def _scene_list(parsed: argparse.Namespace) -> int:
    del parsed
    from rich.markup import escape
    from rich.table import Table

    from anm_mj.cli.console import PlainConsole
    from anm_mj.scene.catalogue import list_scenes

    table = Table("name", "rooms", "size [m]", "triangles", "licence", box=None)
    table.add_column("folder", overflow="fold")
    for scene in list_scenes():
        size = scene.bounds_m[1] - scene.bounds_m[0]
        rooms = "" if scene.rooms is None else str(scene.rooms)
        extent = " x ".join(f"{length:.1f}" for length in size)
        folder = scene.folder.resolve()
        shown = folder.relative_to(Path.cwd()) if folder.is_relative_to(Path.cwd()) else folder
        # A scene is found by its folder's name; what it calls itself may be anything.
        cells = (folder.name, rooms, extent, str(scene.num_triangles), scene.licence, str(shown))
        table.add_row(*(escape(cell) for cell in cells))
    PlainConsole().print(table)
    return 0
