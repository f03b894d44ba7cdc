"""Pictures of a robot from three sides, with its footprint and its camera's axis."""

import math
from contextlib import closing

import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from anm_mj.mjcf.poses import set_pose
from anm_mj.robot.isolate import remove_joints
from anm_mj.sim.camera_factory import make_camera
from anm_mj.sim.gl import GlBackend
from anm_mj.types import Footprint

_FOVY_DEG = 12.0
_RED, _BLUE = (0.85, 0.15, 0.1, 0.45), (0.1, 0.35, 0.9, 1.0)
_NOTHING = (238, 240, 243)


def robot_views(
    spec: mujoco.MjSpec,
    root: str,
    T_root_base: Float[np.ndarray, "4 4"],
    T_base_camera: Float[np.ndarray, "4 4"],
    footprint: Footprint,
    backend: GlBackend,
    size_px: int = 420,
) -> tuple[list[UInt8[np.ndarray, "_ _ 3"]], float]:
    """The robot on a floor from the front, from its left and from above (x to the right), with its footprint in red.

    Returns the pictures, and how much each shows from side to side at the robot's base [m]. The first two have half the
    robot's height in the middle.

    ``spec``, the robot alone with the top-level body ``root``, is copied; camera axes are x right, y down, z forward.
    """
    drawn = spec.copy()
    for geom in drawn.geoms:
        # Collision shapes stay hidden where there are visible ones.
        geom.group = 0 if geom.group in (0, 1, 2) else 4
    if not any(geom.group == 0 for geom in drawn.geoms):
        for geom in drawn.geoms:
            geom.group = 0
    remove_joints(drawn, {joint.name for joint in drawn.body(root).joints})
    set_pose(drawn.body(root), np.linalg.inv(T_root_base))
    world = drawn.worldbody
    world.add_light(
        pos=[1.0, 1.0, 4.0],
        dir=[-0.2, -0.2, -1.0],
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        diffuse=[0.35, 0.35, 0.35],
        specular=[0.0, 0.0, 0.0],
    )
    flat = {"contype": 0, "conaffinity": 0, "group": 0}
    world.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, size=[2, 2, 0.01], pos=[0, 0, -0.012], rgba=[0.8, 0.8, 0.8, 1], **flat
    )
    radius = footprint.radius_m
    world.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[radius, 0.002, 0], pos=[0, 0, 0.001], rgba=_RED, **flat)
    reach = max(2.2 * radius, footprint.z_max_m, float(T_base_camera[2, 3])) * 1.25
    lens, ahead = T_base_camera[:3, 3], T_base_camera[:3, 2]
    world.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        size=[0.005 * reach, 0, 0],
        fromto=[*lens, *(lens + 0.2 * reach * ahead)],
        rgba=_BLUE,
        **flat,
    )
    distance = reach / 2.0 / math.tan(math.radians(_FOVY_DEG / 2.0))
    middle = max(footprint.z_max_m, float(lens[2])) / 2.0
    for name, pos, xyaxes in (
        ("front", [distance, 0.0, middle], [0, 1, 0, 0, 0, 1]),
        ("left", [0.0, distance, middle], [-1, 0, 0, 0, 0, 1]),
        ("above", [0.0, 0.0, distance], [1, 0, 0, 0, 1, 0]),
    ):
        camera = world.add_camera(name=f"view_{name}", pos=pos, fovy=_FOVY_DEG)
        camera.alt.type, camera.alt.xyaxes = mujoco.mjtOrientation.mjORIENTATION_XYAXES, xyaxes
    model = drawn.compile()
    model.vis.map.znear = 0.1 * distance / model.stat.extent
    model.vis.map.zfar = 3.0 * distance / model.stat.extent
    # The sum of all lights leaves light colours, from above too, what they are.
    model.vis.headlight.ambient[:], model.vis.headlight.diffuse[:], model.vis.headlight.specular[:] = 0.45, 0.25, 0.0
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    images = []
    for name in ("front", "left", "above"):
        with closing(make_camera(model, f"view_{name}", size_px, size_px, cull_face=False, backend=backend)) as camera:
            rgb, depth_m = camera.render(data)
            images.append(np.where(np.isnan(depth_m)[..., None], np.array(_NOTHING, np.uint8), rgb))
    return images, reach
