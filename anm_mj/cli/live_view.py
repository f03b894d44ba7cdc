"""The live page of a command that goes on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from anm_mj.cli.progress import Interrupt
from anm_mj.events import Observer


@contextmanager
def live_view(title: str | None, port: int | None, interrupt: Interrupt) -> Iterator[list[Observer]]:
    """Show the page while the block runs.

    Args:
        title: Of the page; None = no page.
        port: The first to try; None = the first that is usual.
        interrupt: Knows whether the user has asked for the end elsewhere.

    Yields:
        The page as an observer; nothing without one.
    """
    if title is None:
        yield []
        return
    from anm_mj.viz.meshcat_viewer import MeshcatViewer

    viewer = MeshcatViewer(port=port, title=title, is_ending=lambda: interrupt.is_requested)
    try:
        yield [viewer]
    finally:
        viewer.close()
