"""Reads the wheels of a robot from its geoms and adapts their contacts so that they roll in simulation."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.errors import RobotError
from anm_mj.robot.geom_extent import height_range_m, support_m
from anm_mj.robot.part_names import unused_name

ALIKE_M = 1e-3
"""Largest difference between the radii of the wheels and between the heights of their axles [m]."""
_MIN_ARMATURE = 0.04
"""Least motor inertia per mass and squared wheel radius; with less, wheels of light robots chatter at 2 ms."""
_ROUND = (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID)


@dataclass(frozen=True, eq=False)
class Wheel:
    """One wheel of a compiled robot, in world coordinates."""

    joint: str
    body: int
    geoms: tuple[int, ...]
    """Geoms that touch the floor."""
    centre_m: Float[np.ndarray, "3"]
    """Centre of those geoms, on the axle."""
    axis: Float[np.ndarray, "3"]
    """Unit axis of the hinge."""
    radius_m: float
    half_width_m: float
    centre_in_body_m: Float[np.ndarray, "3"]
    """The same centre, in the axes of the wheel's body."""


def read_wheels(model: mujoco.MjModel, data: mujoco.MjData, joints: tuple[str, str], path: Path) -> tuple[Wheel, Wheel]:
    """The left and the right wheel of a robot at the positions in ``data``.

    Raises:
        RobotError: if a wheel has no geom, its hinge has a range, or the radii differ.
    """
    left, right = (_wheel(model, data, joint, path) for joint in joints)
    if left.radius_m <= 0.0 or abs(left.radius_m - right.radius_m) > ALIKE_M:
        raise RobotError(
            f"The wheels of {path} reach {left.radius_m:.4f} m and {right.radius_m:.4f} m below their axes; they must "
            "be alike."
        )
    return left, right


def base_frame(left: Wheel, right: Wheel, path: Path) -> tuple[Float[np.ndarray, "4 4"], float, tuple[float, float]]:
    """``T_world_base`` (on the floor midway between the wheels, x forward), the track [m], and the sign of each hinge.

    Raises:
        RobotError: if the wheels do not share one level axle.
    """
    across = left.centre_m - right.centre_m
    track_m = float(np.linalg.norm(across))
    y_axis = across / max(track_m, 1e-9)
    signs = np.array([left.axis @ y_axis, right.axis @ y_axis])
    if track_m < 0.02 or abs(across[2]) > ALIKE_M or np.abs(signs).min() < 1.0 - 1e-4:
        raise RobotError(
            f"The wheels of {path} turn about {left.axis.round(3)} at {left.centre_m.round(3)} and about "
            f"{right.axis.round(3)} at {right.centre_m.round(3)}; they must share one level axle."
        )
    middle = (left.centre_m + right.centre_m) / 2.0
    T_world_base = np.eye(4)
    T_world_base[:3, 0] = np.cross(y_axis, [0.0, 0.0, 1.0])
    T_world_base[:3, 1] = y_axis
    T_world_base[:3, 3] = [middle[0], middle[1], middle[2] - left.radius_m]
    return T_world_base, track_m, (float(np.sign(signs[0])), float(np.sign(signs[1])))


def replace_wheel_contacts(spec: mujoco.MjSpec, model: mujoco.MjModel, wheels: tuple[Wheel, Wheel]) -> None:
    """Give every wheel a point contact, and its motor a minimal inertia.

    A cylinder touches the floor along a line, whose two ends scrub in every turn. An ellipsoid of the same size
    replaces its contact; the cylinder stays visible. Ellipsoids and spheres stay unchanged.
    """
    mass_kg = float(model.body_mass.sum())
    for wheel in wheels:
        joint = spec.joint(wheel.joint)
        joint.armature = max(joint.armature, _MIN_ARMATURE * mass_kg * wheel.radius_m**2)
        if all(model.geom_type[geom] in _ROUND for geom in wheel.geoms):
            continue
        for geom in wheel.geoms:
            solid = spec.geom(model.geom(geom).name)
            solid.contype = solid.conaffinity = 0
        quaternion = np.empty(4)
        body_axis = model.jnt_axis[model.joint(wheel.joint).id]
        mujoco.mju_quatZ2Vec(quaternion, body_axis)
        touching = model.geom(wheel.geoms[0])
        spec.body(model.body(wheel.body).name).add_geom(
            name=unused_name(f"{wheel.joint}_contact", spec.geom),
            type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
            size=[wheel.radius_m, wheel.radius_m, wheel.half_width_m],
            pos=wheel.centre_in_body_m,
            quat=quaternion,
            friction=touching.friction,
            priority=int(touching.priority[0]),
            mass=0.0,
            group=4,
        )


def disable_caster_friction(spec: mujoco.MjSpec, model: mujoco.MjModel, casters: list[int]) -> None:
    """Remove the friction of caster geoms, whatever the friction of the floor."""
    for caster in casters:
        geom = spec.geom(model.geom(caster).name)
        geom.condim, geom.priority = 1, max(geom.priority, 1)


def _wheel(model: mujoco.MjModel, data: mujoco.MjData, name: str, path: Path) -> Wheel:
    joint = model.joint(name).id
    body = int(model.jnt_bodyid[joint])
    geoms = np.flatnonzero(model.geom_bodyid == body).tolist()
    touching = [g for g in geoms if model.geom_contype[g] or model.geom_conaffinity[g]] or geoms
    if not touching:
        raise RobotError(f"The wheel {name} of {path} has no geom; give it one, best an ellipsoid.")
    if model.jnt_limited[joint]:
        low, high = np.degrees(model.jnt_range[joint])
        raise RobotError(
            f"The wheel {name} of {path} turns within {low:g} and {high:g} degrees only; remove its hinge's range."
        )
    anchor, axis = data.xanchor[joint].copy(), data.xaxis[joint].copy()
    reach = np.array([support_m(model, data, geom, np.stack([axis, -axis])) for geom in touching])
    far, near = reach[:, 0].max() - anchor @ axis, -reach[:, 1].max() - anchor @ axis
    lowest = min(height_range_m(model, data, geom)[0] for geom in touching)
    centre = anchor + axis * (far + near) / 2.0
    return Wheel(
        joint=name,
        body=body,
        geoms=tuple(touching),
        centre_m=centre,
        axis=axis,
        radius_m=round(float(anchor[2] - lowest), 9),
        half_width_m=float(far - near) / 2.0,
        centre_in_body_m=data.xmat[body].reshape(3, 3).T @ (centre - data.xpos[body]),
    )
