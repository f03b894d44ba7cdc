"""Exact collision tests of an upright cylinder against a triangle mesh: where the robot can stand and drive.

coal, the collision library of pinocchio, tests convex shapes against the triangles through a tree of oriented bounding
boxes. It approximates neither the robot nor the scene.
"""

import math

import coal
import numpy as np
from jaxtyping import Float, Int

from anm_mj.frames import move_pose
from anm_mj.types import Footprint, Pose2

_SAGITTA_M = 0.0005
"""Largest distance between an arc and the chords that replace it [m]."""


class Clearance:
    """Tests a robot's footprint at poses and along motions against the triangles of a scene.

    The mesh is a surface: a footprint wholly inside a closed solid touches no triangle and counts as free. A robot that
    starts outside never gets there, because its sweep would cross the surface.
    """

    def __init__(self, vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"], footprint: Footprint):
        """Build the tree of a mesh (world [m]); about 0.5 s for 100k triangles.

        Triangles wholly below the footprint's z_min or above its z_max are dropped.
        """
        self._footprint = footprint
        self._mid_z_m = (footprint.z_min_m + footprint.z_max_m) / 2.0
        self._height_m = footprint.z_max_m - footprint.z_min_m
        self._cylinder = coal.Cylinder(footprint.radius_m, self._height_m)
        self._mesh = _build_tree(vertices, faces, footprint)
        self._mesh_placement = coal.Transform3s.Identity()
        self._collision_request = coal.CollisionRequest()

    def collides(self, pose: Pose2) -> bool:
        """Whether the footprint touches a triangle at a pose; takes tens of microseconds."""
        return self._collides(self._cylinder, pose)

    def sweep_collides(self, pose: Pose2, forward_m: float, turn_rad: float = 0.0) -> bool:
        """Whether a motion from a free pose touches a triangle.

        Along a straight line the footprint sweeps a box between two half-cylinders. The rear one is free already, so
        one exact test of the box and one of the cylinder at the end suffice. Chords within half a millimetre of an arc
        replace it, and their boxes are wider by that much. The path is ``forward_m`` long [m], negative backwards, with
        a turn at a constant rate [rad]; a turn on the spot sweeps nothing new.
        """
        # The sagitta of an arc is its length times its angle over eight.
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
            if self._collides(box, move_pose(chord, chord_m / 2.0, 0.0)):
                return True
            pose = end
        return False

    def _collides(self, shape: coal.ShapeBase, pose: Pose2) -> bool:
        """Whether a shape centred at half the footprint's height touches the mesh."""
        if self._mesh is None:
            return False
        result = coal.CollisionResult()
        c, s = np.cos(pose.yaw_rad), np.sin(pose.yaw_rad)
        rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        placement = coal.Transform3s(rotation, np.array([pose.x_m, pose.y_m, self._mid_z_m]))
        coal.collide(self._mesh, self._mesh_placement, shape, placement, self._collision_request, result)
        return result.isCollision()


def _build_tree(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"], footprint: Footprint
) -> coal.BVHModelOBB | None:
    """Tree over the triangles that reach into the footprint's heights; None without any."""
    z = vertices[faces, 2]
    faces = faces[(z.max(axis=1) > footprint.z_min_m) & (z.min(axis=1) < footprint.z_max_m)]
    if len(faces) == 0:
        return None
    used, renumbered = np.unique(faces, return_inverse=True)
    mesh = coal.BVHModelOBB()
    mesh.beginModel(len(faces), len(used))
    mesh.addVertices(np.ascontiguousarray(vertices[used], dtype=np.float64))
    mesh.addTriangles(np.ascontiguousarray(renumbered.reshape(-1, 3), dtype=np.int64))
    mesh.endModel()
    return mesh
