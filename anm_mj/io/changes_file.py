"""``changes.json`` and ``changes.npz``: what a continued run finds to have changed since the run before it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from anm_mj.io.to_json import write_json
from anm_mj.io.write import reading, writing
from anm_mj.types import SurfaceChange
from anm_mj.utils.files import atomic_write
from anm_mj.utils.read_file import array_of, read_npz

_GONE, _NEW = "gone", "new"
_WIDEST_M = 10.0
"""Voxels are no larger than this [m]."""


def write_changes(summary: Path, voxels: Path, changes: Sequence[SurfaceChange]) -> None:
    """Write what a continued run found to be gone or new. ``changes.json`` has one entry per piece of surface, largest
    first, ``changes.npz`` the centres of all their voxels. Raises RunFolderError if they cannot be written.
    """
    entries = [
        {
            "kind": change.kind,
            "low_m": change.box_m[0].round(3).tolist(),
            "high_m": change.box_m[1].round(3).tolist(),
            "voxels": len(change.xyz_m),
        }
        for change in changes
    ]
    arrays = {
        "xyz_m": np.concatenate([np.zeros((0, 3)), *(change.xyz_m for change in changes)]).astype(np.float32),
        "change": np.repeat(np.arange(len(changes)), [len(change.xyz_m) for change in changes]).astype(np.int32),
        "is_new": np.array([change.kind == _NEW for change in changes], bool),
        "voxel_m": np.array([change.voxel_m for change in changes], float),
    }
    with writing(voxels), atomic_write(voxels) as partial, partial.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)
    write_json(summary, {"changes": entries})


def read_changes(voxels: Path) -> tuple[SurfaceChange, ...]:
    """The changes in a ``changes.npz``; none where a run has no such file, or an older version wrote it. Raises
    RunFolderError if it holds something else.
    """
    if not voxels.is_file():
        return ()
    with reading(voxels, "changes", "copy the run again"):
        arrays = read_npz(voxels)
        if "is_new" not in arrays:
            return ()
        is_new = array_of(arrays, "is_new", "b", (None,))
        voxel_m = array_of(arrays, "voxel_m", "f", (len(is_new),))
        xyz_m = array_of(arrays, "xyz_m", "f", (None, 3)).astype(np.float64)
        number = array_of(arrays, "change", "iu", (len(xyz_m),))
        if not ((voxel_m > 0.0) & (voxel_m <= _WIDEST_M)).all():
            raise ValueError(f"its voxels are {voxel_m.min():g} to {voxel_m.max():g} m wide")
        if set(number.tolist()) != set(range(len(is_new))):
            raise ValueError(f"not each of its {len(is_new)} pieces has voxels")
    return tuple(
        SurfaceChange(_NEW if new else _GONE, xyz_m[number == piece], float(edge_m))
        for piece, (new, edge_m) in enumerate(zip(is_new, voxel_m, strict=True))
    )
