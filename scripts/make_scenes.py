"""Makes the scenes that come with the project anew.

Run it from the repository root: ``python scripts/make_scenes.py`` makes all of scenes/, with names after it only those.
The house takes a minute and needs embreex; the others take seconds.
"""

from pathlib import Path
from typing import Annotated

import tyro

from anm_mj.scene.builtin import OWN_SCENES, make_own_scene


def main(
    names: Annotated[tuple[str, ...], tyro.conf.Positional] = tuple(OWN_SCENES), out: Path = Path("scenes")
) -> None:
    """Make scenes.

    Args:
        names: Which of them; all by default.
        out: The folder to put them into.
    """
    for name in names:
        scene = make_own_scene(name, out / name)
        size_mib = sum(file.stat().st_size for file in scene.folder.rglob("*") if file.is_file()) / 2**20
        print(f"{scene.folder}: {scene.rooms} rooms, {scene.num_triangles} triangles, {size_mib:.1f} MiB")


if __name__ == "__main__":
    tyro.cli(main)
