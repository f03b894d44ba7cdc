"""Any of our values as plain JSON: dataclasses, enums, paths, arrays; what is not finite becomes null."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from anm_mj.errors import RunFolderError


def to_json(value: object) -> Any:
    """The value in dicts, lists, strings, numbers and None; whole numbers stay whole, floats keep every digit."""
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
    """Write a value to a file, whole or not at all.

    Raises:
        RunFolderError: The file cannot be written.
    """
    unfinished = path.with_name(path.name + ".part")
    try:
        unfinished.write_text(json.dumps(to_json(value), indent=2) + "\n", encoding="utf-8")
        os.replace(unfinished, path)
    except OSError as err:
        raise RunFolderError(f"{path} cannot be written ({err.strerror}); free some space or choose another.") from err
