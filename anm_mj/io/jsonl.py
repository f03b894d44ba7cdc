"""Text files that grow by a line at a time and are whole up to the last line, whatever ends the run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from anm_mj.errors import RunFolderError
from anm_mj.io.to_json import to_json


class LineWriter:
    """Appends lines to a new file and hands each to the system at once.

    Raises:
        RunFolderError: The file cannot be made or written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._file = path.open("w", encoding="utf-8", newline="\n")
        except OSError as err:
            raise self._error(err) from err

    def line(self, text: str) -> None:
        """Append a line of text."""
        try:
            self._file.write(text + "\n")
            self._file.flush()
        except OSError as err:
            raise self._error(err) from err

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

    def _error(self, err: OSError) -> RunFolderError:
        return RunFolderError(f"{self._path} cannot be written ({err.strerror}); free some space or choose another.")


def read_json_lines(path: Path) -> list[dict[str, Any]]:
    """All whole lines of a file; a last line that a killed run left unfinished is left out.

    Raises:
        RunFolderError: A line before the last is not JSON.
    """
    lines = path.read_text(encoding="utf-8", errors="replace").split("\n")
    values = []
    for number, line in enumerate(lines, start=1):
        try:
            if line:
                values.append(json.loads(line))
        except json.JSONDecodeError as err:
            if number == len(lines):
                break
            raise RunFolderError(f"{path}, line {number}, is not JSON ({err.msg}); copy the run again.") from err
    return values
