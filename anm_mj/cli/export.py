"""``anm-mj export``: a film of a finished run, and files that other tools read."""

from argparse import ArgumentTypeError
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

from anm_mj.cli.command_line import Option
from anm_mj.cli.option_types import Count, NewFile, NewFolder, refuse_idle
from anm_mj.errors import ConfigError


def _formats() -> Iterator[str]:
    from anm_mj.export.formats import FORMATS

    yield from (f"{name} ({entry.words})" for name, entry in FORMATS.items())
    yield "all"


def _start(text: str) -> float:
    from anm_mj.export.wall_clock import parse_start

    try:
        return parse_start(text)
    except ValueError:
        raise ArgumentTypeError(f"{text!r} is no time; give 2026-05-01T09:30, or seconds since 1970") from None


def export(
    run: Path,
    *,
    formats: Annotated[Sequence[str], Option("--format NAME", names=_formats)] = (),
    out: NewFolder | None = None,
    video: NewFile | None = None,
    fps: float | None = None,
    every: Count | None = None,
    scene: str | None = None,
    start: Annotated[float | None, Option("TIME", _start)] = None,
) -> int:
    """Write a finished run as a film, or for other tools.

    Args:
        run: a run folder
        formats: for other tools; may be repeated
        out: folder of --format; by default RUN/export
        video: a film, film.mp4 or film.gif
        fps: pictures per second of the film, at most 120, of a GIF 50 (default: 15)
        every: show every Nth step and the last only (default: 1)
        scene: name or folder of the run's scene, if it kept no images and has moved
        start: when the run began, for rosbag: 2026-05-01T09:30 (UTC), seconds since 1970, or 0 to count from its start;
            by default when it was made
    """
    from anm_mj.cli.console import PlainConsole, progress_bar

    if video is None and not formats:
        raise ConfigError("Nothing to export; name a film by --video film.mp4, or a format, as in --format glb.")
    film = {name: value for name, value in {"fps": fps, "every": every, "scene": scene}.items() if value is not None}
    if video is None:
        refuse_idle({f"--{name}": value for name, value in film.items()}, "no film is written; add --video film.mp4")
    if not formats:
        refuse_idle({"--out": out, "--start": start}, "no other format is written; add --format NAME")
    console = PlainConsole()
    timeline = None
    if video is not None:
        from anm_mj.replay.pictures import kept_images
        from anm_mj.replay.timeline import read_timeline

        timeline = read_timeline(run)
        if kept_images(timeline.run):
            refuse_idle({"--scene": scene}, "the film shows the images that were kept; leave it out")
    if formats:
        from anm_mj.export.formats import FORMATS, export_run

        if all(name in FORMATS and not FORMATS[name].timed for name in formats):
            refuse_idle({"--start": start}, "no chosen format has times of day; add --format rosbag")
        with progress_bar(console, "export") as on_progress:
            written = export_run(run, formats, out, lambda name, done, total: on_progress(done, total), start)
        console.say(*map(_written, written))
    if video is not None and timeline is not None:
        from anm_mj.replay.film import write_film

        with progress_bar(console, "film") as on_progress:
            write_film(timeline, video, **film, on_progress=on_progress)
        console.say(_written(video))
    return 0


def _written(path: Path) -> str:
    files = [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]
    size = sum(file.stat().st_size for file in files)
    amount = f"{size / 1e6:.1f} MB" if size >= 1e5 else f"{size / 1e3:.1f} kB"
    return f"Wrote {path} ({amount})."
