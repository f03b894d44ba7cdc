"""Changes of one file, for cases of several kinds."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path


def write(name: str, content: bytes, folder: Path) -> None:
    """Give a file other content."""
    (folder / name).write_bytes(content)


def last(path: str) -> str:
    """The end of a path, for a label."""
    return path if len(path) < 40 else "…" + path[-25:]


def as_it_is(folder: Path) -> None:
    """Change nothing."""
    del folder


def arrays_of(name: str, make: Callable[[Path, tuple[str, ...]], None], names: tuple[str, ...], folder: Path) -> None:
    """Put other arrays into the place of an archive."""
    make(folder / name, names)


def link_out(name: str, target: Path, folder: Path) -> None:
    """Put a link to something outside into the place of a file."""
    (folder / name).unlink(missing_ok=True)
    (folder / name).symlink_to(target)


def moved_out(name: str, folder: Path) -> None:
    """A folder of a run that lies elsewhere, with a link in its place."""
    target = folder / "elsewhere"
    (folder / name).rename(target)
    (folder / name).symlink_to(target)


def entry(name: str, key: str, value: object, folder: Path) -> None:
    """Change an entry of a JSON file."""
    path = folder / name
    path.write_text(json.dumps({**json.loads(path.read_text()), key: value}))


def nested_entry(name: str, group: str, key: str, value: object, folder: Path) -> None:
    """Change an entry of a group of a JSON file."""
    path = folder / name
    values = json.loads(path.read_text())
    holder = values
    for part in group.split("."):
        holder = holder[part]
    holder[key] = value
    path.write_text(json.dumps(values))


def before(name: str, mark: str, text: str, folder: Path) -> None:
    """Put text before a mark."""
    path = folder / name
    path.write_text(path.read_text().replace(mark, text + mark))


def replaced(name: str, mark: str, text: str, folder: Path) -> None:
    """Put text into the place of a mark."""
    path = folder / name
    path.write_text(path.read_text().replace(mark, text))
