"""Text files written line by line: a killed run keeps every complete line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from anm_mj.errors import RunFolderError
from anm_mj.io.to_json import to_json
from anm_mj.io.write import writing
from anm_mj.utils.read_file import parse_json, read_bytes


class LineWriter:
    """Appends lines to a new file and flushes after each.

    Raises:
        RunFolderError: The file cannot be made or written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        with writing(path):
            self._file = path.open("w", encoding="utf-8", newline="\n")

    def line(self, text: str) -> None:
        """Append a line of text."""
        with writing(self._path):
            self._file.write(text + "\n")
            self._file.flush()

    def json(self, value: object) -> None:
        """Append a value as one line of JSON."""
        self.line(json.dumps(to_json(value)))

    def close(self) -> None:
        """Close the file; a second time does nothing."""
        self._file.close()

    def __enter__(self) -> LineWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def read_jsonl(path: Path) -> list[dict[str, Any]]:
    """All complete lines of a file; an incomplete last line, as a killed run leaves it, is skipped.

    Raises:
        RunFolderError: The file cannot be read, or a line before the last is not JSON.
    """
    try:
        lines = read_bytes(path).decode("utf-8", errors="replace").split("\n")
    except (OSError, ValueError) as err:
        raise RunFolderError(f"{path} cannot be read ({err}); copy the run again.") from err
    values = []
    for number, line in enumerate(lines, start=1):
        try:
            if line:
                values.append(parse_json(line))
        except ValueError as err:
            if number == len(lines):
                break
            raise RunFolderError(f"{path}, line {number}, is not JSON ({err}); copy the run again.") from err
    return values
