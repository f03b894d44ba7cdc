"""``anm-mj view``: the replay of a finished run in the browser."""

from contextlib import closing, suppress
from pathlib import Path

from anm_mj.cli.option_types import NewFile, Port, refuse_idle


def view(
    run: Path,
    other: Path | None = None,
    *,
    export_html: NewFile | None = None,
    port: Port | None = None,
    no_browser: bool = False,
    scene: str | None = None,
) -> int:
    """Replay a finished run in the browser, or as one HTML file.

    The page needs no network. To watch a run while it goes on: anm-mj explore SCENE --view.

    Args:
        run: a run folder
        other: a second one, to be shown beside the first: step and view move together
        export_html: write the page to a file instead of showing it
        port: first port to try; by default 7000
        no_browser: print the address only
        scene: name or folder of the run's scene, if it kept no images and the scene has moved
    """
    import webbrowser

    from anm_mj.cli.console import PlainConsole, progress_bar
    from anm_mj.io.write import writing
    from anm_mj.replay.page import pair_page, replay_page
    from anm_mj.replay.pictures import kept_images
    from anm_mj.replay.timeline import read_timeline
    from anm_mj.utils.files import write_text
    from anm_mj.viz.page_server import FIRST_PORT, PageServer

    if export_html is not None:
        refuse_idle({"--port": port, "--no-browser": no_browser}, "the page becomes a file; leave out --export-html")
    console = PlainConsole()
    timelines = [read_timeline(path) for path in (run, other) if path is not None]
    if all(kept_images(timeline.run) for timeline in timelines):
        refuse_idle({"--scene": scene}, "the images that were kept are shown; leave it out")
    pages = []
    for timeline in timelines:
        with progress_bar(console, f"reading {timeline.run.folder.path.name}") as on_progress:
            pages.append(replay_page(timeline, scene, on_progress))
    titles = [timeline.title for timeline in timelines]
    page = pages[0] if other is None else pair_page(titles, pages)
    if export_html is not None:
        with writing(export_html):
            write_text(export_html, page)
        console.say(f"Wrote {export_html} ({len(page) / 1e6:.1f} MB).")
        return 0
    with closing(PageServer(port or FIRST_PORT, page)) as server:
        console.say(f"The replay is at {server.url} (Ctrl-C ends).")
        if not no_browser:
            webbrowser.open(server.url)
        with suppress(KeyboardInterrupt):
            server.wait()
    return 0
