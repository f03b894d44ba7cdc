"""``anm-mj view``: the replay of a finished run in the browser."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from anm_mj.cli.option_types import place, port

if TYPE_CHECKING:
    from rich.console import Console


def add_view(commands: Any) -> None:
    """Add ``view`` to the commands of the program."""
    view = commands.add_parser(
        "view",
        help="replay a finished run in the browser, or as one HTML file",
        epilog="The page needs no network. To watch a run while it goes on: anm-mj explore SCENE --view.",
    )
    view.add_argument("run", type=Path, metavar="RUN", help="a run folder")
    view.add_argument(
        "--export-html", type=place, metavar="FILE", help="write the page to a file instead of showing it"
    )
    view.add_argument("--port", type=port, help="first port to try (default: 7000)")
    view.add_argument("--no-browser", action="store_true", help="print the address only")
    view.add_argument(
        "--scene",
        metavar="SCENE",
        help="name or folder of the run's scene, if it kept no images and the scene has moved",
    )
    view.set_defaults(command=_view)


def _view(parsed: argparse.Namespace) -> int:
    from anm_mj.cli.bar import progress_bar
    from anm_mj.cli.console import PlainConsole
    from anm_mj.io.write import writing
    from anm_mj.replay.page import replay_page
    from anm_mj.replay.timeline import read_timeline
    from anm_mj.utils.files import write_text

    console = PlainConsole()
    timeline = read_timeline(parsed.run)
    with progress_bar(console, "reading the run") as on_progress:
        page = replay_page(timeline, parsed.scene, on_progress)
    if parsed.export_html is not None:
        with writing(parsed.export_html):
            write_text(parsed.export_html, page)
        console.print(f"Wrote {parsed.export_html} ({len(page) / 1e6:.1f} MB).", highlight=False, soft_wrap=True)
        return 0
    _show(console, page, parsed.port, browser=not parsed.no_browser)
    return 0


def _show(console: Console, page: str, port: int | None, *, browser: bool) -> None:
    """Serve the page until Ctrl-C."""
    import webbrowser

    from anm_mj.viz.file_server import FIRST_PORT, FileServer

    with FileServer(page.encode(), FIRST_PORT if port is None else port) as server:
        console.print(f"The replay is at {server.url}; Ctrl-C ends.", highlight=False, soft_wrap=True)
        if browser:
            webbrowser.open(server.url)
        try:
            server.wait()
        except KeyboardInterrupt:
            return
