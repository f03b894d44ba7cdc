"""The file of a neural map: arrays and settings without any code in them, in the safetensors format.

Older versions wrote a ``torch.save`` archive, which stays readable; torch then reads numbers only.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct

from anm_mj.errors import MapError
from anm_mj.mapping.mapping_config import MappingConfig, config_from_dict
from anm_mj.utils.files import write_tensors
from anm_mj.utils.read_file import convert, parse_json, read_tensors

FORMAT = "anm-mj map 3"
"""Marks a map of ours, and its version."""
FORMER_FORMAT = "anm-mj map 2"
"""The same of the archives that torch wrote."""
FORMER_SUFFIX = ".pt"
_KEY = "anm_mj"
"""The only entry of the file's metadata, a JSON object: several entries would come in any order, so the same map would
give other bytes."""


@dataclass(frozen=True)
class SavedMap:
    """What a file holds of a map."""

    config: MappingConfig
    seed: int
    num_frames: int
    arrays: dict[str, np.ndarray]
    """``field.*``, the parameters of the field, and ``occupancy.*``, the voxel grid in log-odds."""


class _About(Struct):
    """What a file says of its map."""

    config: dict[str, Any]
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)]
    num_frames: Annotated[int, Meta(ge=0, le=10**9)]


def write_map(path: Path, saved: SavedMap) -> None:
    """Write a map.

    Raises:
        OSError: The file cannot be written.
    """
    about = {
        "format": FORMAT,
        "config": asdict(saved.config),
        "seed": saved.seed,
        "num_frames": saved.num_frames,
    }
    # Unlike ascontiguousarray, this keeps arrays without axes as they are.
    arrays = {name: np.asarray(value, order="C") for name, value in saved.arrays.items()}
    write_tensors(path, arrays, {_KEY: json.dumps(about)})


def read_map(path: Path) -> SavedMap:
    """Read a map.

    Raises:
        MapError: The file is missing or is no map.
    """
    if not path.is_file():
        raise MapError(f"There is no map at {path}; give the map.safetensors of a run folder.")
    about, arrays = _read_archive(path) if path.suffix == FORMER_SUFFIX else _read_safetensors(path)
    try:
        facts = convert(about, _About)
    except ValueError as err:
        raise MapError(f"{path} is damaged ({err}); explore anew.") from err
    for name, array in arrays.items():
        # How far a voxel was seen from may be infinite.
        numbers = array.dtype.kind in "fiub"
        if not numbers or (name.startswith("field.") and not np.isfinite(array).all()):
            raise MapError(f"{path} is damaged: {name} holds what are no finite numbers; explore anew.")
    return SavedMap(config_from_dict(facts.config), facts.seed, facts.num_frames, arrays)


def _read_safetensors(path: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    try:
        facts, arrays = read_tensors(path)
        about = parse_json(facts.get(_KEY, "{}"))
    except (OSError, ValueError) as err:
        raise _unreadable(path) from err
    _require_format(path, about, FORMAT)
    return about, arrays


def _read_archive(path: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    import pickle

    import torch

    try:
        saved: Any = torch.load(path, map_location="cpu", weights_only=True)
    except (RuntimeError, ValueError, EOFError, OSError, pickle.UnpicklingError) as err:
        raise _unreadable(path) from err
    _require_format(path, saved, FORMER_FORMAT)
    return saved, {name: value.numpy() for name, value in saved["arrays"].items()}


def _unreadable(path: Path) -> MapError:
    return MapError(f"{path} cannot be read as a map; give the map.safetensors of a run folder.")


def _require_format(path: Path, about: Any, wanted: str) -> None:
    """Raise a MapError unless a file says that it holds a map of the wanted format."""
    if not isinstance(about, dict) or about.get("format") != wanted:
        found = about.get("format") if isinstance(about, dict) else type(about).__name__
        raise MapError(f"{path} holds {found!r}, not {wanted!r}; it was written by another program or version.")
