"""Reads a robot's MJCF, prepares it for attachment to a scene, and derives its figures from the geometry.

The MJCF must have two wheel hinges and a camera. Missing parts are added: a free joint, and velocity servos on the
wheels. Wheel radius, track, footprint and camera pose follow from the geoms.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.errors import RobotError
from anm_mj.frames import T_GL_CV, rigid_transform
from anm_mj.robot.config import RobotConfig
from anm_mj.robot.geom_extent import height_range_m, radius_about_axis_m
from anm_mj.robot.part_names import RobotParts, find_parts, isolate_robot, unused_name
from anm_mj.robot.reduced_model import WheelMount, reduced_mjcf
from anm_mj.robot.wheels import Wheel, base_frame, disable_caster_friction, read_wheels, replace_wheel_contacts
from anm_mj.types import Footprint

FOOTPRINT_MARGIN_M = 0.01
"""The footprint is wider than the robot by this margin [m]."""
LOWEST_M = 0.05
"""Rugs and thresholds below this height are no obstacles [m]; scenes have no collision boxes there either."""
TOUCHES_FLOOR_M = 0.005
"""Geoms that begin below this height roll or slide on the floor: wheels and casters [m]."""
WHEELS = ("wheel_left", "wheel_right")
"""Names of the wheels in a reduced model."""
_FORWARD_COS = math.cos(math.radians(30.0))
_KV_PER_KG = 2.0 / (9.6 * 0.05**2)
"""Gain of a motor per mass and squared wheel radius [1/s], scaled from the servos of ``models/diff_drive``."""
_FORCE_PER_KV = 4.0


@dataclass(frozen=True, eq=False)
class RobotDescription:
    """A robot ready for simulation, and the figures that kinematics and planning need."""

    name: str
    spec: mujoco.MjSpec
    """The robot alone; copy it and attach the copy to a scene."""
    base_joint: str
    """Name of its free joint."""
    wheel_joints: tuple[str, str]
    """Left, right."""
    wheel_signs: tuple[float, float]
    """Left, right; -1 where the joint's positive direction rolls the wheel backwards."""
    motors: tuple[str, str]
    """Names of the wheels' velocity servos [rad/s]; left, right."""
    shell: tuple[str, ...]
    """Names of the geoms that should touch nothing: all but wheels and casters."""
    camera: str
    T_root_base: Float[np.ndarray, "4 4"]
    """Base (on the floor, midway between the wheels, x forward) to root body."""
    T_base_camera: Float[np.ndarray, "4 4"]
    """Camera to base; camera axes x right, y down, z forward."""
    wheel_radius_m: float
    track_m: float
    """Distance between the wheels' planes [m]."""
    mass_kg: float
    body_radius_m: float
    """Largest distance of the robot's geoms from the vertical axis through its base [m]."""
    footprint: Footprint
    reduced_mjcf: str
    """The reduced model, see :mod:`anm_mj.robot.reduced_model`."""
    hash: str
    """sha256 of the robot in MuJoCo's reading, meshes included."""


def describe_robot(path: Path, config: RobotConfig | None = None) -> RobotDescription:
    """Read a robot.

    Args:
        path: an MJCF file.
        config: names of its parts where they differ from the usual ones.

    Raises:
        RobotError: if the file cannot be read, lacks a part, or is no differential drive.
    """
    config = config or RobotConfig()
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except (ValueError, OSError) as err:
        raise RobotError(f"MuJoCo cannot read the robot {path} ({err}); give an MJCF file with one robot.") from err
    parts = find_parts(spec, config, path)
    isolate_robot(spec, parts)
    model = _compiled(spec, path)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)

    root = model.body(parts.root).id
    _require_rigid_mounts(model, root, parts, path)
    wheels = read_wheels(model, data, parts.wheels, path)
    T_world_base, track, signs = base_frame(*wheels, path)
    radius = wheels[0].radius_m
    T_root_base = np.linalg.inv(rigid_transform(data.xmat[root], data.xpos[root])) @ T_world_base
    T_base_camera = np.linalg.inv(T_world_base) @ _camera_pose(data, model.camera(parts.camera).id)
    if T_base_camera[0, 2] < _FORWARD_COS:
        raise RobotError(
            f"The camera {parts.camera} of {path} does not look forward, to where the wheels {parts.wheels[0]} (left) "
            f"and {parts.wheels[1]} (right) roll; swap the wheels' names, or turn the camera."
        )
    shell, casters = _shell_and_casters(model, data, wheels, float(T_world_base[2, 3]))
    footprint, body_radius = _footprint(model, data, shell, T_world_base)
    motors = _motors(spec, model, parts.wheels, radius)
    replace_wheel_contacts(spec, model, wheels)
    disable_caster_friction(spec, model, casters)
    shell_names = tuple(model.geom(geom).name for geom in shell)
    model = _compiled(spec, path)
    mounts = [
        WheelMount(name, wheel.body, np.array([0.0, side * track / 2.0, radius]), _armature(model, wheel.joint))
        for name, side, wheel in zip(WHEELS, (1.0, -1.0), wheels, strict=True)
    ]
    return RobotDescription(
        name=path.stem,
        spec=spec,
        base_joint=parts.base_joint,
        wheel_joints=parts.wheels,
        wheel_signs=signs,
        motors=motors,
        shell=shell_names,
        camera=parts.camera,
        T_root_base=T_root_base,
        T_base_camera=T_base_camera,
        wheel_radius_m=radius,
        track_m=track,
        mass_kg=float(model.body_subtreemass[root]),
        body_radius_m=body_radius,
        footprint=footprint,
        reduced_mjcf=reduced_mjcf(model, data, root, T_world_base, T_base_camera, (mounts[0], mounts[1])),
        hash=hashlib.sha256(spec.to_xml().encode() + model.mesh_vert.tobytes()).hexdigest(),
    )


def _compiled(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    try:
        return spec.compile()
    except ValueError as err:
        raise RobotError(
            f"The robot {path} cannot be compiled by itself ({err}); fix that, or remove references to elements "
            "outside the robot."
        ) from err


def _require_rigid_mounts(model: mujoco.MjModel, root: int, parts: RobotParts, path: Path) -> None:
    """Raises RobotError if a joint lies between the base and a wheel or the camera."""
    for name in parts.wheels:
        if model.body_weldid[model.body_parentid[model.joint(name).bodyid[0]]] != root:
            raise RobotError(f"The wheel {name} of {path} hangs on another joint; mount it on the base rigidly.")
    if model.body_weldid[model.camera(parts.camera).bodyid[0]] != root:
        raise RobotError(f"The camera {parts.camera} of {path} is moved by a joint; mount it on the base rigidly.")


def _armature(model: mujoco.MjModel, joint: str) -> float:
    return float(model.dof_armature[model.joint(joint).dofadr[0]])


def _camera_pose(data: mujoco.MjData, camera: int) -> Float[np.ndarray, "4 4"]:
    """Camera to world; camera axes x right, y down, z forward."""
    return rigid_transform(data.cam_xmat[camera], data.cam_xpos[camera]) @ T_GL_CV


def _motors(spec: mujoco.MjSpec, model: mujoco.MjModel, wheels: tuple[str, str], radius_m: float) -> tuple[str, str]:
    """Names of the velocity servos on the wheels; adds missing ones and removes other actuators on the wheels."""
    kv = _KV_PER_KG * float(model.body_subtreemass[0]) * radius_m**2
    names = []
    for wheel in wheels:
        on_wheel = [actuator for actuator in spec.actuators if actuator.target == wheel]
        servo = next((a for a in on_wheel if _is_velocity_servo(model, model.actuator(a.name).id)), None)
        for actuator in on_wheel:
            if actuator is not servo:
                spec.delete(actuator)
        if servo is None:
            name = unused_name(f"{wheel}_motor", spec.actuator)
            servo = spec.add_actuator(name=name, target=wheel, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            servo.gainprm[0], servo.biasprm[2], servo.biastype = kv, -kv, mujoco.mjtBias.mjBIAS_AFFINE
            servo.forcelimited, servo.forcerange = True, [-_FORCE_PER_KV * kv, _FORCE_PER_KV * kv]
        names.append(servo.name)
    return names[0], names[1]


def _is_velocity_servo(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether an actuator on a joint controls its velocity in the joint's own unit."""
    gain, bias = float(model.actuator_gainprm[actuator, 0]), model.actuator_biasprm[actuator].tolist()
    plain = model.actuator_gear[actuator, 0] == 1.0 and model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_NONE
    return bool(plain) and gain > 0.0 and bias[1] == 0.0 and bias[2] == -gain


def _shell_and_casters(
    model: mujoco.MjModel, data: mujoco.MjData, wheels: tuple[Wheel, Wheel], floor_z_m: float
) -> tuple[list[int], list[int]]:
    """Solid geoms other than the wheels: the shell, which is clear of the floor, and the casters, which touch it."""
    on_wheels = [wheel.body for wheel in wheels]
    solid = [g for g in _solid(model) if model.geom_bodyid[g] not in on_wheels]
    low = [g for g in solid if height_range_m(model, data, g)[0] - floor_z_m <= TOUCHES_FLOOR_M]
    return [g for g in solid if g not in low], low


def _solid(model: mujoco.MjModel) -> list[int]:
    """Indices of geoms that can touch something."""
    return np.flatnonzero(model.geom_contype | model.geom_conaffinity).tolist()


def _footprint(
    model: mujoco.MjModel, data: mujoco.MjData, shell: list[int], T_world_base: Float[np.ndarray, "4 4"]
) -> tuple[Footprint, float]:
    """The upright cylinder about the base that encloses the robot, and the radius of the robot itself [m]."""
    solid = _solid(model)
    floor_z = float(T_world_base[2, 3])
    radius = max(radius_about_axis_m(model, data, g, T_world_base[:2, 3]) for g in solid)
    lowest = min((height_range_m(model, data, g)[0] for g in shell), default=floor_z) - floor_z
    highest = max(height_range_m(model, data, g)[1] for g in solid) - floor_z
    footprint = Footprint(
        radius_m=round(radius + FOOTPRINT_MARGIN_M, 6),
        z_min_m=round(max(lowest, LOWEST_M), 6),
        z_max_m=round(max(highest, LOWEST_M + 0.05), 6),
    )
    return footprint, round(radius, 6)
