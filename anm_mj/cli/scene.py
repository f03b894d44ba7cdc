"""``anm-mj scene``: imports, generates and lists scenes."""

from __future__ import annotations

from argparse import ArgumentTypeError
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from anm_mj.cli.command_line import Option, Report
from anm_mj.cli.option_types import Count

if TYPE_CHECKING:
    from anm_mj.scene.folder import Scene


def _groups(text: str) -> list[int]:
    words = text.split(",")
    if not all(word.strip() in ("0", "1", "2", "3", "4", "5") for word in words):
        raise ArgumentTypeError(f"'{text}' is wrong; give numbers of geom groups from 0 to 5, as in 0,2")
    return [int(word) for word in words]


Patterns = Annotated[Sequence[str], Option("PATTERN", several=True)]


def scene_import(
    src: Path,
    out: Path,
    *,
    format: str = "auto",
    up: Literal["x", "y", "z", "auto"] = "auto",
    scale: float | None = None,
    name: str | None = None,
    licence: str | None = None,
    source: str | None = None,
    model_path: Annotated[Sequence[Path], Option("DIR")] = (),
    no_furniture: bool = False,
    root: Annotated[Path | None, Option("DIR")] = None,
    force: bool = False,
    only: Patterns = (),
    leave_out: Patterns = (),
    doors: Literal["as-is", "open", "closed"] = "as-is",
    storey: Annotated[str | None, Option("N|Z")] = None,
    settle: bool = False,
    movable: bool = False,
    groups: Annotated[list[int] | None, Option("N,N,...", _groups)] = None,
) -> Report:
    """Turn a mesh, a Gazebo or MuJoCo world, a scan or a floor plan into a scene folder.

    Args:
        src: a file, a folder or a name (docs/scenes.md)
        out: the scene folder to make
        format: format of SRC: gazebo, mjcf, hssd, replicacad, habitat, hm3d, matterport3d, gibson, replica, floorplan,
            mesh
        up: axis of SRC that points up; auto finds it
        scale: metres per unit of SRC; by default found from its size
        name: name of the scene; by default the file's
        licence: licence of SRC, kept in the folder; by default the data set's
        source: where SRC comes from, kept in the folder; by default the file's name
        model_path: a folder of models that SRC refers to; may be given several times
        no_furniture: leave the rooms of a floor plan empty
        root: folder of the data set that SRC names a scene of
        force: replace a scene that OUT holds already
        only: only parts with a matching name, as in 'floor*' 'wall*'
        leave_out: no parts with a matching name, as in 'door_*'
        doors: state of door leaves
        storey: one storey: its number from 1 at the bottom, or the height of its floor, as in 3.2
        settle: MuJoCo worlds: drop all bodies until they rest
        movable: MuJoCo worlds: the robot may push free bodies (--drive physics)
        groups: MuJoCo worlds: geom groups that the camera sees; by default 0,1,2, as MuJoCo draws
    """
    from anm_mj.cli.console import PlainConsole, busy
    from anm_mj.scene.importing.import_scene import import_scene

    with busy(PlainConsole(), "import"):
        scene = import_scene(
            src,
            out,
            source_format=format,
            up=up,
            scale=scale,
            name=name,
            licence=licence,
            source=source,
            model_paths=model_path,
            furniture=not no_furniture,
            only=only,
            leave_out=leave_out,
            doors=doors,
            storey=storey,
            settle=settle,
            movable=movable,
            groups=groups,
            root=root,
            overwrite=force,
        )
    size, start = scene.bounds_m[1] - scene.bounds_m[0], scene.starts[0]
    rooms = "" if scene.rooms is None else f"{scene.rooms} room{'s' * (scene.rooms > 1)}, "
    return _say_made(
        scene,
        f"{rooms}{scene.num_triangles} triangles, {size[0]:.1f} x {size[1]:.1f} x {size[2]:.1f} m, "
        f"start {start.x_m:.2f},{start.y_m:.2f}",
        out,
    )


def scene_generate(
    out: Path,
    *,
    rooms: int = 5,
    seed: int = 0,
    kind: Literal["apartment", "office"] = "apartment",
    name: str | None = None,
    moved: Count = 0,
    force: bool = False,
) -> Report:
    """Generate a furnished building.

    Args:
        out: the scene folder to make
        rooms: number of rooms, corridors included
        seed: seed of the generator
        kind: type of building
        name: name of the scene; by default the folder's
        moved: N pieces of furniture stand somewhere else than without this option; moved.json says which
        force: replace a scene that OUT holds already
    """
    from anm_mj.cli.console import PlainConsole, busy
    from anm_mj.scene.generation.generate_scene import generate_scene

    with busy(PlainConsole(), "generate"):
        scene = generate_scene(out, rooms, seed, kind, name, overwrite=force, moved=moved)
    size, plural = scene.bounds_m[1] - scene.bounds_m[0], "s" * (rooms > 1)
    facts = f"{scene.rooms} room{plural}, {size[0]:.1f} x {size[1]:.1f} m, {scene.num_triangles} triangles"
    return _say_made(scene, facts, out)


def _say_made(scene: Scene, facts: str, out: Path) -> Report:
    """Print what was made, and remember where."""
    from anm_mj.cli.console import PlainConsole
    from anm_mj.scene.folder import named_folder, remember_folder
    from anm_mj.utils.package_data import data_folder

    remember_folder(scene.folder)
    console = PlainConsole()
    console.say(f"{scene.name}: {facts}. Explore it: anm-mj explore {out}")
    builtin = data_folder("scenes") / out.name
    if builtin.is_dir() and scene.folder.resolve() != builtin.resolve():
        console.say(f"The package has a scene {out.name}, too; here the name means {named_folder(out.name)}.")
    return Report(scene_facts(scene))


def scene_facts(scene: Scene) -> dict[str, Any]:
    """What ``--json`` says of a scene."""
    return {
        "name": scene.folder.resolve().name,
        "rooms": scene.rooms,
        "size_m": scene.bounds_m[1] - scene.bounds_m[0],
        "triangles": scene.num_triangles,
        "licence": scene.licence,
        "folder": scene.folder.resolve(),
    }


def scene_list() -> Report:
    """List the scenes that can be named."""
    from rich.table import Table

    from anm_mj.cli.console import PlainConsole
    from anm_mj.scene.folder import list_scenes

    table = Table("name", "rooms", "size [m]", "triangles", "licence", box=None)
    table.add_column("folder", overflow="fold")
    scenes = list_scenes()
    for scene in scenes:
        size = scene.bounds_m[1] - scene.bounds_m[0]
        rooms = "" if scene.rooms is None else str(scene.rooms)
        extent = " x ".join(f"{length:.1f}" for length in size)
        folder = scene.folder.resolve()
        shown = folder.relative_to(Path.cwd()) if folder.is_relative_to(Path.cwd()) else folder
        # A scene is found by its folder's name; what it calls itself may be anything.
        table.add_row(folder.name, rooms, extent, str(scene.num_triangles), scene.licence, str(shown))
    PlainConsole().print(table)
    return Report([scene_facts(scene) for scene in scenes])
