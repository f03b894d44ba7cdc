"""Ray casting against triangle meshes with Embree, an optional package."""

import importlib.util

import numpy as np
from jaxtyping import Float, Float32, Int

from anm_mj.errors import AnmError


class RayCastError(AnmError):
    """Embree is not installed."""


def embree_installed() -> bool:
    """Whether the package ``embreex`` is installed, which has no wheel for some machines."""
    return importlib.util.find_spec("embreex") is not None


class RayCaster:
    """A triangle mesh to cast rays against; both sides of a triangle stop a ray. Vertices are in the world [m]. Raises
    RayCastError if embree is not installed.
    """

    def __init__(self, vertices_m: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> None:
        if not embree_installed():
            raise RayCastError("Ray casting needs the package embreex; install it with pip install embreex.")
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._scene = EmbreeScene()
        # Embree reads the mesh's own memory, which must live as long as the scene.
        self._arrays = np.ascontiguousarray(vertices_m, np.float32), np.ascontiguousarray(faces, np.int32)
        self._mesh = TriangleMesh(self._scene, *self._arrays)

    def lengths(
        self, origins_m: Float32[np.ndarray, "n 3"], directions: Float32[np.ndarray, "n 3"]
    ) -> Float32[np.ndarray, " n"]:
        """Length of each ray, in units of its direction's length; 1e37 without a hit."""
        if len(origins_m) == 0:
            return np.zeros(0, np.float32)
        return self._scene.run(origins_m, directions, query="DISTANCE")

    def hits(
        self, origins_m: Float32[np.ndarray, "n 3"], directions: Float32[np.ndarray, "n 3"]
    ) -> dict[str, np.ndarray]:
        """All that Embree knows of the hits. Returns ``primID`` (face, -1 without a hit), ``tfar`` (length), ``u``,
        ``v`` (barycentric), ``Ng`` (normal, (n, 3)).
        """
        return self._scene.run(origins_m, directions, query="INTERSECT", output=True)
