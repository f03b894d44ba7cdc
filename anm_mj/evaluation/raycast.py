"""Ray casting against a triangle mesh by Embree, an optional package."""

from __future__ import annotations

import importlib.util

import numpy as np
from jaxtyping import Float, Float32, Int

from anm_mj.errors import AnmError


class RayCastError(AnmError):
    """No rays can be cast: the package that does it is not installed."""


def can_cast_rays() -> bool:
    """Whether Embree is installed."""
    return importlib.util.find_spec("embreex") is not None


class RayCaster:
    """A mesh that rays are cast against; both sides of a triangle stop them.

    Raises:
        RayCastError: Embree is not installed.
    """

    def __init__(self, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> None:
        if not can_cast_rays():
            raise RayCastError(
                "The observable surface needs the package embreex; install it with pip install 'anm-mj[embree]'."
            )
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._scene = EmbreeScene()
        # Embree keeps what it needs of the mesh; the object itself must live as long as the scene.
        self._mesh = TriangleMesh(self._scene, np.ascontiguousarray(vertices, np.float32)[faces])

    def lengths(
        self, origins_m: Float32[np.ndarray, "n 3"], directions: Float32[np.ndarray, "n 3"]
    ) -> Float32[np.ndarray, " n"]:
        """How far each ray goes, in lengths of its direction; 1e37 where it hits nothing."""
        if len(origins_m) == 0:
            return np.zeros(0, np.float32)
        return self._scene.run(origins_m, directions, query="DISTANCE")
