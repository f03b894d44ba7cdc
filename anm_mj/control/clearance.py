"""Exact clearance of an upright cylinder in a triangle mesh: the truth about where the robot may stand and drive.

coal (the collision library that comes with pinocchio) tests the convex shapes themselves against the triangles in a
tree of oriented bounding boxes; neither the robot nor the scene is approximated.
"""

from __future__ import annotations

import math

import coal
import numpy as np
from jaxtyping import Float, Int

from anm_mj.frames import move_pose
from anm_mj.types import Footprint, Pose2

_SAGITTA_M = 0.0005
"""Largest distance of an arc from the lines that stand for it [m]."""


class Clearance:
    """A scene's triangles and a robot's footprint, ready to be asked about poses.

    The mesh is a surface: a footprint wholly inside a closed solid, touching no triangle of it, counts as free. A robot
    that starts in the open never gets there, because it would have to sweep through the surface.
    """

    def __init__(self, vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"], footprint: Footprint):
        """Build the tree; about 0.5 s for 100k triangles.

        Args:
            vertices: in the world [m].
            faces: indices into the vertices.
            footprint: triangles that lie wholly below its z_min or above its z_max never matter and are left out.
        """
        self._footprint = footprint
        self._mid_z_m = (footprint.z_min_m + footprint.z_max_m) / 2.0
        self._height_m = footprint.z_max_m - footprint.z_min_m
        self._cylinder = coal.Cylinder(footprint.radius_m, self._height_m)
        self._mesh = _build_tree(vertices, faces, footprint)
        self._mesh_placement = coal.Transform3s.Identity()
        self._collision_request = coal.CollisionRequest()
        self._distance_request = coal.DistanceRequest()

    @property
    def footprint(self) -> Footprint:
        """The cylinder that the questions are about."""
        return self._footprint

    def collides(self, pose: Pose2) -> bool:
        """Whether the footprint at this pose meets a triangle; tens of microseconds."""
        return self._meets(self._cylinder, pose)

    def distance_m(self, pose: Pose2) -> float:
        """Distance from the footprint to the nearest triangle in its range of heights [m].

        0.0 when they meet, infinite when there are no triangles.
        """
        if self._mesh is None:
            return float("inf")
        result = coal.DistanceResult()
        placement = self._placement(pose)
        coal.distance(self._mesh, self._mesh_placement, self._cylinder, placement, self._distance_request, result)
        return max(result.min_distance, 0.0)

    def sweep_collides(self, pose: Pose2, forward_m: float, turn_rad: float = 0.0) -> bool:
        """Whether rolling from a free pose meets a triangle on the way or at the end.

        What the footprint sweeps along a line is a box as wide as the footprint between two half-cylinders, of which
        the one behind is free already: one exact test of the box and one of the cylinder at the end. An arc is cut into
        lines that leave it by half a millimetre at most, and their boxes are wider by as much.

        Args:
            pose: where the move starts.
            forward_m: length of the way [m]; negative backwards.
            turn_rad: turn on the way, at a constant rate [rad]; a turn on the spot sweeps nothing new.
        """
        # The height of an arc over its chord is its length times its angle by eight.
        pieces = max(1, math.ceil(math.sqrt(abs(forward_m * turn_rad) / (8.0 * _SAGITTA_M))))
        length_m, angle_rad = forward_m / pieces, turn_rad / pieces
        wider_m = abs(length_m * angle_rad) / 8.0
        for _ in range(pieces):
            end = move_pose(pose, length_m, angle_rad)
            if self.collides(end):
                return True
            chord = move_pose(pose, 0.0, angle_rad / 2.0)
            chord_m = math.copysign(math.hypot(end.x_m - pose.x_m, end.y_m - pose.y_m), length_m)
            box = coal.Box(abs(chord_m), 2.0 * (self._footprint.radius_m + wider_m), self._height_m)
            if self._meets(box, move_pose(chord, chord_m / 2.0, 0.0)):
                return True
            pose = end
        return False

    def _meets(self, shape: coal.ShapeBase, pose: Pose2) -> bool:
        """Whether a shape centred at half the footprint's height meets the mesh."""
        if self._mesh is None:
            return False
        result = coal.CollisionResult()
        placement = self._placement(pose)
        coal.collide(self._mesh, self._mesh_placement, shape, placement, self._collision_request, result)
        return result.isCollision()

    def _placement(self, pose: Pose2) -> coal.Transform3s:
        """Where a shape stands, its centre at half the footprint's height."""
        c, s = np.cos(pose.yaw_rad), np.sin(pose.yaw_rad)
        rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return coal.Transform3s(rotation, np.array([pose.x_m, pose.y_m, self._mid_z_m]))


def _build_tree(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"], footprint: Footprint
) -> coal.BVHModelOBBRSS | None:
    """The triangles that reach into the footprint's heights, or None when there are none."""
    z = vertices[faces, 2]
    faces = faces[(z.max(axis=1) > footprint.z_min_m) & (z.min(axis=1) < footprint.z_max_m)]
    if len(faces) == 0:
        return None
    used, renumbered = np.unique(faces, return_inverse=True)
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(len(faces), len(used))
    mesh.addVertices(np.ascontiguousarray(vertices[used], dtype=np.float64))
    mesh.addTriangles(np.ascontiguousarray(renumbered.reshape(-1, 3), dtype=np.int64))
    mesh.endModel()
    return mesh
