"""Makes the film and the pictures of the README again, all from one run in a scene of ours.

python scripts/gallery.py docs
"""

import shutil
import subprocess
from pathlib import Path
from typing import Annotated

import tyro

from anm_mj.cli.command_line import run_script
from anm_mj.config import make_config
from anm_mj.replay.film import write_film
from anm_mj.replay.page import replay_page
from anm_mj.replay.timeline import read_timeline
from anm_mj.run import run


def main(
    out: Annotated[Path, tyro.conf.Positional],
    scene: str = "home",
    steps: int = 500,
    seed: int = 0,
    every: int = 14,
    reality: str = "real",
    existing: Path | None = None,
) -> None:
    """Explore, then write film.gif, curve.png and topdown.png, and where Chromium is replay.png.

    Args:
        out: folder of the pictures.
        scene: name or folder of a scene.
        steps: budget of the run.
        seed: of map and policy.
        every: steps between two frames of the film.
        reality: the world of the run, as of anm-mj explore.
        existing: a run folder to take instead of exploring.
    """
    folder = existing
    if folder is None:
        folder = run(make_config("default", [], scene=scene, steps=steps, seed=seed, reality=reality))[0].path
    out.mkdir(parents=True, exist_ok=True)
    write_film(read_timeline(folder), out / "film.gif", fps=6.0, every=every)
    for name in ("curve.png", "topdown.png"):
        shutil.copyfile(folder / name, out / name)
    if shutil.which("chromium"):
        _screenshot(folder, out / "replay.png")
    size = sum((out / name).stat().st_size for name in ("film.gif", "curve.png", "topdown.png"))
    print(f"Wrote film.gif, curve.png and topdown.png to {out} from {folder} ({size / 1e6:.1f} MB).")


def _screenshot(run_folder: Path, path: Path) -> None:
    """The replay of a run as a browser shows it."""
    page = path.resolve().with_suffix(".html")
    page.write_text(replay_page(read_timeline(run_folder)), encoding="utf-8")
    words = "--headless --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --hide-scrollbars"
    words += " --window-size=1280,800 --virtual-time-budget=8000"
    subprocess.run(
        ["chromium", *words.split(), f"--screenshot={path}", page.as_uri()], check=True, stderr=subprocess.DEVNULL
    )
    page.unlink()


if __name__ == "__main__":
    run_script(main)
