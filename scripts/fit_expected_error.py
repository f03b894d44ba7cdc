"""Fits the expected error of the map's surface to its last-layer variance.

    python scripts/fit_expected_error.py runs/a runs/b runs/c

Each folder is one of a finished run. The error of a zero-crossing is its distance to the true surface. Points of all
runs together are grouped into 40 classes of equal size by their variance; the curve a + c variance^k is fitted to the
classes' mean errors. ``anm_mj/mapping/last_layer.py`` holds c and k.
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from bench_uncertainty import surface
from jaxtyping import Float
from scipy.optimize import curve_fit

from anm_mj.cli.command_line import run_script
from anm_mj.evaluation.surface_distance import surface_distance
from anm_mj.ground_truth.ground_truth import GroundTruth
from anm_mj.io.run_folder import RunFolder
from anm_mj.mapping.last_layer import last_layer_variance
from anm_mj.mapping.neural_map import NeuralMap

NUM_POINTS = 20_000
"""Points of each run."""
NUM_CLASSES = 40
"""Classes that the curve is fitted to."""


def main(runs: Annotated[tuple[Path, ...], tyro.conf.Positional]) -> None:
    """Print the mean error by tenths of each run's points, and the curve of all."""
    variances, errors = [], []
    for path in runs:
        variance, error_cm = points_of(path)
        variances.append(variance)
        errors.append(error_cm)
        tenths = " ".join(f"{mean:.2f}" for _, mean in classes(variance, error_cm, 10))
        print(f"{path.name}: mean error {error_cm.mean():.3f} cm, by tenths of the variance {tenths}")
    found = np.array(classes(np.concatenate(variances), np.concatenate(errors), NUM_CLASSES))
    (constant, scale, exponent), _ = curve_fit(curve, found[:, 0], found[:, 1], p0=(0.2, 0.1, 0.5))
    off = np.abs(curve(found[:, 0], constant, scale, exponent) - found[:, 1]).mean()
    print(f"error = {constant:.3f} + {scale:.3f} variance^{exponent:.2f} cm; classes lie {off:.3f} cm off on average")


def points_of(path: Path) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Variance and error [cm] of zero-crossings of a run's map."""
    folder = RunFolder.open(path)
    neural_map, truth = NeuralMap.load(folder.map), GroundTruth.load(folder.ground_truth)
    points = surface(neural_map)
    points = points[np.random.default_rng(0).permutation(len(points))[:NUM_POINTS]]
    density_exponent = neural_map.config.schedule.density_exponent
    variance = last_layer_variance(neural_map.backend, neural_map.occupancy.by_depth, points, density_exponent)
    return variance.astype(float), 100.0 * surface_distance(points, truth.vertices.astype(float), truth.faces)


def classes(
    variance: Float[np.ndarray, " n"], error_cm: Float[np.ndarray, " n"], count: int
) -> list[tuple[float, float]]:
    """Geometric mean of the variance and mean error [cm] of classes of equal size."""
    parts = np.array_split(np.argsort(variance, kind="stable"), count)
    return [(float(np.exp(np.log(variance[part]).mean())), float(error_cm[part].mean())) for part in parts]


def curve(variance: Float[np.ndarray, " n"], constant: float, scale: float, exponent: float) -> Float[np.ndarray, " n"]:
    """A constant plus a power of the variance."""
    return constant + scale * variance**exponent


if __name__ == "__main__":
    run_script(main)
