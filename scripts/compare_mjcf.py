"""Imports MuJoCo worlds, explores them, and compares their depth with what MuJoCo draws of the source.

python scripts/compare_mjcf.py house.xml office.xml   # files
python scripts/compare_mjcf.py --mazes 10 --arenas    # of dm_control
python scripts/compare_mjcf.py --builtin --house      # the project's own scenes as MJCF, and a house of the tests

Each world is imported, checked, explored for --steps steps, and drawn from its starts in four directions at 1 m. Robots
in a world are left out on both sides.
"""

from __future__ import annotations

import contextlib
import io
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import tyro

from anm_mj.cli.command_line import run_script
from anm_mj.sim.gl import select_backend

select_backend()

from anm_mj.cli.main import main as anm_mj  # noqa: E402 (MuJoCo is bound to a GL back-end when it is imported.)
from anm_mj.scene.folder import load_scene  # noqa: E402
from tests.scene.importing.readers.mjcf.compare import agreement, eyes_in  # noqa: E402
from tests.scene.importing.readers.mjcf.house import write_house  # noqa: E402

BUILTIN = ("room", "flat", "home", "office", "residence")
EYE_M = 1.0


def main(
    files: tyro.conf.Positional[tuple[Path, ...]] = (),
    mazes: int = 0,
    arenas: bool = False,
    builtin: bool = False,
    house: bool = False,
    steps: int = 200,
    starts: int = 2,
) -> None:
    """Print a table, one row per world.

    Args:
        files: MJCF files.
        mazes: so many random mazes of dm_control, with seeds from 0 on.
        arenas: a corridor with walls and a bowl of dm_control.
        builtin: the project's own scenes.
        house: a house with every feature of MJCF, which the tests write.
        steps: of the exploration; 0 for none.
        starts: from so many starts the depth is compared.
    """
    print(f"| world | import | check | rooms | collisions in {steps} steps | pixels within 1 mm |")
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, src in _sources(Path(folder), files, mazes, arenas=arenas, builtin=builtin, house=house):
            print(_row(name, src, Path(folder) / name, steps, starts), flush=True)


def _row(name: str, src: Path, out: Path, steps: int, starts: int) -> str:
    imported = _run(["scene", "import", str(src), str(out), "--name", name])
    if imported:
        return f"| {name} | refused ({imported}) | | | | |"
    checked = _run(["scene", "check", str(out), "--out", f"{out}.png"])
    scene = load_scene(str(out))
    collisions = "-"
    if steps and not checked:
        run = out.with_name(f"{name}_run")
        _run(["explore", str(out), "--steps", str(steps), "--preset", "quick", "--out", str(run)])
        lines = (run / "steps.jsonl").read_text().splitlines()
        collisions = f"{sum(json.loads(line)['collided'] for line in lines)} of {len(lines)}"
    share = agreement(src, scene, eyes_in(scene, starts, EYE_M), hide_robots=True, least_seen=0.1)
    return f"| {name} | good | {'good' if not checked else 'bad'} | {scene.rooms} | {collisions} | {share:.4%} |"


def _run(arguments: list[str]) -> int:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        return anm_mj(arguments)


def _sources(
    folder: Path, files: tuple[Path, ...], mazes: int, *, arenas: bool, builtin: bool, house: bool
) -> Iterator[tuple[str, Path]]:
    for src in files:
        yield src.stem, src
    if house:
        yield "house", write_house(folder / "house_source")
    if builtin:
        for name in BUILTIN:
            yield f"{name}_again", load_scene(name).xml
    for seed in range(mazes):
        yield f"maze_{seed}", _exported(_maze(seed), folder / f"maze_{seed}_source")
    if arenas:
        from dm_control.locomotion.arenas import bowl, corridors

        corridor = corridors.WallsCorridor(wall_gap=4.0, corridor_width=4.0, corridor_length=20.0)
        corridor.regenerate(random_state=np.random.RandomState(0))
        yield "corridor", _exported(corridor, folder / "corridor_source")
        yield "bowl", _exported(bowl.Bowl(size=(8, 8)), folder / "bowl_source")


def _maze(seed: int):
    import labmaze  # pyright: ignore[reportMissingImports] (no wheel for Python 3.13)
    from dm_control.locomotion.arenas import labmaze_textures, mazes

    arena = mazes.MazeWithTargets(
        maze=labmaze.RandomMaze(height=9, width=9, random_seed=seed, max_rooms=2, room_min_size=3, room_max_size=5),
        xy_scale=1.5,
        z_height=2.0,
        wall_textures=labmaze_textures.WallTextures(style="style_01"),
        floor_textures=labmaze_textures.FloorTextures(style="style_01"),
    )
    arena.regenerate()
    return arena


def _exported(arena, folder: Path) -> Path:
    from dm_control.mjcf import export_with_assets

    export_with_assets(arena.mjcf_model, str(folder), "world.xml")
    return folder / "world.xml"


if __name__ == "__main__":
    run_script(main)
