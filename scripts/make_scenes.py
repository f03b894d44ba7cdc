"""Regenerates the scenes that come with the project, in seconds.

Run it from the repository root: ``python scripts/make_scenes.py`` makes all of them in scenes/, with names after it
only those. scenes/home is not among them: it was designed by hand and is kept as it is.
"""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from anm_mj.cli.command_line import run_script
from anm_mj.scene.generation.generate_scene import generate_scene

_Kind = Literal["apartment", "office"]
SCENES: dict[str, tuple[int, int, _Kind]] = {
    "room": (1, 3, "apartment"),
    "flat": (4, 5, "apartment"),
    "office": (10, 4, "office"),
    "residence": (24, 1, "apartment"),
}
"""Number of rooms, seed and kind of each scene."""


def main(names: Annotated[tuple[str, ...], tyro.conf.Positional] = tuple(SCENES), out: Path = Path("scenes")) -> None:
    """Make scenes.

    Args:
        names: Which of them; all by default.
        out: The folder to put them into.
    """
    unknown = [name for name in names if name not in SCENES]
    if unknown:
        raise SystemExit(f"There is no generated scene {unknown[0]!r}: give some of {', '.join(SCENES)}.")
    for name in names:
        scene = generate_scene(out / name, *SCENES[name], name=name)
        size_mib = sum(file.stat().st_size for file in scene.folder.rglob("*") if file.is_file()) / 2**20
        print(f"{scene.folder}: {scene.rooms} rooms, {scene.num_triangles} triangles, {size_mib:.1f} MiB")


if __name__ == "__main__":
    run_script(main)
