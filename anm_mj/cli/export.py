"""``anm-mj export``: a film of a finished run, and files that other tools read."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from anm_mj.cli.option_types import place
from anm_mj.export.formats import FORMATS

if TYPE_CHECKING:
    from rich.console import Console


def add_export(commands: Any) -> None:
    """Add ``export`` to the commands of the program."""
    export = commands.add_parser("export", help="write a finished run as a film, or for other tools")
    export.add_argument("run", type=Path, metavar="RUN", help="a run folder")
    export.add_argument(
        "--format",
        action="append",
        default=[],
        dest="formats",
        metavar="NAME",
        help="; ".join(f"{name}: {entry.words}" for name, entry in FORMATS.items()) + "; all. May be repeated",
    )
    export.add_argument("--out", type=place, metavar="DIR", help="folder of --format (default: RUN/export)")
    export.add_argument("--video", type=Path, metavar="FILE", help="a film, film.mp4 or film.gif")
    export.add_argument("--fps", type=float, default=15.0, help="steps per second of the film (default: 15)")
    export.add_argument("--every", type=int, default=1, metavar="N", help="show every Nth step only (default: 1)")
    export.add_argument(
        "--scene", metavar="SCENE", help="name or folder of the run's scene, if it kept no images and has moved"
    )
    export.set_defaults(command=_export)


def _export(parsed: argparse.Namespace) -> int:
    from anm_mj.cli.bar import progress_bar
    from anm_mj.cli.console import PlainConsole
    from anm_mj.config import ConfigError

    if parsed.video is None and not parsed.formats:
        raise ConfigError("Nothing to export; name a film by --video film.mp4, or a format, as in --format glb.")
    console = PlainConsole()
    if parsed.formats:
        from anm_mj.export.formats import export_run

        with progress_bar(console, "export") as on_progress:
            written = export_run(
                parsed.run, parsed.formats, parsed.out, lambda name, done, total: on_progress(done, total)
            )
        for path in written:
            _say(console, path)
    if parsed.video is not None:
        from anm_mj.replay.film import write_film
        from anm_mj.replay.timeline import read_timeline

        with progress_bar(console, "film") as on_progress:
            write_film(
                read_timeline(parsed.run),
                parsed.video,
                fps=parsed.fps,
                every=parsed.every,
                scene=parsed.scene,
                on_progress=on_progress,
            )
        _say(console, parsed.video)
    return 0


def _say(console: Console, path: Path) -> None:
    size = (
        path.stat().st_size
        if path.is_file()
        else sum(each.stat().st_size for each in path.rglob("*") if each.is_file())
    )
    amount = f"{size / 1e6:.1f} MB" if size >= 1e5 else f"{size / 1e3:.1f} kB"
    console.print(f"Wrote {path} ({amount}).", highlight=False, soft_wrap=True)
