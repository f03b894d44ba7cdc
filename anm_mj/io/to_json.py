"""Dataclasses, enums, paths and arrays as plain JSON; NaN and infinity become null."""

import dataclasses
import json
import math
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from anm_mj.io.write import writing
from anm_mj.utils.files import write_text


def to_json(value: object) -> Any:
    """A value as dicts, lists, strings, numbers and None; integers stay integers, floats keep every digit."""
    # What most of a log is made of comes first: the other questions cost more.
    if type(value) is float:
        return value if math.isfinite(value) else None
    if type(value) is str or type(value) is int:
        return value
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: to_json(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Enum):
        return to_json(value.value)
    if isinstance(value, Mapping):
        return {str(key): to_json(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return to_json(value.tolist())
    if isinstance(value, list | tuple | set | frozenset):
        return [to_json(item) for item in (sorted(value) if isinstance(value, set | frozenset) else value)]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    return str(value)


def write_json(path: Path, value: object) -> None:
    """Write a value as JSON, whole or not at all. Raises RunFolderError if the file cannot be written."""
    with writing(path):
        write_text(path, json.dumps(to_json(value), indent=2) + "\n")
