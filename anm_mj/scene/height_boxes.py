"""Collision boxes for robots of other heights than the one that scenes are made for.

The boxes of a scene cover everything up to 1.4 m, because its robot sweeps that height: a table blocks it as far as its
outline reaches. A lower robot drives under the table, and a higher one meets the lamp above.
"""

from __future__ import annotations

import mujoco

from anm_mj.scene.collision import SLICE_Z_MAX_M, collision_boxes
from anm_mj.scene.folder import Scene
from anm_mj.scene.mjcf import BOX_TOP_M, COLLISION_GROUP

_LIKE_M = 0.1
"""Robots that are lower than the boxes' slice by less than this meet the boxes of the scene's file [m]."""


def needs_other_boxes(top_m: float) -> bool:
    """Whether a robot of a height [m] meets other things than the boxes in a scene's file."""
    return not SLICE_Z_MAX_M - _LIKE_M <= top_m <= SLICE_Z_MAX_M


def replace_boxes(spec: mujoco.MjSpec, scene: Scene, top_m: float) -> None:
    """Replace the collision boxes of a scene's spec by those that cover its obstacles up to a height [m].

    Scenes with movable objects keep theirs: the stored triangles do not say which of them move.
    """
    if spec.worldbody.bodies:
        return
    for geom in [g for g in spec.worldbody.geoms if g.group == COLLISION_GROUP and g.type == mujoco.mjtGeom.mjGEOM_BOX]:
        spec.delete(geom)
    vertices, faces = scene.obstacles()
    above_m = BOX_TOP_M - SLICE_Z_MAX_M
    height_m = (top_m + above_m) / 2.0
    for i, (x_min, y_min, x_max, y_max) in enumerate(collision_boxes(vertices[faces], top_m)):
        spec.worldbody.add_geom(
            name=f"box_{i}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[(x_min + x_max) / 2.0, (y_min + y_max) / 2.0, height_m],
            size=[(x_max - x_min) / 2.0, (y_max - y_min) / 2.0, height_m],
            group=COLLISION_GROUP,
            rgba=[0.9, 0.4, 0.2, 0.4],
        )
