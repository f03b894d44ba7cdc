"""The simulated robot: implements :class:`anm_mj.protocols.Robot`."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float, Float32

from anm_mj.control.speed_and_acceleration import MotionLimits
from anm_mj.errors import RobotError
from anm_mj.frames import pose_matrix, relative_pose
from anm_mj.people.crowd import Crowd
from anm_mj.protocols import Drive
from anm_mj.sensing.pixel_state import is_measured
from anm_mj.sim.camera import Camera, Image
from anm_mj.sim.drives.kinematic_drive import KinematicDrive
from anm_mj.sim.drives.physics_drive import PhysicsDrive
from anm_mj.sim.drives.trail import Trail
from anm_mj.sim.drives.wheel_drive import WheelDrive
from anm_mj.sim.people_shown import PeopleShown, true_people
from anm_mj.sim.sensors.camera_sensor import Sensor
from anm_mj.sim.sensors.noisy_odometry import NoisyOdometry
from anm_mj.sim.sensors.sensor_config import SensorConfig
from anm_mj.sim.views_ahead import AheadCamera, ViewsAhead, frame_number, update_poses
from anm_mj.types import Action, ActionResult, Footprint, MotionResult, Observation, Pose2, TrueView, Twist

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_JOINTS = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))


class SimRobot:
    """A robot in a MuJoCo simulation: a drive and a camera.

    Close it, or use it in a ``with`` statement, to free the camera's GL context.
    """

    REBUILT = ("model", "data", "_camera", "_ahead", "_shown", "_people", "_noise_seed")

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        camera: Camera,
        drive: Drive,
        footprint: Footprint,
        T_base_camera: Float[np.ndarray, "4 4"] | None = None,
        robot_hash: str = "",
        sensor: SensorConfig | None = None,
        seed: int = 0,
        knows_start: bool = True,
        copied: PhysicsDrive | None = None,
    ):
        """Combine the parts; ``seed`` is that of the errors of ``sensor`` (None = none), ``copied`` as of
        :class:`~.views_ahead.ViewsAhead`.

        With ``T_base_camera``, camera to base (camera axes x right, y down, z forward), observations report poses by
        wheel odometry; without, true poses. Odometry begins at the true pose if the robot ``knows_start``, else at
        zero, wherever it stands.
        """
        self.model = model
        self.data = data
        self._camera = camera
        self._drive = drive
        self._footprint = footprint
        self._T_base_camera = T_base_camera
        self.robot_hash = robot_hash
        self.camera_kind = camera.kind
        """Rendering method: ``gl``, ``embree`` or ``mujoco rays``."""
        self._sensor_config = sensor or SensorConfig()
        self._seed(seed)
        self._origin: Pose2 | None = None if knows_start else drive.pose
        """Where odometry begins at zero; None = it begins at the true pose."""
        self._looked: tuple[Observation, Float32[np.ndarray, "h w"]] | None = None
        """The last observation, and the exact depth at its time [m]."""
        self.step = 0
        """Number of executed actions, including refused ones, without STOP."""
        self._shown = data if self._trail is None else mujoco.MjData(model)
        """What the last image shows."""
        self._ahead = None
        if isinstance(camera, AheadCamera) and isinstance(drive, KinematicDrive | PhysicsDrive):
            self._ahead = ViewsAhead(model, camera, drive, copied, self._sensor_config.delay_s, self._measure)
        self._people = None if self._crowd is None else PeopleShown(model)

    def _seed(self, seed: int) -> None:
        """Begin the errors of a seed."""
        self._noise_seed = seed
        self._sensor = Sensor(self._sensor_config, seed)
        self._odometry = NoisyOdometry(self._sensor_config, seed)

    @property
    def footprint(self) -> Footprint:
        """The cylinder that must stay clear of obstacles."""
        return self._footprint

    @property
    def limits(self) -> MotionLimits:
        """Of speed and acceleration."""
        return self._drive.limits if isinstance(self._drive, WheelDrive) else MotionLimits()

    @property
    def _crowd(self) -> Crowd | None:
        return self._drive.crowd if isinstance(self._drive, WheelDrive) else None

    @property
    def _trail(self) -> Trail | None:
        """What late images are made of; None = images are of the present."""
        return self._drive.trail if isinstance(self._drive, WheelDrive) else None

    @property
    def pose(self) -> Pose2:
        """True pose of the base."""
        return self._drive.pose

    def joints(self) -> tuple[list[str], Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Names of the robot's joints, their positions [rad, m] and velocities [rad/s, m/s]."""
        joints = map(self.model.joint, range(self.model.njnt))
        found = [joint for joint in joints if joint.name.startswith("robot/") and joint.type[0] in _JOINTS]
        positions = np.array([self.data.qpos[joint.qposadr[0]] for joint in found], float)
        velocities = np.array([self.data.qvel[joint.dofadr[0]] for joint in found], float)
        return [joint.name.removeprefix("robot/") for joint in found], positions, velocities

    def true_view(self) -> TrueView:
        """What the last observation was truly made of: poses, and exact depth where the sensor gave a value. Raises
        RobotError before the first observation.
        """
        if self._looked is None:
            raise RobotError("There is no view yet; call observe first.")
        seen, exact_m = self._looked
        pose, T_world_camera = self._drive.pose, self._camera.T_world_camera(self._shown)
        told = is_measured(seen.depth_m)
        if self._crowd is None or self._people is None:
            return TrueView(pose, T_world_camera, np.where(told, exact_m, np.float32(np.nan)))
        shown = self._people.find(self._shown, T_world_camera, seen.intrinsics, exact_m)
        exact_m = np.where(told & ~shown.any_of_them, exact_m, np.float32(np.nan))
        return TrueView(pose, T_world_camera, exact_m, true_people(self._crowd, shown, pose))

    @property
    def odometry(self) -> Pose2:
        """Pose of the base by wheel odometry, with the errors of the sensor."""
        believed = self._odometry.read(self._drive.odometry)
        return believed if self._origin is None else relative_pose(self._origin, believed)

    def observe(self) -> Observation:
        """The view from the present pose, with true poses or poses by wheel odometry. A late image is the view of a
        moment ago, with the camera's pose at the time of its stamp. Raises RenderError after ``close``.
        """
        update_poses(self.model, self.data)
        pose = self._drive.pose if self._T_base_camera is None else self.odometry
        T_world_camera = self._stamped_camera(pose)
        if self._trail is not None:
            self._trail.write(self._shown, self.data.time - self._sensor_config.delay_s)
            update_poses(self.model, self._shown)
        rgb, exact_m = self._camera.render(self._shown)
        frame = frame_number(self.data)
        measured = None if self._ahead is None else self._ahead.measured(exact_m, frame)
        rgb, depth_m = self._measure((rgb, exact_m), frame) if measured is None else measured
        seen = Observation(
            step=self.step,
            time_s=float(self.data.time),
            rgb=rgb,
            depth_m=depth_m,
            intrinsics=self._camera.intrinsics,
            T_world_camera=T_world_camera,
            pose=pose,
            image_age_s=self._sensor_config.delay_s - self._sensor_config.stamp_error_s,
            range_m=self._sensor.range_m,
        )
        self._looked = seen, exact_m
        return seen

    def _stamped_camera(self, pose: Pose2) -> Float[np.ndarray, "4 4"]:
        """Where the camera was when the image was taken, by its stamp, given where the base is said to be now."""
        stamp_s = self.data.time - self._sensor_config.delay_s + self._sensor_config.stamp_error_s
        if self._trail is not None:
            self._trail.add(self.data, self._drive.odometry)
        if self._T_base_camera is None:
            if self._trail is not None:
                self._trail.write(self._shown, stamp_s)
                update_poses(self.model, self._shown)
            return self._camera.T_world_camera(self._shown)
        if self._trail is None:
            return pose_matrix(pose) @ self._T_base_camera
        back = pose_matrix(relative_pose(self._drive.odometry, self._trail.odometry_at(stamp_s)))
        return pose_matrix(pose) @ back @ self._T_base_camera

    def _measure(self, image: Image, frame: int) -> Image:
        return self._sensor.measure(*image, self._camera.intrinsics, frame)

    def anticipate(self, *actions: Action) -> None:
        """Begin actions and the images after them, where it can; see :class:`anm_mj.protocols.Anticipates`."""
        if self._ahead is not None:
            self._ahead.begin(*actions)

    def act(self, action: Action) -> ActionResult:
        """Execute one action to its end."""
        result = None if self._ahead is None else self._ahead.take(action)
        if result is None:
            result = self._drive.act(action)
        self.step += action != Action.STOP
        return result

    def restart(self, pose: Pose2, *, seed: int | None = None) -> None:
        """Reset the simulation: the robot at rest at a pose, time and step 0, everything else at its initial state.
        ``seed`` is that of the sensor's errors from now on; None = as before.
        """
        if self._ahead is not None:
            self._ahead.give_up()  # Noise of another seed comes next, which no state tells.
        self._seed(self._noise_seed if seed is None else seed)
        self._drive.reseed(self._noise_seed)
        mujoco.mj_resetData(self.model, self.data)
        self.place(pose)
        self.step = 0
        if isinstance(self._drive, WheelDrive):
            self._drive.restart_people(pose, seed)

    def drive(self, twist: Twist, duration_s: float) -> MotionResult:
        """Move at a velocity for a time [s]; ``step`` does not count it. Raises RobotError if the duration is not
        positive, or the velocity not finite.
        """
        return self._drive.drive(twist, duration_s)

    def look_at(self, point_m: Float[np.ndarray, "3"]) -> MotionResult:
        """Turn on the spot until the camera's axis and a point share a vertical plane. The point [m] is in the frame of
        the observations' poses. ``step`` does not count the motion; the result has the equivalent number of steps.
        Raises RobotError if the point is not finite, or so near to the axis of rotation that no turn faces it.
        """
        if not np.isfinite(point_m).all():
            raise RobotError(f"The robot cannot look at {np.asarray(point_m).tolist()}; all three must be finite.")
        if self._T_base_camera is not None:
            T_true_believed = pose_matrix(self._drive.pose) @ np.linalg.inv(pose_matrix(self.odometry))
            point_m = T_true_believed[:3, :3] @ point_m + T_true_believed[:3, 3]
        return self._drive.look_at(point_m)

    def place(self, pose: Pose2) -> None:
        """Move the robot to a pose without driving, at rest and without a collision test."""
        self._drive.place(pose)
        self._odometry.restart()
        if self._trail is not None:
            self._trail.restart()
        self._origin = None if self._origin is None else pose

    def get_state(self) -> Float[np.ndarray, " n"]:
        """The simulation's state, for a checkpoint: all that its next step depends on."""
        state = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, state, _STATE)
        return state

    def set_state(self, state: Float[np.ndarray, " n"]) -> None:
        """Take over what :meth:`get_state` gave. Raises RobotError if it is that of another model."""
        if state.shape != (mujoco.mj_stateSize(self.model, _STATE),):
            raise RobotError(f"The stored state of the simulation has {state.size} numbers, not those of this scene.")
        mujoco.mj_setState(self.model, self.data, state, _STATE)
        update_poses(self.model, self.data)

    def close(self) -> None:
        """Free the camera's GL context, and what was begun; may be called again."""
        self._camera.close()
        self._ahead = None

    def __enter__(self) -> SimRobot:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.close()
