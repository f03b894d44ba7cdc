"""How much of the true surface the runs before a continued one had covered."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32
from scipy.spatial import KDTree

from anm_mj.errors import RunFolderError
from anm_mj.evaluation.completion import Coverage, uncapped_m
from anm_mj.ground_truth.ground_truth import GroundTruth
from anm_mj.ground_truth.reduced_depth import back_project_reduced
from anm_mj.io.read_run import Run
from anm_mj.io.write import writing
from anm_mj.utils.files import atomic_write
from anm_mj.utils.read_file import read_npz


def covered_before(run: Run, truth: GroundTruth) -> Float32[np.ndarray, " n"]:
    """Distance of every sample to the nearest depth point of a run and of those that it went on from [m].

    What a run before this one covered is known by its samples alone. Where the scene has changed between the two, the
    distance to the nearest covered sample stands for that to its depth point, and is too large by no more than that.
    Raises RunFolderError if a depth image is missing or damaged.
    """
    coverage = Coverage(truth.samples)
    for points in true_clouds(run):
        coverage.add_points(points)
    distance_m = uncapped_m(truth.samples, coverage.distance_m, true_clouds(run))
    if run.folder.covered_before.is_file():
        samples = GroundTruth.load(run.folder.ground_truth).samples
        before_m = read_covered_before(run.folder.covered_before, len(samples))
        if np.array_equal(samples, truth.samples):
            distance_m = np.minimum(distance_m, before_m)
        else:
            away_m, nearest = KDTree(samples).query(truth.samples)
            distance_m = np.minimum(distance_m, away_m + before_m[nearest])
    return distance_m.astype(np.float32)


def true_clouds(run: Run) -> Iterator[Float[np.ndarray, "n 3"]]:
    """The depth points of every frame of a run, from its true camera pose, world [m]."""
    for frame in run.frames:
        yield back_project_reduced(run.depth_mm(frame), run.intrinsics, frame.T_true_camera)


def write_covered_before(path: Path, distance_m: Float32[np.ndarray, " n"]) -> None:
    """Write ``covered_before.npz``. Raises RunFolderError if it cannot be written."""
    with writing(path), atomic_write(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, distance_m=distance_m)


def read_covered_before(path: Path, num_samples: int) -> Float32[np.ndarray, " n"]:
    """Read ``covered_before.npz``. There should be a distance for each of ``num_samples``. Raises RunFolderError if it
    is damaged, or of another true surface.
    """
    try:
        distance_m = read_npz(path)["distance_m"]
    except (OSError, ValueError, KeyError) as err:
        raise RunFolderError(f"{path} cannot be read ({err}); copy the run again.") from err
    if distance_m.shape != (num_samples,) or distance_m.dtype != np.float32 or np.isnan(distance_m).any():
        raise RunFolderError(f"{path} does not fit ground_truth.npz; copy the run again.")
    return distance_m
