"""Text files written line by line: a killed run keeps every complete line."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from anm_mj.errors import RunFolderError
from anm_mj.io.to_json import to_json
from anm_mj.io.write import reading, writing
from anm_mj.utils.read_file import parse_json, read_bytes


class LineWriter:
    """Appends lines to a file and flushes after each: to a new one, or, with ``goes_on``, to what there is. Raises
    RunFolderError if the file cannot be made or written.
    """

    def __init__(self, path: Path, *, goes_on: bool = False) -> None:
        self.path = path
        self._failed = False
        with writing(path):
            # What is there may have been put there by anybody: a link to another file is not followed.
            flags = os.O_WRONLY | os.O_NOFOLLOW | os.O_CREAT | (os.O_APPEND if goes_on else os.O_TRUNC)
            self._file = os.fdopen(os.open(path, flags, 0o666), "w", encoding="utf-8", newline="\n")

    def cut(self, size: int) -> None:
        """Cut what there is to a length, before the first line [bytes]."""
        with writing(self.path):
            os.truncate(self._file.fileno(), size)

    @property
    def size(self) -> int:
        """Length of all complete lines [bytes]."""
        return os.fstat(self._file.fileno()).st_size

    def line(self, text: str) -> None:
        """Append a line of text."""
        self._failed = True
        with writing(self.path):
            self._file.write(text + "\n")
            self._file.flush()
        self._failed = False

    def json(self, value: object) -> None:
        """Append a value as one line of JSON."""
        self.line(json.dumps(to_json(value)))

    def close(self) -> None:
        """Close the file; a second time does nothing. Raises RunFolderError where this fails, but for the sake of a
        line whose error was raised already.
        """
        with suppress(OSError) if self._failed else writing(self.path):
            self._file.close()

    def __enter__(self) -> LineWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def read_jsonl(path: Path) -> list[dict[str, Any]]:
    """All complete lines of a file; an incomplete last line, as a killed run leaves it, is skipped. Raises
    RunFolderError if the file cannot be read, or a line before the last is not JSON.
    """
    with reading(path, remedy="copy the run again"):
        lines = read_bytes(path).decode("utf-8", errors="replace").split("\n")
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
