"""Objects of a scene that the robot may push, as bodies of the simulation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64


@dataclass(frozen=True, eq=False)
class Solid:
    """A shape that a movable object collides with, in the object's frame."""

    kind: str
    """A geom type of MJCF: box, sphere, capsule, cylinder, ellipsoid or mesh (its convex hull)."""
    size_m: tuple[float, ...]
    """As in MJCF; empty for a mesh."""
    position_m: Float64[np.ndarray, "3"]
    quaternion: Float64[np.ndarray, "4"]
    """Scalar first, as in MJCF."""
    friction: tuple[float, float, float]
    hull_m: Float64[np.ndarray, "v 3"] | None = None
    """Vertices of a mesh, in the frame of the solid [m]."""


@dataclass(frozen=True, eq=False)
class Movable:
    """An object with mass that moves freely."""

    part: str
    """The part of the source that its submeshes name."""
    T_world_object: Float64[np.ndarray, "4 4"]
    """Where it stands at first; a rotation and a shift."""
    mass_kg: float
    centre_m: Float64[np.ndarray, "3"]
    """Centre of mass in the object's frame [m]."""
    inertia_kgm2: Float64[np.ndarray, "3 3"]
    """About the centre of mass, along the axes of the object's frame [kg m2]."""
    solids: tuple[Solid, ...]

    @property
    def centre_z_m(self) -> float:
        """Height of its centre of mass in the world [m]; its origin may lie anywhere."""
        return float(self.T_world_object[2, :3] @ self.centre_m + self.T_world_object[2, 3])

    def moved(self, rotation: Float64[np.ndarray, "3 3"], shift_m: Float64[np.ndarray, "3"]) -> Movable:
        """The same object in a world turned and shifted."""
        T = self.T_world_object.copy()
        T[:3, :3] = rotation @ T[:3, :3]
        T[:3, 3] = rotation @ T[:3, 3] + shift_m
        return replace(self, T_world_object=T)
