"""``explored.safetensors``: what a later run needs beside the map to go on from a run.

Numbers only, in the safetensors format: pixels of keyframes to replay, where the robot was, where it collided, and what
its policy remembered.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from anm_mj.errors import RunFolderError
from anm_mj.io.camera_checks import FARTHEST_M
from anm_mj.io.sequence import require_count
from anm_mj.io.write import reading, writing
from anm_mj.types import ExploredState
from anm_mj.utils.files import atomic_write, write_tensors
from anm_mj.utils.read_file import array_of, parse_json, read_tensors

FORMAT = "anm-mj explored 1"
"""Marks such a file, and its version."""
_KEY = "anm_mj"
_REPLAY, _MEMORY = "replay.", "memory."


@dataclass(frozen=True)
class Explored:
    """The content of the file."""

    prior: ExploredState
    replay: dict[str, np.ndarray]
    """Keyframes, as :meth:`anm_mj.mapping.keyframes.Keyframes.arrays` gives them."""


def write_explored(path: Path, explored: Explored) -> None:
    """Write the file, whole or not at all. Raises RunFolderError if it cannot be written."""
    prior = explored.prior
    arrays = {"poses": prior.poses, "refused": prior.collisions}
    arrays |= {f"{_REPLAY}{name}": value for name, value in explored.replay.items()}
    arrays |= {f"{_MEMORY}{name}": value for name, value in prior.memory.items()}
    about = {"format": FORMAT, "policy": prior.policy}
    arrays = {name: np.asarray(value, order="C") for name, value in arrays.items()}
    with writing(path), atomic_write(path) as partial:
        write_tensors(partial, arrays, {_KEY: json.dumps(about)})


def read_explored(path: Path) -> Explored:
    """Read the file. Raises RunFolderError if it is missing, damaged, or of another version."""
    if not path.is_file():
        raise RunFolderError(
            f"{path.parent} has no {path.name}, without which no run goes on from it: it was killed (anm-mj explore "
            "--resume ends it), it recorded none (record.replay_bytes=0), or an older version wrote it."
        )
    with reading(path, remedy="explore again"):
        facts, arrays = read_tensors(path)
        about = parse_json(facts.get(_KEY, "{}"))
        if not isinstance(about, dict) or about.get("format") != FORMAT:
            raise ValueError(f"it does not say that it is {FORMAT!r}")
        prior = ExploredState(
            str(about.get("policy", "")), _poses(arrays, "poses"), _poses(arrays, "refused"), _part(arrays, _MEMORY)
        )
        return Explored(prior, _part(arrays, _REPLAY))


def _part(arrays: dict[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    return {name.removeprefix(prefix): value for name, value in arrays.items() if name.startswith(prefix)}


def _poses(arrays: dict[str, np.ndarray], name: str) -> np.ndarray:
    array = array_of(arrays, name, "f", (None, 3))
    if np.abs(array).max(initial=0.0) > FARTHEST_M:
        raise ValueError(f"a pose lies beyond {FARTHEST_M / 1000:g} km")
    require_count(len(array))
    return array.astype(float)
