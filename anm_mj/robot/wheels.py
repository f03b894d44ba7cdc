"""Wheels and casters: reads the driven wheels of a robot from its geoms and adapts their contacts so that they roll in
simulation; what else stands on the floor slides there without friction.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.errors import RobotError
from anm_mj.robot.compiled_robot import CompiledRobot, height_range_m, lowest_m, support_m, unused_name

ALIKE_M = 1e-3
"""Largest difference between the radii of the wheels and between the heights of their axles [m]."""
_ENDLESS_RAD = 20.0 * math.tau
"""A hinge with a wider range than this turns without end; converters write ranges of 1e5 degrees [rad]."""
_LEAST_TRACK_M = 0.02
"""Wheels that are nearer to each other belong to a file that is not in metres, or share no axle [m]."""
_MIN_ARMATURE = 0.04
"""Least motor inertia per mass and squared wheel radius; with less, wheels of light robots chatter at 2 ms."""
TOUCHES_FLOOR_M = 0.005
"""Geoms that begin below this height roll or slide on the floor: wheels and casters [m]."""
_SINKS_M = 2e-4
"""A caster that reaches farther below the wheels would carry the robot instead of them [m]."""
_TOO_LOW_M = 0.03
"""What reaches farther below the wheels is no caster [m]."""
_SPHERE_M = 0.008


@dataclass(frozen=True, eq=False)
class Wheel:
    """One wheel of a compiled robot, in world coordinates."""

    joint: str
    body: int
    geoms: tuple[int, ...]
    centre_m: Float[np.ndarray, "3"]
    """Centre of those geoms, on the axle."""
    axis: Float[np.ndarray, "3"]
    """Unit axis of the hinge."""
    radius_m: float
    half_width_m: float
    centre_in_body_m: Float[np.ndarray, "3"]
    """The same centre, in the axes of the wheel's body."""


def free_endless_hinges(spec: mujoco.MjSpec, model: mujoco.MjModel) -> bool:
    """Remove the ranges of hinges that are wider than 20 turns; whether there was one."""
    limited = (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE) & (model.jnt_limited != 0)
    found = np.flatnonzero(limited & (np.ptp(model.jnt_range, axis=1) > _ENDLESS_RAD))
    for joint in found:
        spec.joint(model.joint(joint).name).limited = mujoco.mjtLimited.mjLIMITED_FALSE
    return len(found) > 0


def read_wheels(
    model: mujoco.MjModel, data: mujoco.MjData, left: tuple[str, ...], right: tuple[str, ...], path: Path
) -> tuple[list[Wheel], list[Wheel]]:
    """The left and the right wheels of a robot at the positions in ``data``. Raises RobotError if a wheel has no geom,
    its hinge has a range, or the radii differ.
    """
    lefts, rights = ([_wheel(model, data, joint, path) for joint in joints] for joints in (left, right))
    radii = [wheel.radius_m for wheel in (*lefts, *rights)]
    if min(radii) <= 0.0 or max(radii) - min(radii) > ALIKE_M:
        reach = " and ".join(f"{radius:.4f} m" for radius in radii)
        raise RobotError(f"The wheels of {path} reach {reach} below their axes; they must be alike.")
    return lefts, rights


def base_frame(
    lefts: list[Wheel], rights: list[Wheel], path: Path
) -> tuple[Float[np.ndarray, "4 4"], float, tuple[float, ...]]:
    """``T_world_base`` (on the floor in the middle of the wheels, x forward), the track [m], and each hinge's sign.

    Signs are those of the left wheels, then of the right ones. Raises RobotError if the wheels' axles are not parallel
    and level, or two wheels do not share one axle.
    """
    left, right = (np.mean([wheel.centre_m for wheel in side], axis=0) for side in (lefts, rights))
    across = left - right
    # Meshes of wheels end a few micrometres apart.
    uneven = max(wheel.centre_m[2] for wheel in (*lefts, *rights)) - min(w.centre_m[2] for w in (*lefts, *rights))
    across[2] = 0.0
    track_m = float(np.linalg.norm(across))
    y_axis = across / max(track_m, 1e-9)
    wheels = (*lefts, *rights)
    signs = np.array([wheel.axis @ y_axis for wheel in wheels])
    if 0.0 < track_m < _LEAST_TRACK_M and np.abs(signs).min() > 0.9:
        raise RobotError(
            f"The wheels of {path} are {1000.0 * track_m:.2g} mm apart; MuJoCo's unit is the metre: scale the file."
        )
    if track_m < _LEAST_TRACK_M or uneven > ALIKE_M or np.abs(signs).min() < 1.0 - 1e-4:
        turn = " and about ".join(f"{wheel.axis.round(3)} at {wheel.centre_m.round(3)}" for wheel in wheels)
        shared = "share one level axle" if len(wheels) == 2 else "have parallel level axles, as far on either side"
        raise RobotError(f"The wheels of {path} turn about {turn}; they must {shared}.")
    middle = (left + right) / 2.0
    T_world_base = np.eye(4)
    T_world_base[:3, 0] = np.cross(y_axis, [0.0, 0.0, 1.0])
    T_world_base[:3, 1] = y_axis
    T_world_base[:3, 3] = [middle[0], middle[1], middle[2] - lefts[0].radius_m]
    return T_world_base, track_m, tuple(float(sign) for sign in np.sign(signs))


def least_armature(model: mujoco.MjModel, radius_m: float) -> float:
    """The least inertia of the motor of a wheel of a radius [m], with which it drives steadily [kg m^2]."""
    return _MIN_ARMATURE * float(model.body_mass.sum()) * radius_m**2


def replace_wheel_contacts(spec: mujoco.MjSpec, model: mujoco.MjModel, wheels: list[Wheel]) -> None:
    """Give every wheel a point contact, and its motor a minimal inertia.

    A cylinder touches the floor along a line, whose two ends scrub in every turn. An ellipsoid of the same size
    replaces the contact of every wheel; what was there stays visible.
    """
    for wheel in wheels:
        joint = spec.joint(wheel.joint)
        joint.armature = max(joint.armature, least_armature(model, wheel.radius_m))
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
            # Explicit, because the file's defaults may be for other bodies: without friction, without contacts, or with
            # a margin, which would carry the robot.
            contype=1,
            conaffinity=1,
            condim=max(int(touching.condim[0]), 3),
            friction=touching.friction,
            priority=int(touching.priority[0]),
            margin=0.0,
            gap=0.0,
            mass=0.0,
            group=4,
        )


def let_casters_slide(
    robot: CompiledRobot, casters: list[int], root: str, T_world_base: Float[np.ndarray, "4 4"]
) -> list[str]:
    """Remove the friction of caster geoms, whatever the friction of the floor; what was changed besides.

    Suspensions are locked, so a caster that reaches below the wheels would lift them. A small sphere that ends on the
    floor replaces its contact. Raises RobotError if something reaches far below the wheels.
    """
    spec, model, data, shortened = robot.spec, robot.model, robot.data, []
    for caster in casters:
        name = model.geom(caster).name
        geom = spec.geom(name)
        sinks_m = float(T_world_base[2, 3]) - height_range_m(model, data, caster)[0]
        if sinks_m > _TOO_LOW_M:
            raise RobotError(
                f"The geom {name} of {robot.path} reaches {100 * sinks_m:.1f} cm below the wheels, so that they do not "
                "touch the floor; raise it, or name the wheels that the robot stands on by --set "
                "model.left_wheel=NAME --set model.right_wheel=NAME."
            )
        geom.condim, geom.priority = 1, max(geom.priority, 1)
        geom.margin = geom.gap = 0.0
        if sinks_m > _SINKS_M:
            geom.contype = geom.conaffinity = 0
            place = np.append(lowest_xy_m(model, data, caster), T_world_base[2, 3] + _SPHERE_M)
            body = model.body(root).id
            local = data.xmat[body].reshape(3, 3).T @ (place - data.xpos[body])
            spec.body(root).add_geom(
                name=unused_name(f"{name}_contact", spec.geom),
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                size=[_SPHERE_M, 0.0, 0.0],
                pos=local,
                condim=1,
                priority=max(int(geom.priority), 1),
                margin=0.0,
                gap=0.0,
                mass=0.0,
                group=4,
            )
            shortened.append(f"{name} (by {1000 * sinks_m:.1f} mm)")
    return [f"casters shortened to the height of the wheels: {', '.join(shortened)}"] if shortened else []


def lowest_xy_m(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Float[np.ndarray, "2"]:
    """Where a geom touches the floor [m]: the mean of a mesh's lowest vertices, else below its centre."""
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        world = model.mesh_vert[first : first + count] @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        return world[world[:, 2] < world[:, 2].min() + 1e-3, :2].mean(axis=0)
    return data.geom_xpos[geom, :2].copy()


def _wheel(model: mujoco.MjModel, data: mujoco.MjData, name: str, path: Path) -> Wheel:
    joint = model.joint(name).id
    body = int(model.jnt_bodyid[joint])
    # A tyre may be a body of its own, fixed to the one that turns.
    geoms = np.flatnonzero(model.body_weldid[model.geom_bodyid] == body).tolist()
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
    lowest = lowest_m(model, data, touching)
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
