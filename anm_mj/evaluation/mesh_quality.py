"""Quality of the reconstructed mesh against the true surface.

Accuracy is the mean distance of samples of the mesh to the true *surface*; completion is the mean distance of true
samples to the mesh. Distances from samples to samples cannot fall below half the sample spacing even for a perfect mesh
(3 cm for 200,000 samples on a flat of 900 m2), so distances here are to triangles (``surface_distance.py``).

All metrics are computed twice: for the whole surfaces, and culled to the observed surface. Culling separates how well
a surface was mapped from how much of it was found. It keeps the true samples that the run covered, and the samples of
the mesh whose nearest true sample was covered.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from anm_mj.evaluation.surface_distance import surface_distance
from anm_mj.ground_truth.ground_truth import COVERED_M, NUM_SAMPLES, GroundTruth, sample_triangles
from anm_mj.people.crowd import CHAIR
from anm_mj.people.door_leaves import LEAF
from anm_mj.types import Footprint
from anm_mj.utils.threads import usual_num_threads

FINE_M = 0.025
"""Half of ``COVERED_M``: at 5 cm nearly all observed surface counts as found, however roughly it is known [m]."""
FAR_OFF_M = 0.1
"""What is farther away than this is no error of depth, but something that is not there [m]."""
SAMPLE_SEED = 0
"""Seed of the samples on the reconstruction."""


@dataclass(frozen=True)
class MeshQuality:
    """Distances between a reconstructed mesh and the true surface."""

    accuracy_cm: float
    """Mean distance of the reconstruction to the true surface [cm]."""
    completion_cm: float
    """Mean distance of the true surface to the reconstruction [cm]."""
    completion_ratio_percent: float
    """Share of the true surface within 5 cm of the reconstruction [%] (recall)."""
    precision_percent: float
    """Share of the reconstruction within 5 cm of the true surface [%]."""
    fine_completion_ratio_percent: float
    """Share of the true surface within 2.5 cm of the reconstruction [%]."""
    ghost_percent: float
    """Share of the reconstruction farther than 10 cm from the true surface [%]."""

    @property
    def f_score_percent(self) -> float:
        """Harmonic mean of precision and recall [%] (Knapitsch et al., Tanks and Temples, 2017)."""
        total = self.precision_percent + self.completion_ratio_percent
        return 2.0 * self.precision_percent * self.completion_ratio_percent / total if total > 0.0 else 0.0

    @property
    def chamfer_cm(self) -> float:
        """Mean of accuracy and completion [cm]."""
        return (self.accuracy_cm + self.completion_cm) / 2.0


def mesh_quality(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    truth: GroundTruth,
    covered: Bool[np.ndarray, " n"],
    num_samples: int = NUM_SAMPLES,
    chair: tuple[float, float, float] | None = None,
    doors: Sequence[tuple[float, float, float, float]] = (),
) -> tuple[MeshQuality, MeshQuality | None] | None:
    """Compare a mesh, world [m], with the true surface, of whose samples some were observed. Returns the quality of the
    whole, and culled to the observed surface; None if nothing was observed. Raises SceneError if the mesh has no area.

    A chair that was pushed (x [m], y [m], yaw [rad]) and leaves of doors (x and y of the hinge [m], yaw [rad], length
    [m]) are no part of the true surface, and what the mesh has of them where they stand is not judged; None of a mesh
    that has nothing else.
    """
    samples, _ = sample_triangles(vertices, faces, num_samples, SAMPLE_SEED)
    if chair is not None:
        samples = _without(samples, np.linalg.norm(samples[:, :2] - chair[:2], axis=1), CHAIR)
    for x_m, y_m, yaw_rad, length_m in doors:
        along, away_m = np.array([math.cos(yaw_rad), math.sin(yaw_rad)]), samples[:, :2] - (x_m, y_m)
        beside_m = away_m - (away_m @ along).clip(0.0, length_m)[:, None] * along
        samples = _without(samples, np.linalg.norm(beside_m, axis=1), LEAF)
    if not len(samples):
        return None
    to_truth_m = surface_distance(samples, truth.vertices.astype(np.float64), truth.faces)
    to_mesh_m = surface_distance(truth.samples.astype(np.float64), vertices.astype(np.float64), faces)
    _, nearest = KDTree(truth.samples).query(samples, workers=usual_num_threads())
    kept = covered[nearest]
    culled = _quality(to_truth_m[kept], to_mesh_m[covered]) if kept.any() else None
    return _quality(to_truth_m, to_mesh_m), culled


def _without(
    samples: Float[np.ndarray, "n 3"], away_m: Float[np.ndarray, " n"], body: Footprint
) -> Float[np.ndarray, "m 3"]:
    """The samples that are not of a body above the floor, so far away from its middle in the plane."""
    above_floor = (samples[:, 2] > COVERED_M) & (samples[:, 2] < body.z_max_m + FAR_OFF_M)
    return samples[~((away_m < body.radius_m + FAR_OFF_M) & above_floor)]


def _quality(to_truth_m: Float[np.ndarray, " n"], to_mesh_m: Float[np.ndarray, " m"]) -> MeshQuality:
    return MeshQuality(
        accuracy_cm=100.0 * float(np.mean(to_truth_m)),
        completion_cm=100.0 * float(np.mean(to_mesh_m)),
        completion_ratio_percent=100.0 * float(np.mean(to_mesh_m < COVERED_M)),
        precision_percent=100.0 * float(np.mean(to_truth_m < COVERED_M)),
        fine_completion_ratio_percent=100.0 * float(np.mean(to_mesh_m < FINE_M)),
        ghost_percent=100.0 * float(np.mean(to_truth_m > FAR_OFF_M)),
    )
