"""All cases: a changed copy of a good input, and the command that reads it."""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np

from tests.corpus import hostile
from tests.corpus.arrays import damaged_checkpoint, damaged_npz, damaged_safetensors
from tests.corpus.changes import write
from tests.corpus.commands import READERS_OF, commands
from tests.corpus.damage import damaged_bytes, damaged_json, damaged_numbers, damaged_values

TEXT = (
    ".obj",
    ".txt",
    ".yaml",
    ".gltf",
    ".dae",
    ".world",
    ".urdf",
    ".sdf",
    ".mtl",
    ".xml",
    ".toml",
    ".json",
    ".jsonl",
    ".tum",
    ".csv",
    ".traj",
    ".pincam",
    ".freiburg",
    ".log",
)
ARRAYS = {".npz": damaged_npz, ".safetensors": damaged_safetensors, ".checkpoint": damaged_checkpoint}
_FIRST_ONLY = (
    *("depth", "images", "plans", "rgb", "results", "color", "pose", "confidence", "cameras"),
    *("lowres_wide", "lowres_depth", "lowres_wide_intrinsics"),
)
"""Of the files in such folders the first is damaged."""
_WRITTEN_ONLY = ("topdown.png", "curve.png", "trajectory.tum")
"""Files of a run that no command reads."""


@dataclass(frozen=True)
class Case:
    """One input and what reads it."""

    name: str
    kind: str
    """Which of the good inputs is copied; its folder becomes ``in``."""
    change: Callable[[Path], None]
    """Changes the copy."""
    argv: tuple[str, ...]
    """Words of the command line; the working directory holds ``in``, and ``out`` is for what it makes."""


def damaged_cases(paths: dict[str, Path], seed: int, per_file: int) -> Iterator[Case]:
    """Damage to every file of every input; its readers take turns."""
    for kind, path in paths.items():
        rng = np.random.default_rng([seed, *kind.encode()])
        root = path if path.is_dir() else path.parent
        below = root.parent if path.is_dir() else root
        readers = commands(kind, paths)
        for file in _damaged_files(root):
            name = str(file.relative_to(below))
            places = (
                ("missing", Path.unlink),
                ("a FIFO", hostile.fifo),
                ("a device", hostile.device),
                ("a folder", hostile.folder),
                ("a link to itself", hostile.loop),
            )
            # One by one: all contents together would fill the memory.
            contents = ((label, partial(write, name, changed)) for label, changed in _changes(file, rng, per_file))
            cases = chain(contents, ((label, partial(_placed, name, place)) for label, place in places))
            turns = READERS_OF.get(file.name, range(len(readers))) if kind == "run" else range(len(readers))
            for number, (label, change) in enumerate(cases):
                argv = readers[turns[number % len(turns)]]
                verb = f" ({' '.join(word for word in argv if word.startswith('--'))[:40]})" if len(readers) > 1 else ""
                yield Case(f"{kind}: {name}: {label}: {argv[0]}{verb}", kind, change, argv)


def _damaged_files(root: Path) -> list[Path]:
    files = sorted(file for file in root.rglob("*") if file.is_file() and file.name not in _WRITTEN_ONLY)
    first = {folder: min(folder.iterdir()) for folder in {file.parent for file in files} if folder.name in _FIRST_ONLY}
    return [file for file in files if first.get(file.parent, file) == file]


def _changes(file: Path, rng: np.random.Generator, per_file: int) -> Iterator[tuple[str, bytes]]:
    """Other contents of a file, each with a label."""
    content = file.read_bytes()
    yield from damaged_bytes(content, rng, flips=per_file)
    text = content.decode(errors="replace")
    if file.suffix in TEXT:
        yield from damaged_numbers(text, rng, per_file)
    if file.suffix in (".json", ".gltf"):
        yield from damaged_json(text, rng, 4 * per_file)
    if file.suffix == ".jsonl":
        first, _, rest = text.partition("\n")
        for label, line in damaged_json(first, rng, 3 * per_file):
            yield label, line + b"\n" + rest.encode()
    if file.suffix == ".toml":
        for label, value in damaged_values(tomllib.loads(text), rng, 5 * per_file):
            yield label, _toml(value)
    if file.suffix in ARRAYS:
        yield from ARRAYS[file.suffix](content, rng, 2 * per_file)


def _placed(name: str, place: Callable[[Path], None], folder: Path) -> None:
    place(folder / name)


def _toml(value: object) -> bytes:
    """A value as TOML, as far as TOML can say it."""
    if not isinstance(value, dict):
        return repr(value).encode()
    return "".join(f"{key} = {_toml_value(entry)}\n" for key, entry in value.items()).encode()


def _toml_value(value: object) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f'"{key}" = {_toml_value(entry)}' for key, entry in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_toml_value, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"').replace("\0", "\\u0000") + '"'
    return "none" if value is None else repr(value)


def prepare(case: Case, good: dict[str, Path], folder: Path) -> None:
    """Put the changed input into ``folder/in``."""
    source = good[case.kind]
    shutil.copytree(source.parent, folder / "in", symlinks=True)
    case.change(folder / "in")
