"""Reads a robot's MJCF, prepares it for attachment to a scene, and derives its figures from the geometry.

The MJCF must have driven wheels or planar joints; a camera is mounted where it has none. All other joints are locked.
Missing parts are added: a free joint, and velocity servos on the wheels. Wheel radius, track, footprint and camera pose
follow from the geoms.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.errors import RobotError
from anm_mj.frames import rigid_transform
from anm_mj.robot.base_search import HOLONOMIC, MovingParts, find_moving_parts
from anm_mj.robot.body_tree import name_all, solid_geoms, unused_name
from anm_mj.robot.camera_config import CameraConfig
from anm_mj.robot.camera_mount import remount_camera, upright_camera
from anm_mj.robot.camera_search import (
    T_world_camera,
    camera_heading,
    find_camera,
    mount_camera,
    require_field_of_view,
    require_outside,
    require_view_ahead,
    use_field_of_view,
)
from anm_mj.robot.casters import TOUCHES_FLOOR_M, let_casters_slide, lowest_xy_m
from anm_mj.robot.config import RobotConfig
from anm_mj.robot.footprint import require_size, robot_footprint
from anm_mj.robot.geom_extent import height_range_m
from anm_mj.robot.isolate import give_free_joint, isolate_robot
from anm_mj.robot.joint_positions import at_key_frame
from anm_mj.robot.lock_joints import hangs_on_joint, lock_joints
from anm_mj.robot.planar_base import give_planar_joints, planar_base_frame
from anm_mj.robot.reduced_model import WheelMount, reduced_mjcf
from anm_mj.robot.servos import fit_servos
from anm_mj.robot.wheels import base_frame, free_endless_hinges, read_wheels, replace_wheel_contacts
from anm_mj.types import Footprint

Mount = tuple[CameraConfig, int]
"""What differs from the robot's camera, and the image size where that does not say [px]."""
WHEELS = ("wheel_left", "wheel_right")
"""Names of the wheels in a reduced model."""
_BODY_M = 0.15
"""What touches the floor and reaches higher than this is a body that drags rather than a caster [m]."""


@dataclass(frozen=True, eq=False)
class RobotDescription:
    """A robot ready for simulation, and the figures that kinematics and planning need."""

    name: str
    kind: str
    """``differential``, ``skid steer`` or ``holonomic``."""
    spec: mujoco.MjSpec
    """The robot alone; copy it and attach the copy to a scene."""
    root: str
    """Name of its top-level body."""
    base_joints: tuple[str, ...]
    """Name of its free joint; of a holonomic base two slides and a hinge, whose positions are x, y and yaw."""
    wheel_joints: tuple[str, ...]
    """Left ones, then as many right ones; none on a holonomic base."""
    wheel_signs: tuple[float, ...]
    """For each of them; -1 where the joint's positive direction rolls the wheel backwards."""
    motors: tuple[str, ...]
    """Names of the velocity servos of the wheels [rad/s]; of a holonomic base those of its joints [m/s, m/s, rad/s]."""
    max_wheel_radps: float
    """Highest speed of a wheel that the file allows [rad/s]; infinite without a limit."""
    shell: tuple[str, ...]
    """Names of the geoms that should touch nothing: all but wheels and casters."""
    camera: str
    T_root_base: Float[np.ndarray, "4 4"]
    """Base (on the floor, midway between the wheels, x forward) to root body."""
    T_base_camera: Float[np.ndarray, "4 4"]
    """Camera to base; camera axes x right, y down, z forward."""
    fovy_deg: float
    """Vertical field of view of the camera [deg]."""
    wheel_radius_m: float
    """0 for a holonomic base."""
    track_m: float
    """Distance between the wheels' planes [m]; 0 for a holonomic base."""
    track_scale: float
    """Effective track over ``track_m``, for odometry."""
    mass_kg: float
    body_radius_m: float
    """Largest distance of the robot's geoms from the vertical axis through its base [m]."""
    footprint: Footprint
    support_xy_m: Float[np.ndarray, "n 2"]
    """Where wheels and casters touch the floor, in the base [m]."""
    centre_of_mass_m: Float[np.ndarray, "3"]
    """In the base [m]."""
    reduced_mjcf: str
    """The reduced model, see :mod:`anm_mj.robot.reduced_model`."""
    hash: str
    """sha256 of the robot in MuJoCo's reading, meshes included."""
    key_frame: str
    """Key frame at which joints were locked; empty = their reference positions."""
    locked: tuple[str, ...]
    """Names of the locked joints."""
    notes: tuple[str, ...]
    """What else was changed, one sentence each."""


def describe_robot(
    path: Path, config: RobotConfig | None = None, camera: CameraConfig | None = None, image_px: int = 256
) -> RobotDescription:
    """Read a robot.

    Args:
        path: an MJCF file.
        config: how to read it where the file leaves that open.
        camera: what differs from its camera.
        image_px: width and height of its image where ``camera`` does not say [px].

    Raises:
        RobotError: if the file cannot be read, lacks a part, or does not move over a floor.
    """
    config, mount = config or RobotConfig(), (camera or CameraConfig(), image_px)
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except (ValueError, OSError) as err:
        raise RobotError(f"MuJoCo cannot read the robot {path} ({err}); give an MJCF file with one robot.") from err
    name_all(spec.bodies, "body")
    name_all(spec.joints, "joint")
    # A URDF's base, fused with the world, would be gone.
    spec.compiler.fusestatic = False
    model = _compiled(spec, path)
    if free_endless_hinges(spec, model):
        model = _compiled(spec, path)
    data, key_frame = at_key_frame(model, config.keyframe, path)
    ahead = camera_heading(model, data, config)
    parts = find_moving_parts(model, data, config, path, ahead)
    if parts.kind == HOLONOMIC:
        # The key frame's place in the plane is not the robot's shape.
        for name in parts.planar:
            data.joint(name).qpos[:] = model.qpos0[model.joint(name).qposadr]
        mujoco.mj_forward(model, data)
        ahead = camera_heading(model, data, config)
    locked = lock_joints(spec, model, data, {*parts.left, *parts.right}, parts.root)
    # Joints of the planar chain are locked too, but ours take their place.
    locked = [name for name in locked if name not in parts.planar]
    T_world_base = planar_base_frame(model, data, parts.planar, ahead) if parts.kind == HOLONOMIC else None
    T_world_root = rigid_transform(data.xmat[model.body(parts.root).id], data.xpos[model.body(parts.root).id])
    isolate_robot(spec, parts.root)
    if T_world_base is None:
        return _wheeled(spec, parts, config, path, mount, key_frame, locked)
    return _holonomic(spec, parts, config, path, mount, key_frame, locked, np.linalg.inv(T_world_root) @ T_world_base)


def _wheeled(
    spec: mujoco.MjSpec,
    parts: MovingParts,
    config: RobotConfig,
    path: Path,
    mount: Mount,
    key_frame: str,
    locked: list[str],
) -> RobotDescription:
    base_joint = give_free_joint(spec, parts.root, unused_name("base", spec.joint))
    model, data = _at_rest(spec, path)
    root = model.body(parts.root).id
    lefts, rights = read_wheels(model, data, parts.left, parts.right, path)
    T_world_base, track, signs = base_frame(lefts, rights, path)
    radius, wheels = lefts[0].radius_m, [*lefts, *rights]
    T_root_base = np.linalg.inv(_body_pose(data, root)) @ T_world_base
    rolls = f"the wheels {', '.join(parts.left)} (left) and {', '.join(parts.right)} (right) roll"
    camera, T_base_camera, fovy_deg, odd = _camera(spec, config, parts, T_root_base, T_world_base, rolls, path, mount)

    on_wheels = {wheel.body for wheel in wheels}
    shell, casters = _shell_and_casters(model, data, on_wheels, float(T_world_base[2, 3]))
    footprint, body_radius = robot_footprint(model, data, T_world_base)
    require_size(footprint, path)
    motors, top_radps, notes = fit_servos(spec, model, (*parts.left, *parts.right), radius)
    support = [wheel.centre_m[:2] for wheel in wheels] + [lowest_xy_m(model, data, g) for g in casters]
    replace_wheel_contacts(spec, model, wheels)
    notes += odd + let_casters_slide(spec, model, data, casters, parts.root, T_world_base, path)
    shell_names = tuple(model.geom(geom).name for geom in shell)
    model = _compiled(spec, path)
    mounts = tuple(
        WheelMount(
            name,
            tuple(wheel.body for wheel in side),
            np.array([0.0, sign * track / 2.0, radius]),
            sum(_armature(model, wheel.joint) for wheel in side),
        )
        for name, sign, side in zip(WHEELS, (1.0, -1.0), (lefts, rights), strict=True)
    )
    T_base_world = np.linalg.inv(T_world_base)
    return RobotDescription(
        name=path.stem,
        kind=parts.kind,
        spec=spec,
        root=parts.root,
        base_joints=(base_joint,),
        wheel_joints=(*parts.left, *parts.right),
        wheel_signs=signs,
        motors=motors,
        max_wheel_radps=top_radps,
        shell=shell_names,
        camera=camera,
        T_root_base=T_root_base,
        T_base_camera=T_base_camera,
        fovy_deg=fovy_deg,
        wheel_radius_m=radius,
        track_m=track,
        track_scale=config.track_scale,
        mass_kg=float(model.body_subtreemass[root]),
        body_radius_m=body_radius,
        footprint=footprint,
        support_xy_m=np.array(support) @ T_base_world[:2, :2].T + T_base_world[:2, 3],
        centre_of_mass_m=T_base_world[:3, :3] @ data.subtree_com[root] + T_base_world[:3, 3],
        reduced_mjcf=reduced_mjcf(model, data, root, T_world_base, T_base_camera, mounts),
        hash=_hash(spec, model),
        key_frame=key_frame,
        locked=tuple(locked),
        notes=tuple(notes),
    )


def _holonomic(
    spec: mujoco.MjSpec,
    parts: MovingParts,
    config: RobotConfig,
    path: Path,
    mount: Mount,
    key_frame: str,
    locked: list[str],
    T_root_base: Float[np.ndarray, "4 4"],
) -> RobotDescription:
    model, data = _at_rest(spec, path)
    root = model.body(parts.root).id
    T_world_base = _body_pose(data, root) @ T_root_base
    along = f"the base slides along {parts.planar[0]}"
    camera, T_base_camera, fovy_deg, odd = _camera(spec, config, parts, T_root_base, T_world_base, along, path, mount)
    shell, casters = _shell_and_casters(model, data, set(), float(T_world_base[2, 3]))
    if not shell and not casters:
        raise RobotError(f"The robot {path} has no solid geom, so nothing shows its size; give its body one.")
    footprint, body_radius = robot_footprint(model, data, T_world_base)
    require_size(footprint, path)
    mass = float(model.body_subtreemass[root])
    joints, motors = give_planar_joints(spec, parts.root, T_root_base, mass, body_radius)
    notes = odd + let_casters_slide(spec, model, data, casters, parts.root, T_world_base, path)
    shell_names = tuple(model.geom(geom).name for geom in shell)
    support = np.array([lowest_xy_m(model, data, g) for g in casters]).reshape(-1, 2)
    T_base_world = np.linalg.inv(T_world_base)
    reduced = reduced_mjcf(model, data, root, T_world_base, T_base_camera, ())
    centre = T_base_world[:3, :3] @ data.subtree_com[root] + T_base_world[:3, 3]
    model = _compiled(spec, path)
    return RobotDescription(
        name=path.stem,
        kind=HOLONOMIC,
        spec=spec,
        root=parts.root,
        base_joints=joints,
        wheel_joints=(),
        wheel_signs=(),
        motors=motors,
        max_wheel_radps=float("inf"),
        shell=shell_names,
        camera=camera,
        T_root_base=T_root_base,
        T_base_camera=T_base_camera,
        fovy_deg=fovy_deg,
        wheel_radius_m=0.0,
        track_m=0.0,
        track_scale=1.0,
        mass_kg=mass,
        body_radius_m=body_radius,
        footprint=footprint,
        support_xy_m=support @ T_base_world[:2, :2].T + T_base_world[:2, 3],
        centre_of_mass_m=centre,
        reduced_mjcf=reduced,
        hash=_hash(spec, model),
        key_frame=key_frame,
        locked=tuple(locked),
        notes=tuple(notes),
    )


def _camera(
    spec: mujoco.MjSpec,
    config: RobotConfig,
    parts: MovingParts,
    T_root_base: Float[np.ndarray, "4 4"],
    T_world_base: Float[np.ndarray, "4 4"],
    rolls: str,
    path: Path,
    mount: Mount,
) -> tuple[str, Float[np.ndarray, "4 4"], float, list[str]]:
    """Find or mount the camera: its name, its pose in the base, its vertical field of view [deg], and what is odd."""
    note = ""
    if config.mounted_camera is not None:
        camera = mount_camera(spec, parts.root, T_root_base, config.mounted_camera)
    else:
        model, data = _at_rest(spec, path)
        camera = find_camera(model, data, config, parts.root, T_world_base, path)
        if hangs_on_joint(model, int(model.camera(camera).bodyid[0]), {*parts.left, *parts.right}):
            raise RobotError(f"The camera {camera} of {path} turns with a wheel; mount it on the base rigidly.")
        use_field_of_view(spec, model, camera)
        note = upright_camera(spec, model, data, camera, T_world_base)
    model, data = _at_rest(spec, path)
    remount_camera(spec, model, data, camera, T_world_base, *mount)
    model, data = _at_rest(spec, path)
    T_base_camera = np.linalg.inv(T_world_base) @ T_world_camera(model, data, camera)
    require_view_ahead(T_base_camera, camera, rolls, path)
    require_outside(spec, camera, "mounted" if config.mounted_camera else "file", path)
    fovy_deg = float(model.cam_fovy[model.camera(camera).id])
    require_field_of_view(fovy_deg, camera, path)
    return camera, T_base_camera, fovy_deg, [note] if note else []


def _at_rest(spec: mujoco.MjSpec, path: Path) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = _compiled(spec, path)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def _body_pose(data: mujoco.MjData, body: int) -> Float[np.ndarray, "4 4"]:
    return rigid_transform(data.xmat[body], data.xpos[body])


def _compiled(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    try:
        return spec.compile()
    except ValueError as err:
        raise RobotError(
            f"The robot {path} cannot be compiled by itself ({err}); fix that, or remove references to elements "
            "outside the robot."
        ) from err


def _hash(spec: mujoco.MjSpec, model: mujoco.MjModel) -> str:
    return hashlib.sha256(spec.to_xml().encode() + model.mesh_vert.tobytes()).hexdigest()


def _armature(model: mujoco.MjModel, joint: str) -> float:
    return float(model.dof_armature[model.joint(joint).dofadr[0]])


def _shell_and_casters(
    model: mujoco.MjModel, data: mujoco.MjData, on_wheels: set[int], floor_z_m: float
) -> tuple[list[int], list[int]]:
    """Solid geoms other than the wheels: the shell, which should touch nothing, and the casters, which touch the floor.

    A body that reaches down to the floor is both.
    """
    solid = [g for g in solid_geoms(model) if int(model.body_weldid[model.geom_bodyid[g]]) not in on_wheels]
    heights = {g: np.array(height_range_m(model, data, g)) - floor_z_m for g in solid}
    low = [g for g in solid if heights[g][0] <= TOUCHES_FLOOR_M]
    return [g for g in solid if g not in low or heights[g][1] > _BODY_M], low
