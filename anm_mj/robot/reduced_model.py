"""Reduces a robot to the parts that kinematics and control need: an MJCF that MuJoCo, mink and pinocchio read alike.

The reduced model has one root body ``base`` with a free joint (origin on the floor midway between the wheels, x
forward, y left, z up), two hinges ``wheel_left`` and ``wheel_right`` about +y, the sites ``base``, ``camera`` and
``look_ahead``, and explicit inertias. A hinge stands for all wheels of its side. A holonomic base has two slides and a
hinge instead of free joint and wheels. It has no geoms and nothing else that pinocchio's reader silently ignores.
"""

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.mjcf.poses import quaternion_of
from anm_mj.robot.compiled_robot import subtree
from anm_mj.robot.wheels import Wheel

LOOK_AHEAD_M = 0.15
"""Distance of the site ``look_ahead`` in front of the axle [m]."""
BASE_JOINT = "base"
WHEEL_JOINTS = ("wheel_left", "wheel_right")
CAMERA = "camera"
"""Name of the camera's site, with the axes x right, y down, z forward."""
PLANAR_JOINTS = ("base_x", "base_y", "base_yaw")
"""Names of the joints of a holonomic base: two slides along the world's x and y, and a hinge about the base's z."""
_PLANAR = "".join(
    f'<joint name="{name}" type="{kind}" axis="{axis}"/>'
    for name, kind, axis in zip(PLANAR_JOINTS, ("slide", "slide", "hinge"), ("1 0 0", "0 1 0", "0 0 1"), strict=True)
)


def reduced_mjcf(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    root: int,
    T_world_base: Float[np.ndarray, "4 4"],
    T_base_camera: Float[np.ndarray, "4 4"],
    sides: tuple[tuple[Wheel, ...], ...],
    track_m: float,
) -> str:
    """The reduced model of a compiled robot, as MJCF text; all joints but the wheels keep the positions in ``data``.

    ``root`` is the index of its root body; camera axes are x right, y down, z forward. ``sides`` are the left and the
    right wheels, ``track_m`` apart, or none for a base that moves by planar joints, which get the names in
    ``PLANAR_JOINTS``. A wheel's descendants turn with it.
    """
    T_base_world = np.linalg.inv(T_world_base)
    on_robot = [body for body in range(model.nbody) if model.body_rootid[body] == root]
    on_wheels = [sorted({body for wheel in side for body in subtree(model, wheel.body)}) for side in sides]
    on_base = [body for body in on_robot if not any(body in group for group in on_wheels)]
    hinges = ""
    # None without wheels.
    for name, sign, side, bodies in zip(WHEEL_JOINTS, (1.0, -1.0), sides, on_wheels, strict=False):
        centre_m = np.array([0.0, sign * track_m / 2.0, side[0].radius_m])
        armature = sum(float(model.dof_armature[model.joint(wheel.joint).dofadr[0]]) for wheel in side)
        hinges += (
            f'<body name="{name}" pos="{_text(centre_m)}">'
            f'<joint name="{name}" type="hinge" axis="0 1 0" armature="{armature!r}"/>'
            f"{_inertial(model, data, bodies, T_base_world, centre_m)}</body>"
        )
    joints = '<freejoint name="base"/>' if sides else _PLANAR
    quaternion = quaternion_of(T_base_camera[:3, :3])
    return (
        f'<mujoco model="reduced"><compiler angle="radian"/><worldbody><body name="base">{joints}'
        f"{_inertial(model, data, on_base, T_base_world, np.zeros(3))}"
        f'<site name="base"/><site name="camera" pos="{_text(T_base_camera[:3, 3])}" quat="{_text(quaternion)}"/>'
        f'<site name="look_ahead" pos="{LOOK_AHEAD_M} 0 0"/>{hinges}</body></worldbody></mujoco>'
    )


def _inertial(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    bodies: list[int],
    T_base_world: Float[np.ndarray, "4 4"],
    origin_m: Float[np.ndarray, "3"],
) -> str:
    """Combined mass, centre and inertia of bodies, in base axes; the centre is relative to a point of the base [m]."""
    mass = model.body_mass[bodies]
    centres = data.xipos[bodies] @ T_base_world[:3, :3].T + T_base_world[:3, 3]
    centre = mass @ centres / mass.sum()
    inertia = np.zeros((3, 3))
    for body, m, offset in zip(bodies, mass, centres - centre, strict=True):
        axes = T_base_world[:3, :3] @ data.ximat[body].reshape(3, 3)
        inertia += axes @ np.diag(model.body_inertia[body]) @ axes.T
        inertia += m * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    six = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    return f'<inertial mass="{float(mass.sum())!r}" pos="{_text(centre - origin_m)}" fullinertia="{_text(six)}"/>'


def _text(values: Float[np.ndarray, " n"]) -> str:
    return " ".join(repr(float(value)) for value in values)
