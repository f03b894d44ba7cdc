"""The camera that a robot looks ahead with: found in its file or mounted, upright, and refused where it cannot see."""

import math
import re
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float

from anm_mj.errors import RobotError
from anm_mj.frames import T_GL_CV
from anm_mj.mjcf.poses import body_pose, camera_pose, quaternion_of, set_pose
from anm_mj.robot.compiled_robot import CompiledRobot, solid_geoms, unused_name
from anm_mj.robot.robot_config import MAX_ASIDE_DEG, MAX_ASIDE_M, MAX_TILT_DEG, CameraConfig, CameraPose, RobotConfig

CAMERA = "camera"
ROUNDING_DEG = 0.01
"""A camera may be tilted by so much more than ``MAX_TILT_DEG``: files round [deg]."""
_INSIDE_M = {"file": 0.035, "mounted": 0.005}
"""A camera deeper inside the robot's body than this is misplaced [m]; in files a lens lies in its head's hull."""
_HIGHEST_M = 3.0
"""Above this a camera is in the ceiling, and the file is not in metres [m]."""
_ON_ARM = re.compile(r"wrist|hand|grip|finger|arm|eef|tool|d405|palm", re.IGNORECASE)
_DEPTH = re.compile(r"depth|infra|(^|_)ir\d?($|_)", re.IGNORECASE)
UPRIGHT_DEG = 10.0
"""A camera rolled by less counts as upright [deg]."""
_LEVEL = 0.1


def camera_heading(model: mujoco.MjModel, data: mujoco.MjData, config: RobotConfig) -> Float[np.ndarray, "3"] | None:
    """Horizontal direction in the world of the named camera, or of the usual or only one; None where unclear."""
    cameras = _fixed_cameras(model)
    wanted = config.camera or CAMERA
    chosen = [c for c in cameras if model.camera(c).name == wanted] or (cameras if len(cameras) == 1 else [])
    if config.camera_pose or not chosen:
        return None
    ahead = -data.cam_xmat[chosen[0]].reshape(3, 3)[:, 2]
    length = math.hypot(ahead[0], ahead[1])
    return np.array([ahead[0], ahead[1], 0.0]) / length if length > 0.1 else None


def find_camera(robot: CompiledRobot, config: RobotConfig, root: str, T_world_base: Float[np.ndarray, "4 4"]) -> str:
    """Name of the robot's camera: the one given, the one called ``camera``, the only one, or the first that fits.

    One that fits looks forward and is no camera of an arm or hand; colour cameras come before depth cameras. Raises
    RobotError if there is none, it is unclear which, or it is not on the robot.
    """
    model, data, root_id = robot.model, robot.data, robot.model.body(root).id
    cameras = _fixed_cameras(model)
    on_robot = [c for c in cameras if model.body_rootid[model.cam_bodyid[c]] == root_id]
    names = {model.camera(c).name: c for c in cameras}
    wanted = config.camera or (CAMERA if CAMERA in names else "")
    if wanted:
        if wanted not in names:
            raise RobotError(_no_camera(robot, on_robot, T_world_base, f'camera "{wanted}"'))
        if names[wanted] not in on_robot:
            body = model.body(int(model.cam_bodyid[names[wanted]])).name
            raise RobotError(
                f"The camera {wanted} of {robot.path} hangs on {body}, the wheels on {root}: they are on different "
                "bodies of the world; a robot is one body with everything on it."
            )
        return wanted
    if len(on_robot) == 1:
        return model.camera(on_robot[0]).name
    fitting = [c for c in on_robot if _fits(data, c, T_world_base) and not _ON_ARM.search(model.camera(c).name)]
    if fitting:
        first = [c for c in fitting if not _DEPTH.search(model.camera(c).name)] or fitting
        return model.camera(first[0]).name
    raise RobotError(_no_camera(robot, on_robot, T_world_base, f'camera named "{CAMERA}"'))


def use_field_of_view(robot: CompiledRobot, name: str) -> None:
    """Give a camera that is described by its sensor its vertical field of view instead."""
    model, camera = robot.model, robot.model.camera(name).id
    if model.cam_sensorsize[camera].any():
        element = robot.spec.camera(name)
        element.fovy = math.degrees(
            2.0 * math.atan(model.cam_sensorsize[camera, 1] / 2.0 / model.cam_intrinsic[camera, 1])
        )
        _forget_sensor(element)


def mount_camera(spec: mujoco.MjSpec, root: str, T_root_base: Float[np.ndarray, "4 4"], pose: CameraPose) -> str:
    """Add a camera to the robot's root body; its name."""
    pitch = math.radians(pose.pitch_deg)
    T_base_camera = np.eye(4)
    T_base_camera[:3, 0] = [0.0, -1.0, 0.0]
    T_base_camera[:3, 2] = [math.cos(pitch), 0.0, -math.sin(pitch)]
    T_base_camera[:3, 1] = np.cross(T_base_camera[:3, 2], T_base_camera[:3, 0])
    T_base_camera[:3, 3] = pose[:3]
    T_root_camera = T_root_base @ T_base_camera @ T_GL_CV
    quat = quaternion_of(T_root_camera[:3, :3])
    name = unused_name(CAMERA, spec.camera)
    camera = spec.body(root).add_camera(name=name, pos=T_root_camera[:3, 3], quat=quat, fovy=pose.fovy_deg)
    # Not those of the file's defaults.
    camera.mode, camera.proj = mujoco.mjtCamLight.mjCAMLIGHT_FIXED, mujoco.mjtProjection.mjPROJ_PERSPECTIVE
    _forget_sensor(camera)
    return name


def remount_camera(
    robot: CompiledRobot, name: str, T_world_base: Float[np.ndarray, "4 4"], config: CameraConfig, image_px: int
) -> None:
    """Change height, tilt and field of view of the camera ``name`` in the spec, as the configuration asks for.
    ``image_px`` is the size of an image where the configuration does not say [px].
    """
    if config.fov_deg:
        robot.spec.camera(name).fovy = config.fov_y_deg(image_px)
    if not (config.height_m or config.tilt_deg):
        return
    T_base_camera = np.linalg.inv(T_world_base) @ camera_pose(robot.model, robot.data, name)
    if config.height_m:
        T_base_camera[2, 3] = config.height_m
    c, s = math.cos(math.radians(config.tilt_deg)), math.sin(math.radians(config.tilt_deg))
    # About the camera's x axis, which points right: a positive angle lifts the view.
    T_base_camera[:3, :3] = T_base_camera[:3, :3] @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    _place(robot, name, T_world_base, T_base_camera)


def upright_camera(robot: CompiledRobot, name: str, T_world_base: Float[np.ndarray, "4 4"]) -> str:
    """Turn a camera that is mounted on its side or upside down about its axis until its image is upright.

    Its image is square unless the settings say otherwise, so that it shows the same. Arguments as for
    :func:`remount_camera`. Returns what was done, for the notes; empty where the camera stands upright.
    """
    T_base_camera = np.linalg.inv(T_world_base) @ camera_pose(robot.model, robot.data, name)
    roll = roll_deg(T_base_camera)
    if abs(roll) < UPRIGHT_DEG:
        return ""
    T_base_camera[:3, :2] = _upright_axes(T_base_camera)
    _place(robot, name, T_world_base, T_base_camera)
    return f"camera {name} is mounted rolled by {roll:.0f} degrees; its image is turned upright"


def roll_deg(T_base_camera: Float[np.ndarray, "4 4"]) -> float:
    """How far a camera is turned about its optical axis, clockwise as seen along it [deg]; 0 where it looks straight up
    or down, for there nothing is upright.
    """
    if math.hypot(*T_base_camera[:2, 2]) < _LEVEL:
        return 0.0
    level, down = _upright_axes(T_base_camera).T
    return math.degrees(math.atan2(float(T_base_camera[:3, 0] @ down), float(T_base_camera[:3, 0] @ level)))


def tilt_deg(T_base_camera: Float[np.ndarray, "4 4"]) -> float:
    """Angle of the optical axis below the horizontal [deg]."""
    return -math.degrees(math.asin(max(-1.0, min(1.0, float(T_base_camera[2, 2])))))


def aside_deg(T_base_camera: Float[np.ndarray, "4 4"]) -> float:
    """Angle of the optical axis to the left of the forward direction, seen from above [deg]."""
    return math.degrees(math.atan2(T_base_camera[1, 2], T_base_camera[0, 2]))


def require_view_ahead(T_base_camera: Float[np.ndarray, "4 4"], camera: str, wheels: str, path: Path) -> None:
    """Accept a camera that looks forward and no more than 45 degrees up or down.

    Camera axes are x right, y down, z forward; ``wheels`` says in words what sets the forward direction. Raises
    RobotError if it does not, or it is below the floor, above all rooms or far from the robot.
    """
    tilt, aside = tilt_deg(T_base_camera), aside_deg(T_base_camera)
    if abs(tilt) > MAX_TILT_DEG + ROUNDING_DEG:
        raise RobotError(
            f"The camera {camera} of {path} looks {abs(tilt):.0f} degrees {'down' if tilt > 0 else 'up'}; it must look "
            f"within {MAX_TILT_DEG:g} degrees of the horizontal: name another by --set model.camera=NAME, choose a key "
            "frame by --set model.keyframe=NAME, or mount one by --set model.camera_pose=x,y,z,pitch,fovy."
        )
    if abs(aside) > MAX_ASIDE_DEG:
        raise RobotError(
            f"The camera {camera} of {path} does not look forward, but {abs(aside):.0f} degrees to the "
            f"{'left' if aside > 0 else 'right'} of where {wheels}; "
            + ("swap the wheels' names, or turn the camera." if abs(aside) > 150.0 else "turn or name another camera.")
        )
    if not 0.02 <= T_base_camera[2, 3] <= _HIGHEST_M:
        raise RobotError(
            f"The camera {camera} of {path} is {T_base_camera[2, 3]:.3f} m above the floor; its height must lie within "
            f"0.02 and {_HIGHEST_M:g} m: move it, set camera.height_m, or scale a file that is not in metres."
        )
    away_m = float(np.abs(T_base_camera[:2, 3]).max())
    if away_m > MAX_ASIDE_M:
        raise RobotError(
            f"The camera {camera} of {path} is {away_m:.3f} m away from the base; it must be within {MAX_ASIDE_M:g} m: "
            "move it, or scale the file: MuJoCo's unit is the metre."
        )


def require_field_of_view(fovy_deg: float, camera: str, path: Path) -> None:
    """Accept a vertical field of view that a pinhole can have [deg]. Raises RobotError for any other."""
    if not 5.0 <= fovy_deg <= 150.0:
        raise RobotError(
            f"The camera {camera} of {path} has a vertical field of view of {fovy_deg:g} degrees; it must lie within 5 "
            "and 150: set camera.fov_deg."
        )


def require_outside(spec: mujoco.MjSpec, camera: str, source: str, path: Path) -> None:
    """Accept a camera, from the ``file`` or ``mounted`` by the configuration, not deep inside the robot's body. Raises
    RobotError if a solid geom surrounds it.
    """
    probe = spec.copy()
    model = probe.compile()
    name = unused_name("camera_probe", probe.geom)
    probe.camera(camera).parent.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[1e-4, 0.0, 0.0],
        pos=model.cam_pos[model.camera(camera).id],
        mass=0.0,
    )
    model = probe.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    geom = model.geom(name).id
    for other in solid_geoms(model):
        if other == geom:
            continue
        depth_m = -float(mujoco.mj_geomDistance(model, data, geom, other, 1.0, None))
        if depth_m > _INSIDE_M[source]:
            raise RobotError(
                f"The camera {camera} of {path} is {100 * depth_m:.1f} cm inside the robot's body (geom "
                f"{model.geom(other).name}); mount it outside, as by --set model.camera_pose=x,y,z,pitch,fovy."
            )


def _forget_sensor(element: "mujoco._specs.MjsCamera") -> None:
    """Let a camera's field of view alone describe it."""
    element.sensor_size = [0.0, 0.0]
    element.focal_length = element.focal_pixel = element.principal_length = element.principal_pixel = [0.0, 0.0]


def _fixed_cameras(model: mujoco.MjModel) -> list[int]:
    """Named perspective cameras that are fixed to a body other than the world."""
    return [c for c in range(model.ncam) if model.camera(c).name and not _off_duty(model, c) and model.cam_bodyid[c]]


def _off_duty(model: mujoco.MjModel, camera: int) -> bool:
    """Whether a camera follows something, or draws without perspective: no camera that a robot carries."""
    perspective = model.cam_projection[camera] == mujoco.mjtProjection.mjPROJ_PERSPECTIVE
    return model.cam_mode[camera] != mujoco.mjtCamLight.mjCAMLIGHT_FIXED or not perspective


def _fits(data: mujoco.MjData, camera: int, T_world_base: Float[np.ndarray, "4 4"]) -> bool:
    ahead = T_world_base[:3, :3].T @ -data.cam_xmat[camera].reshape(3, 3)[:, 2]
    tilt, aside = math.asin(np.clip(ahead[2], -1.0, 1.0)), math.atan2(ahead[1], ahead[0])
    return abs(math.degrees(tilt)) <= MAX_TILT_DEG + ROUNDING_DEG and abs(math.degrees(aside)) <= MAX_ASIDE_DEG


def _no_camera(robot: CompiledRobot, cameras: list[int], T_world_base: Float[np.ndarray, "4 4"], what: str) -> str:
    model = robot.model
    if not cameras:
        others = [model.camera(c).name for c in range(model.ncam) if model.cam_bodyid[c] and _off_duty(model, c)]
        which = f"; its cameras are {', '.join(others)}, which follow something or are orthographic" if others else ""
        return (
            f"The robot {robot.path} has no {what if others else 'camera'}{which}: mount one by --set "
            "model.camera_pose=x,y,z,pitch,fovy, as in 0.05,0,0.3,10,60 (m, m, m, deg down, deg)."
        )
    fits = {c: "" if _fits(robot.data, c, T_world_base) else " (does not look forward)" for c in cameras}
    known = ", ".join(model.camera(c).name + fits[c] for c in cameras)
    return (
        f"The robot {robot.path} has no {what}; its cameras are {known}: name one by --set model.camera=NAME, or mount "
        "one by --set model.camera_pose=x,y,z,pitch,fovy."
    )


def _upright_axes(T_base_camera: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "3 2"]:
    """The axes to the right and down of a camera that looks along the same axis with an upright image, as columns."""
    ahead = T_base_camera[:3, 2]
    level = np.array([ahead[1], -ahead[0], 0.0])
    level /= np.linalg.norm(level)
    return np.stack([level, np.cross(ahead, level)], axis=1)


def _place(
    robot: CompiledRobot, name: str, T_world_base: Float[np.ndarray, "4 4"], T_base_camera: Float[np.ndarray, "4 4"]
) -> None:
    T_world_body = body_pose(robot.data, int(robot.model.camera(name).bodyid[0]))
    set_pose(robot.spec.camera(name), np.linalg.inv(T_world_body) @ T_world_base @ T_base_camera @ T_GL_CV)
