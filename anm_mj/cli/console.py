"""Consoles of the command line, on which no file of others commands the terminal."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.text import Text


class PlainConsole(Console):
    """A console that takes no markup from texts and prints characters that would command the terminal as escapes."""

    def __init__(self, *, stderr: bool = False) -> None:
        super().__init__(stderr=stderr, markup=False)

    def render_str(self, text: str, **options: Any) -> Text:
        """What is printed for a text, alone or in a cell of a table."""
        return super().render_str(printable(text), **options)


def printable(text: str) -> str:
    """A text in which no character commands the terminal: files of others may name anything anyhow."""
    return "".join(c if c.isprintable() or c == "\n" else repr(c)[1:-1] for c in text)
