"""Reads a robot's MJCF, prepares it for attachment to a scene, and derives its figures from the geometry.

The MJCF must have driven wheels or planar joints; a camera is mounted where it has none. All other joints are locked.
Missing parts are added: a free joint, and velocity servos on the wheels. Wheel radius, track, footprint and camera pose
follow from the geoms.
"""

import hashlib
import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.errors import RobotError
from anm_mj.mjcf.poses import body_pose, camera_pose
from anm_mj.mjcf.read_mjcf import OutsideError, compile_spec, read_spec
from anm_mj.robot.compiled_robot import (
    CompiledRobot,
    height_range_m,
    name_all,
    require_size,
    robot_footprint,
    solid_geoms,
    unused_name,
)
from anm_mj.robot.drive_joints import HOLONOMIC, DriveJoints, find_drive_joints
from anm_mj.robot.isolate import give_free_joint, hangs_on_joint, isolate_robot, keep_masses, lock_joints
from anm_mj.robot.joint_positions import at_key_frame
from anm_mj.robot.reduced_model import reduced_mjcf
from anm_mj.robot.robot_camera import (
    camera_heading,
    find_camera,
    mount_camera,
    remount_camera,
    require_field_of_view,
    require_outside,
    require_view_ahead,
    upright_camera,
    use_field_of_view,
)
from anm_mj.robot.robot_config import CameraConfig, RobotConfig
from anm_mj.robot.robot_presets import FOLDERS_VARIABLE, robot_folders
from anm_mj.robot.servos import fit_servos, give_planar_joints, planar_base_frame
from anm_mj.robot.wheels import (
    TOUCHES_FLOOR_M,
    Wheel,
    base_frame,
    free_endless_hinges,
    let_casters_slide,
    lowest_xy_m,
    read_wheels,
    replace_wheel_contacts,
)
from anm_mj.types import Footprint

_SLOWEST_MPS = 0.01
"""The slowest robot that the physics drive waits for; a step takes the longer, the slower it is [m/s]."""
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
    notes: tuple[str, ...]
    """What else was changed, one sentence each."""


def describe_robot(
    path: Path,
    config: RobotConfig | None = None,
    camera: CameraConfig | None = None,
    image_px: int = 256,
    *,
    given: mujoco.MjSpec | None = None,
    most_radps: Mapping[str, float] | None = None,
) -> RobotDescription:
    """Read a robot from an MJCF file.

    ``config`` says how where the file leaves that open, ``camera`` what differs from its camera, and ``image_px`` the
    width and height of its image where ``camera`` does not [px]. ``given`` is what another reader made of the file,
    which is changed, and ``most_radps`` the highest speeds of hinges, by name, that it does not hold [rad/s]. Raises
    RobotError if the file cannot be read, lacks a part, or does not move over a floor.
    """
    config, camera = config or RobotConfig(), camera or CameraConfig()
    spec = given or _read(path)
    name_all(spec.bodies, "body")
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_FREE and not joint.name:
            joint.name = unused_name("base", spec.joint)
    name_all(spec.joints, "joint")
    # Where a camera has a name, those without one are not the robot's eyes.
    if not any(camera.name for camera in spec.cameras if camera.parent.name != "world"):
        name_all(spec.cameras, "camera")
    # A URDF's base, fused with the world, would be gone.
    spec.compiler.fusestatic = False
    model = _compiled(spec, path)
    keep_masses(spec, model)
    if free_endless_hinges(spec, model):
        model = _compiled(spec, path)
    data, key_frame = at_key_frame(model, config.keyframe, path)
    ahead = camera_heading(model, data, config)
    drive = find_drive_joints(model, data, config, path, ahead)
    if drive.kind == HOLONOMIC:
        # The key frame's place in the plane is not the robot's shape.
        for name in drive.planar:
            data.joint(name).qpos[:] = model.qpos0[model.joint(name).qposadr]
        mujoco.mj_forward(model, data)
        ahead = camera_heading(model, data, config)
    locked = lock_joints(spec, model, data, {*drive.left, *drive.right}, drive.root)
    # Joints of the planar chain are locked too, but ours take their place.
    locked = [name for name in locked if name not in drive.planar]
    T_root_base, base_joints = None, ()
    if drive.kind == HOLONOMIC:
        T_world_root = body_pose(data, model.body(drive.root).id)
        T_root_base = np.linalg.inv(T_world_root) @ planar_base_frame(model, data, drive.planar, ahead)
    isolate_robot(spec, drive.root)
    if T_root_base is None:
        base_joints = (give_free_joint(spec, drive.root, unused_name("base", spec.joint)),)

    robot = _at_rest(spec, path)
    model, data = robot.model, robot.data
    base = _find_base(robot, drive, T_root_base)
    camera_name, T_base_camera, fovy_deg, rolled = _camera(robot, config, drive, base, camera, image_px)
    shell, casters = _shell_and_casters(model, data, {wheel.body for wheel in base.wheels}, base.T_world_base[2, 3])
    if not solid_geoms(model):
        raise RobotError(f"The robot {path} has no solid geom, so nothing shows its size; give its body one.")
    footprint, body_radius = robot_footprint(model, data, base.T_world_base)
    require_size(footprint, path)
    touching = [wheel.centre_m[:2] for wheel in base.wheels] + [lowest_xy_m(model, data, g) for g in casters]
    support = np.array(touching).reshape(-1, 2)
    shell_names = tuple(model.geom(geom).name for geom in shell)

    notes: list[str] = []
    if base.wheels:
        motors, top_radps, notes = fit_servos(
            spec, model, (*drive.left, *drive.right), base.wheel_radius_m, most_radps or {}
        )
        if top_radps * base.wheel_radius_m < _SLOWEST_MPS:
            raise RobotError(
                f"The wheels of {path} turn by {top_radps:.3g} rad/s at most, which moves the robot by "
                f"{top_radps * base.wheel_radius_m:.2g} m/s; it must be {_SLOWEST_MPS:g} m/s at least: widen the "
                "ctrlrange of their actuators, or the velocity of their limits in a URDF."
            )
        replace_wheel_contacts(spec, model, base.wheels)
    else:
        mass = float(model.body_subtreemass[base.root])
        base_joints, motors = give_planar_joints(spec, drive.root, base.T_root_base, mass, body_radius)
        top_radps = float("inf")
    if base.wheels and not shell and not casters:
        notes.append("nothing but its wheels is solid: the body meets no obstacle, and the footprint is the wheels'")
    notes += rolled + let_casters_slide(robot, casters, drive.root, base.T_world_base)
    model = _compiled(spec, path)
    T_base_world = np.linalg.inv(base.T_world_base)
    return RobotDescription(
        name=Path(path.name.removesuffix(".xacro")).stem,
        kind=drive.kind,
        spec=spec,
        root=drive.root,
        base_joints=base_joints,
        wheel_joints=(*drive.left, *drive.right),
        wheel_signs=base.wheel_signs,
        motors=motors,
        max_wheel_radps=top_radps,
        shell=shell_names,
        camera=camera_name,
        T_root_base=base.T_root_base,
        T_base_camera=T_base_camera,
        fovy_deg=fovy_deg,
        wheel_radius_m=base.wheel_radius_m,
        track_m=base.track_m,
        track_scale=config.track_scale if base.wheels else 1.0,
        mass_kg=float(model.body_subtreemass[base.root]),
        body_radius_m=body_radius,
        footprint=footprint,
        support_xy_m=support @ T_base_world[:2, :2].T + T_base_world[:2, 3],
        centre_of_mass_m=T_base_world[:3, :3] @ data.subtree_com[base.root] + T_base_world[:3, 3],
        reduced_mjcf=reduced_mjcf(model, data, base.root, base.T_world_base, T_base_camera, base.sides, base.track_m),
        hash=_hash(spec, model, most_radps or {}),
        key_frame=key_frame,
        locked=tuple(locked),
        notes=tuple(notes),
    )


def spec_hash(path: Path, *, given: mujoco.MjSpec | None = None, most_radps: Mapping[str, float] | None = None) -> str:
    """What tells a robot's file, with its meshes, from other files; ``given`` and ``most_radps`` as of
    :func:`describe_robot`. Raises RobotError if it cannot be read.
    """
    spec = given or _read(path)
    return _hash(spec, _compiled(spec, path), most_radps or {})


def _read(path: Path) -> mujoco.MjSpec:
    try:
        return read_spec(path, others=robot_folders(), option=FOLDERS_VARIABLE, robot=True)
    except OutsideError as err:
        raise RobotError(f"The robot {path} is not read: {err}.") from err
    except (ValueError, OSError) as err:
        raise RobotError(f"MuJoCo cannot read the robot {path} ({err}); give an MJCF file with one robot.") from err


def _hash(spec: mujoco.MjSpec, model: mujoco.MjModel, most_radps: Mapping[str, float]) -> str:
    speeds = "".join(f"{name}={speed!r}\0" for name, speed in sorted(most_radps.items()))
    return hashlib.sha256(spec.to_xml().encode() + model.mesh_vert.tobytes() + speeds.encode()).hexdigest()


@dataclass(frozen=True, eq=False)
class _Base:
    """Where the base of a compiled robot is, and its wheels."""

    root: int
    T_world_base: Float[np.ndarray, "4 4"]
    T_root_base: Float[np.ndarray, "4 4"]
    moves: str
    """What moves it, for messages."""
    sides: tuple[tuple[Wheel, ...], ...] = ()
    """Left and right wheels; none of a holonomic base."""
    wheel_signs: tuple[float, ...] = ()
    track_m: float = 0.0

    @property
    def wheels(self) -> list[Wheel]:
        return list(itertools.chain(*self.sides))

    @property
    def wheel_radius_m(self) -> float:
        return self.sides[0][0].radius_m if self.sides else 0.0


def _find_base(robot: CompiledRobot, drive: DriveJoints, T_root_base: Float[np.ndarray, "4 4"] | None) -> _Base:
    """The base midway between the wheels, or, of a holonomic one, where ``T_root_base`` says."""
    root = robot.model.body(drive.root).id
    T_world_root = body_pose(robot.data, root)
    if T_root_base is not None:
        return _Base(root, T_world_root @ T_root_base, T_root_base, f"the base slides along {drive.planar[0]}")
    lefts, rights = read_wheels(robot.model, robot.data, drive.left, drive.right, robot.path)
    T_world_base, track_m, signs = base_frame(lefts, rights, robot.path)
    rolls = f"the wheels {', '.join(drive.left)} (left) and {', '.join(drive.right)} (right) roll"
    T_root_base = np.linalg.inv(T_world_root) @ T_world_base
    return _Base(root, T_world_base, T_root_base, rolls, (tuple(lefts), tuple(rights)), signs, track_m)


def _camera(
    robot: CompiledRobot, config: RobotConfig, drive: DriveJoints, base: _Base, wanted: CameraConfig, image_px: int
) -> tuple[str, Float[np.ndarray, "4 4"], float, list[str]]:
    """Find or mount the camera: its name, its pose in the base, its vertical field of view [deg], and a note."""
    spec, path, note = robot.spec, robot.path, ""
    if config.mounted_camera is not None:
        camera = mount_camera(spec, drive.root, base.T_root_base, config.mounted_camera)
    else:
        camera = find_camera(robot, config, drive.root, base.T_world_base)
        if hangs_on_joint(robot.model, int(robot.model.camera(camera).bodyid[0]), {*drive.left, *drive.right}):
            raise RobotError(f"The camera {camera} of {path} turns with a wheel; mount it on the base rigidly.")
        use_field_of_view(robot, camera)
        note = upright_camera(robot, camera, base.T_world_base)
    remount_camera(_at_rest(spec, path), camera, base.T_world_base, wanted, image_px)
    robot = _at_rest(spec, path)
    T_base_camera = np.linalg.inv(base.T_world_base) @ camera_pose(robot.model, robot.data, camera)
    require_view_ahead(T_base_camera, camera, base.moves, path)
    require_outside(spec, camera, "mounted" if config.mounted_camera else "file", path)
    fovy_deg = float(robot.model.cam_fovy[robot.model.camera(camera).id])
    require_field_of_view(fovy_deg, camera, path)
    return camera, T_base_camera, fovy_deg, [note] if note else []


def _at_rest(spec: mujoco.MjSpec, path: Path) -> CompiledRobot:
    model = _compiled(spec, path)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return CompiledRobot(spec, model, data, path)


def _compiled(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    try:
        return compile_spec(spec)
    except (ValueError, RuntimeError, MemoryError) as err:
        way_out = "fix that, or remove references to elements outside the robot"
        if "no decoder found for mesh file" in str(err):
            way_out = "convert its meshes to .stl, .obj or .msh"
        raise RobotError(f"The robot {path} cannot be compiled by itself ({err}); {way_out}.") from err


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
