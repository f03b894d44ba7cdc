"""Quality of the reconstructed mesh against the true surface.

Accuracy is the mean distance of samples of the mesh to the true *surface*; completion is the mean distance of true
samples to the mesh. Distances from samples to samples cannot fall below half the sample spacing even for a perfect mesh
(3 cm for 200,000 samples on a flat of 900 m2), so distances here are to triangles. Anchor points cover each surface,
one on every triangle and about 5 cm apart. For each query the exact distances to the triangles of its eight nearest
anchors are compared. On a fine mesh this may miss the nearest triangle; the mean is then 0.01 mm too large.

All metrics are computed twice: for the whole surfaces, and culled to the observed surface. Culling separates how well
a surface was mapped from how much of it was found. It keeps the true samples that the run covered, and the samples of
the mesh whose nearest true sample was covered.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from anm_mj.evaluation.completion import COVERED_M
from anm_mj.evaluation.ground_truth import NUM_SAMPLES, GroundTruth, sample_triangles
from anm_mj.evaluation.nearest import spatial_order
from anm_mj.utils.threads import usual_num_threads

ANCHOR_SPACING_M = 0.05
"""Spacing of anchors [m]."""
NUM_NEAR = 8
"""Anchors per query."""
CHUNK = 20_000
"""Queries processed together; bounds the memory to some 50 MiB."""
FINE_M = 0.025
"""Half of ``COVERED_M``: at 5 cm nearly all observed surface counts as found, however roughly it is known [m]."""
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
) -> tuple[MeshQuality, MeshQuality | None]:
    """Compare a mesh with the true surface.

    Args:
        vertices: World [m].
        faces: Vertex indices.
        truth: The true surface.
        covered: Which of its samples the run observed.
        num_samples: Samples on the mesh.

    Returns:
        The quality of the whole, and culled to the observed surface; None if nothing was observed.

    Raises:
        SceneError: The mesh has no area.
    """
    samples, _ = sample_triangles(vertices, faces, num_samples, SAMPLE_SEED)
    to_truth_m = surface_distance(samples, truth.vertices.astype(np.float64), truth.faces)
    to_mesh_m = surface_distance(truth.samples.astype(np.float64), vertices.astype(np.float64), faces)
    _, nearest = KDTree(truth.samples).query(samples, workers=usual_num_threads())
    kept = covered[nearest]
    culled = _quality(to_truth_m[kept], to_mesh_m[covered]) if kept.any() else None
    return _quality(to_truth_m, to_mesh_m), culled


def _quality(to_truth_m: Float[np.ndarray, " n"], to_mesh_m: Float[np.ndarray, " m"]) -> MeshQuality:
    return MeshQuality(
        accuracy_cm=100.0 * float(np.mean(to_truth_m)),
        completion_cm=100.0 * float(np.mean(to_mesh_m)),
        completion_ratio_percent=100.0 * float(np.mean(to_mesh_m < COVERED_M)),
        precision_percent=100.0 * float(np.mean(to_truth_m < COVERED_M)),
        fine_completion_ratio_percent=100.0 * float(np.mean(to_mesh_m < FINE_M)),
    )


def surface_distance(
    points: Float[np.ndarray, "n 3"], vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Float[np.ndarray, " n"]:
    """Unsigned distance of points to a triangle mesh by anchors, see above [m].

    Raises:
        SceneError: The mesh has no area.
    """
    corners = vertices[faces]
    area_m2 = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    spread, spread_face = sample_triangles(
        vertices, faces, max(1, round(float(area_m2.sum()) / ANCHOR_SPACING_M**2)), SAMPLE_SEED
    )
    anchors = np.concatenate([corners.mean(axis=1), spread])
    anchor_face = np.concatenate([np.arange(len(faces)), spread_face])
    near = min(NUM_NEAR, len(anchors))
    tree = KDTree(anchors)
    distance_m = np.empty(len(points))
    order = spatial_order(points)
    for start in range(0, len(points), CHUNK):
        chunk = points[order[start : start + CHUNK]]
        _, found = tree.query(chunk, k=near, workers=usual_num_threads())
        candidates = corners[anchor_face[found.reshape(len(chunk), near)]].reshape(-1, 3, 3)
        squared = triangle_distance_squared(np.repeat(chunk, near, axis=0), candidates)
        distance_m[order[start : start + CHUNK]] = np.sqrt(squared.reshape(len(chunk), near).min(axis=1))
    return distance_m


def triangle_distance_squared(
    points: Float[np.ndarray, "n 3"], triangles: Float[np.ndarray, "n 3 3"]
) -> Float[np.ndarray, " n"]:
    """Squared distance of each point to its own triangle [m2]: to the plane if it projects inside, else to an edge."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normal = np.cross(b - a, c - a)
    norm_squared = _dot(normal, normal)
    inside = norm_squared > 0.0
    nearest_edge = np.full(len(points), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge, to_point = end - start, points - start
        inside &= _dot(np.cross(edge, to_point), normal) >= 0.0
        length_squared = _dot(edge, edge)
        along = np.clip(_dot(to_point, edge) / np.where(length_squared > 0.0, length_squared, 1.0), 0.0, 1.0)
        offset = to_point - along[:, None] * edge
        nearest_edge = np.minimum(nearest_edge, _dot(offset, offset))
    to_plane = _dot(points - a, normal) ** 2 / np.where(norm_squared > 0.0, norm_squared, 1.0)
    return np.where(inside, to_plane, nearest_edge)


def _dot(a: Float[np.ndarray, "n 3"], b: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    return np.einsum("ij,ij->i", a, b)
