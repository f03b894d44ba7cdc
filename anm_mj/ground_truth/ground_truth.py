"""Ground truth: the true surface of a scene, for evaluation only."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32

from anm_mj.errors import RunFolderError, SceneError
from anm_mj.geometry.triangles import checked_triangles
from anm_mj.utils.read_file import read_npz

COVERED_M = 0.05
"""A sample nearer than this to a seen point counts as seen [m] (paper, section V-B)."""
NUM_SAMPLES = 200_000
"""Samples of the true surface (paper's protocol)."""
_MOST_EQUAL = 1000
"""No surface has this many samples in one place, and a search tree of equal points is as slow as a list."""


def sample_triangles(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], num_samples: int, seed: int
) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
    """Uniform samples of a surface and the face each lies on.

    Source: Osada et al., Shape Distributions, ACM Transactions on Graphics 21(4), 2002, section 4.1. Raises SceneError
    if the surface has no area.
    """
    corners = vertices.astype(np.float64)[faces]
    edge_a, edge_b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = 0.5 * np.linalg.norm(np.cross(edge_a, edge_b), axis=1)
    total = float(area.sum())
    if not total > 0.0:
        raise SceneError(f"The mesh has {len(faces)} faces and an area of {total} m2; a surface is needed to evaluate.")
    rng = np.random.default_rng(seed)
    cumulative = np.cumsum(area)
    face = np.searchsorted(cumulative, rng.random(num_samples) * cumulative[-1], side="right")
    face = np.minimum(face, len(faces) - 1)
    along, across = np.sqrt(rng.random(num_samples)), rng.random(num_samples)
    a, b = along * (1.0 - across), along * across
    return corners[face, 0] + a[:, None] * edge_a[face] + b[:, None] * edge_b[face], face


@dataclass(frozen=True)
class GroundTruth:
    """A scene's true surface and area-weighted samples of it for completion, world [m]; ``observable`` are those that
    can be seen from the reachable area, None if that is not known.
    """

    samples: Float32[np.ndarray, "n 3"]
    vertices: Float32[np.ndarray, "v 3"]
    faces: Int32[np.ndarray, "f 3"]
    observable: Bool[np.ndarray, " n"] | None = None

    @classmethod
    def sample(
        cls, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], num_samples: int = NUM_SAMPLES
    ) -> GroundTruth:
        """Uniform samples of a whole mesh, world [m], hidden parts included, as in the paper's protocol. Raises
        SceneError if the mesh has no area.
        """
        samples, _ = sample_triangles(vertices, faces, num_samples, seed=0)
        return cls(samples.astype(np.float32), vertices.astype(np.float32), faces.astype(np.int32))

    def save(self, path: Path) -> None:
        """Write all of it to an ``.npz`` file."""
        arrays = {name: array for name, array in vars(self).items() if array is not None}
        # By way of an open file, because numpy would give another name to a path without its own suffix.
        with path.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **arrays)

    @classmethod
    def load(cls, path: Path) -> GroundTruth:
        """Read what :meth:`save` wrote. Raises RunFolderError if the file is missing or holds something else."""
        try:
            return _checked(cls(**read_npz(path)))
        except FileNotFoundError as err:
            raise RunFolderError(f"{path} is missing; without the true surface nothing can be evaluated.") from err
        except (OSError, TypeError, ValueError) as err:
            raise RunFolderError(f"{path} cannot be read as a true surface ({err}); copy the run again.") from err


def _checked(truth: GroundTruth) -> GroundTruth:
    """The same; a ValueError where its arrays are not what they should be."""
    checked_triangles(truth.vertices, truth.faces)
    samples, _ = checked_triangles(truth.samples, np.zeros((0, 3), np.int32))
    _, count = np.unique(np.ascontiguousarray(samples).view("V12"), return_counts=True)
    if len(count) and count.max() > _MOST_EQUAL:
        raise ValueError(f"{count.max()} of {len(truth.samples)} samples lie in one place")
    seen = truth.observable
    if seen is not None and (seen.dtype != bool or seen.shape != (len(truth.samples),)):
        raise ValueError(f"observable is {seen.dtype} of shape {seen.shape}")
    return truth
