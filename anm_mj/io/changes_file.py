"""``changes.json`` and ``changes.npz``: what a continued run found to be gone or new since the prior run."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from anm_mj.io.to_json import write_json
from anm_mj.io.write import writing
from anm_mj.types import SurfaceChange
from anm_mj.utils.files import atomic_write


def write_changes(summary: Path, voxels: Path, changes: Sequence[SurfaceChange]) -> None:
    """Write both files. ``changes.json`` has one entry per piece of surface, largest first, ``changes.npz`` the centres
    of all their voxels. Raises RunFolderError if they cannot be written.
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
    xyz_m = np.concatenate([np.zeros((0, 3)), *(change.xyz_m for change in changes)]).astype(np.float32)
    number = np.repeat(np.arange(len(changes)), [len(change.xyz_m) for change in changes])
    with writing(voxels), atomic_write(voxels) as partial, partial.open("wb") as file:
        np.savez_compressed(file, xyz_m=xyz_m, change=number.astype(np.int32))
    write_json(summary, {"changes": entries})
