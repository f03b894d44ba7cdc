"""The signed distances of a run's map as NumPy archives: the volume, and a slice of the Euclidean distance field."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Int8
from scipy import ndimage

from anm_mj.errors import RunFolderError
from anm_mj.io.read_run import Run
from anm_mj.io.write import writing
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.types import UNKNOWN
from anm_mj.utils.progress import Progress, unheard

CHUNK = 1 << 18
"""Points per query of the map."""
SLICE_HEIGHT_M = 0.5
"""Height of the slice: obstacles that stop a robot of the usual size [m]."""


def export_sdf(run: Run, out: Path, on_progress: Progress = unheard) -> list[Path]:
    """``sdf.npz``: ``sdf_m`` (layers, rows, cols) float32, ``state``, ``origin_m``, ``spacing_m``, ``truncation_m``.

    ``sdf_m[k, i, j]`` is the signed distance at ``origin_m + spacing_m * (j, i, k)`` [m], positive in free space, cut
    off at the truncation, NaN where nothing was observed. ``state`` is 0 free, 1 occupied, -1 unknown. Raises
    RunFolderError if the run has no map, or the file cannot be written, and MapError if the map cannot be read.
    """
    volume = _volume(run, on_progress)
    path = out / "sdf.npz"
    with writing(path):
        np.savez_compressed(path, allow_pickle=False, **vars(volume))
    return [path]


def export_esdf(run: Run, out: Path, on_progress: Progress = unheard) -> list[Path]:
    """``esdf.npz``: ``esdf_m`` (rows, cols) float32 at ``height_m``, ``origin_xy_m``, ``spacing_m``.

    The distance in space to the nearest occupied voxel, not cut off; negative inside, NaN where nothing was observed.
    Raises RunFolderError if the run has no map, its map no obstacle, or the file cannot be written, and MapError if the
    map cannot be read.
    """
    volume = _volume(run, on_progress)
    occupied = volume.sdf_m < 0.0
    if not occupied.any():
        raise RunFolderError(f"The map of {run.folder.path} holds no obstacle, so there is no distance to any.")
    outside, inside = (
        np.asarray(ndimage.distance_transform_edt(mask, sampling=volume.spacing_m)) for mask in (~occupied, occupied)
    )
    # The surface lies between the centres of two voxels.
    half = volume.spacing_m / 2.0
    esdf_m = np.where(occupied, half - inside, outside - half).astype(np.float32)
    esdf_m[volume.state == UNKNOWN] = np.nan
    layer = int(np.clip(round((SLICE_HEIGHT_M - volume.origin_m[2]) / volume.spacing_m), 0, len(esdf_m) - 1))
    path = out / "esdf.npz"
    with writing(path):
        np.savez_compressed(
            path,
            allow_pickle=False,
            esdf_m=esdf_m[layer],
            height_m=volume.origin_m[2] + layer * volume.spacing_m,
            origin_xy_m=volume.origin_m[:2],
            spacing_m=volume.spacing_m,
        )
    return [path]


@dataclass(frozen=True)
class _Volume:
    """Signed distances at the centres of the observed voxels' bounding box."""

    sdf_m: Float32[np.ndarray, "layers rows cols"]
    state: Int8[np.ndarray, "layers rows cols"]
    origin_m: Float[np.ndarray, "3"]
    spacing_m: float
    truncation_m: float


def _volume(run: Run, on_progress: Progress) -> _Volume:
    if not run.folder.map.is_file():
        raise RunFolderError(f"{run.folder.path} has no {run.folder.map.name}: the run did not end.")
    neural_map = NeuralMap.load(run.folder.map, device="cpu")
    grid = neural_map.occupancy_grid()
    known = np.argwhere(grid.state != UNKNOWN)
    if len(known) == 0:
        raise RunFolderError(f"The map of {run.folder.path} is empty: nothing was observed.")
    low, high = known.min(axis=0), known.max(axis=0) + 1
    state = grid.state[tuple(slice(a, b) for a, b in zip(low, high, strict=True))].copy()
    origin_m = grid.origin_m + (low[::-1] + 0.5) * grid.resolution_m
    asked = np.argwhere(state != UNKNOWN)
    points = origin_m + asked[:, ::-1] * grid.resolution_m
    sdf_m = np.full(state.shape, np.nan, np.float32)
    for first in range(0, len(points), CHUNK):
        part = slice(first, first + CHUNK)
        sdf_m[tuple(asked[part].T)] = neural_map.sdf(points[part])
        on_progress(min(first + CHUNK, len(points)), len(points))
    return _Volume(sdf_m, state, origin_m, grid.resolution_m, neural_map.config.field.truncation_m)
