"""The file of a neural map: arrays and settings without any code in them, in the safetensors format."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct

from anm_mj.errors import MapError
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.field import Field
from anm_mj.mapping.mapping_config import MappingConfig, config_from_dict
from anm_mj.utils.files import write_tensors
from anm_mj.utils.read_file import convert, parse_json, read_tensors

FORMAT = "anm-mj map 3"
"""Marks a map of ours, and its version."""
_KEY = "anm_mj"
"""The only entry of the file's metadata, a JSON object: several entries would come in any order, so the same map would
give other bytes."""


@dataclass(frozen=True)
class SavedMap:
    """What a file holds of a map."""

    config: MappingConfig
    seed: int
    num_frames: int
    parameters: dict[str, np.ndarray]
    """Of the field, by name; ``field.*`` in the file."""
    occupancy: dict[str, np.ndarray]
    """As :meth:`anm_mj.mapping.depth_occupancy.DepthOccupancy.arrays` has it; ``occupancy.*`` in the file."""

    @classmethod
    def of(cls, field: Field, by_depth: DepthOccupancy) -> SavedMap:
        """A map as it is now; arrays of the occupancy are views."""
        return cls(field.config, field.seed, field.num_frames, field.finite_parameters(), by_depth.arrays())

    def fill(self, field: Field, by_depth: DepthOccupancy) -> None:
        """Put everything into new parts of a map. Raises MapError if it is not what the
        configuration says, or damaged.
        """
        try:
            field.backend.set_parameters(self.parameters)
            by_depth.set_arrays(self.occupancy)
        except (ValueError, KeyError) as err:
            raise MapError(f"The saved map is damaged ({err}); explore again.") from err
        schedule = self.config.schedule
        trains = max(schedule.first_iterations, schedule.iterations, schedule.final_iterations) > 0
        # Of frames without any depth nothing was learnt, and they do not count.
        field.is_trained = trains and self.num_frames > 0
        field.num_frames = self.num_frames


class _About(Struct):
    """What a file says of its map."""

    config: dict[str, Any]
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)]
    num_frames: Annotated[int, Meta(ge=0, le=2**63 - 1)]


def write_map(path: Path, saved: SavedMap) -> None:
    """Write a map. Raises OSError if the file cannot be written."""
    about = {"format": FORMAT, "config": asdict(saved.config), "seed": saved.seed, "num_frames": saved.num_frames}
    parts = {"field": saved.parameters, "occupancy": saved.occupancy}
    # Unlike ascontiguousarray, asarray keeps arrays without axes as they are.
    arrays = {
        f"{part}.{name}": np.asarray(value, order="C") for part, held in parts.items() for name, value in held.items()
    }
    write_tensors(path, arrays, {_KEY: json.dumps(about)})


def read_map(path: Path) -> SavedMap:
    """Read a map. Raises MapError if the file is missing or is no map."""
    if not path.is_file():
        raise MapError(f"There is no map at {path}; give the map.safetensors of a run folder.")
    try:
        facts, arrays = read_tensors(path)
        said = parse_json(facts.get(_KEY, "{}"))
    except (OSError, ValueError) as err:
        raise MapError(f"{path} cannot be read as a map; give the map.safetensors of a run folder.") from err
    if not isinstance(said, dict) or said.get("format") != FORMAT:
        found = said.get("format") if isinstance(said, dict) else type(said).__name__
        raise MapError(f"{path} holds {found!r}, not {FORMAT!r}; it was written by another program or version.")
    try:
        about = convert(said, _About)
    except ValueError as err:
        raise MapError(f"{path} is damaged ({err}); explore again.") from err
    parts: dict[str, dict[str, np.ndarray]] = {"field": {}, "occupancy": {}}
    for name, array in arrays.items():
        part, _, inner = name.partition(".")
        # How far a voxel was seen from may be infinite.
        if array.dtype.kind not in "fiub" or (part == "field" and not np.isfinite(array).all()):
            raise MapError(f"{path} is damaged: {name} holds what are no finite numbers; explore again.")
        parts.setdefault(part, {})[inner] = array
    config = config_from_dict(about.config)
    return SavedMap(config, about.seed, about.num_frames, parts["field"], parts["occupancy"])
