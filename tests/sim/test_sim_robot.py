"""The simulated robot with a drive of the test's own."""

import math

import mujoco
import numpy as np
import pytest

from anm_mj.errors import RenderError
from anm_mj.sim.gl_camera import GlCamera
from anm_mj.sim.sensors.sensor_config import SENSORS, SensorConfig
from anm_mj.sim.sim_robot import SimRobot
from anm_mj.types import Action, ActionResult, Footprint, MotionResult, Pose2, Twist, WheelSpeeds
from tests.sim.evenly_lit import HEADER

_SCENE = f"""
<mujoco>
  {HEADER}
  <worldbody>
    <geom type="box" pos="3.5 0 0" size="0.5 9 9"/>
    <body name="base">
      <joint name="x" type="slide" axis="1 0 0"/>
      <geom type="sphere" size="0.1" group="1"/>
      <camera name="camera" pos="0 0 1.25" xyaxes="0 -1 0 0 0 1" fovy="90"/>
    </body>
  </worldbody>
</mujoco>
"""
_FOOTPRINT = Footprint(radius_m=0.18, z_min_m=0.05, z_max_m=1.35)


class _Slide:
    """Moves along x by a metre, touching nothing but the joint."""

    def __init__(self, data: mujoco.MjData):
        self._data = data

    @property
    def pose(self) -> Pose2:
        return Pose2(float(self._data.qpos[0]), 0.0, 0.0)

    def place(self, pose: Pose2) -> None:
        self._data.qpos[0] = pose.x_m

    def reseed(self, seed: int) -> None:
        """It reads no encoders."""

    def act(self, action: Action) -> ActionResult:
        moved_m = float(action == Action.MOVE_FORWARD)
        self._data.qpos[0] += moved_m
        self._data.time += 0.5 * moved_m
        return ActionResult(action, collided=False, wheel_speeds=WheelSpeeds(0.0, 0.0), moved_m=moved_m)

    def drive(self, twist: Twist, duration_s: float) -> MotionResult:
        moved_m = twist.forward_mps * duration_s
        self._data.qpos[0] += moved_m
        return MotionResult(False, WheelSpeeds(0.0, 0.0), moved_m, 0.0, duration_s)

    def look_at(self, point_m) -> MotionResult:
        self.looked_at_m = point_m
        return MotionResult(False, WheelSpeeds(0.0, 0.0), 0.0, 0.0, 0.0)

    @property
    def odometry(self) -> Pose2:
        return Pose2(self.pose.x_m - 0.25, 0.5, math.pi / 2)


@pytest.fixture
def robot():
    model = mujoco.MjModel.from_xml_string(_SCENE)
    data = mujoco.MjData(model)
    with SimRobot(model, data, GlCamera(model, "camera", 64, 64), _Slide(data), _FOOTPRINT) as robot:
        yield robot


def test_observation_after_a_motion(robot):
    before = robot.observe()
    robot.act(Action.MOVE_FORWARD)
    after = robot.observe()
    np.testing.assert_allclose(before.depth_m, 3.0, atol=1e-4)
    np.testing.assert_allclose(after.depth_m, 2.0, atol=1e-4)
    assert (before.pose, after.pose) == (Pose2(0.0, 0.0, 0.0), Pose2(1.0, 0.0, 0.0))
    np.testing.assert_allclose(after.T_world_camera[:3, 3], [1.0, 0.0, 1.25])
    np.testing.assert_allclose(after.T_world_camera[:3, :3], [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=1e-12)


@pytest.mark.parametrize(("limits", "seen_m"), [({}, 3.0), ({"max_range_m": 2.0}, None), ({"min_range_m": 4.0}, None)])
def test_true_view_holds_what_the_sensor_gave(robot, limits, seen_m):
    camera = GlCamera(robot.model, "camera", 64, 64)
    sensor = SensorConfig(**limits)
    with SimRobot(robot.model, robot.data, camera, _Slide(robot.data), _FOOTPRINT, sensor=sensor) as limited:
        limited.observe()
        true_m = limited.true_view().depth_m
    np.testing.assert_allclose(true_m, np.nan if seen_m is None else seen_m, atol=1e-4)


def test_noise_differs_between_frames_of_one_step(robot):
    camera = GlCamera(robot.model, "camera", 64, 64)
    with SimRobot(robot.model, robot.data, camera, _Slide(robot.data), _FOOTPRINT, sensor=SENSORS["d435i"]) as noisy:
        first, again = noisy.observe(), noisy.observe()
        robot.data.time += 0.1  # As after a velocity.
        later = noisy.observe()
    assert first.step == later.step
    assert np.array_equal(first.depth_m, again.depth_m, equal_nan=True)
    assert not np.array_equal(first.depth_m, later.depth_m, equal_nan=True)


def test_steps_count_every_action_but_stop(robot):
    for action in (Action.MOVE_FORWARD, Action.STOP, Action.TURN_LEFT):
        robot.act(action)
    observation = robot.observe()
    assert observation.step == robot.step == 2
    assert observation.time_s == 0.5
    assert robot.footprint == _FOOTPRINT


def test_restart(robot):
    robot.act(Action.MOVE_FORWARD)
    robot.restart(Pose2(0.5, 0.0, 0.0))
    observation = robot.observe()
    assert (observation.step, observation.time_s, observation.pose) == (0, 0.0, Pose2(0.5, 0.0, 0.0))
    np.testing.assert_allclose(observation.T_world_camera[:3, 3], [0.5, 0.0, 1.25])


def test_a_closed_robot_says_so(robot):
    robot.close()
    with pytest.raises(RenderError, match="is closed"):
        robot.observe()


def test_poses_by_odometry(robot):
    T_base_camera = np.array([[0, 0, 1, 0.1], [-1, 0, 0, 0], [0, -1, 0, 1.25], [0, 0, 0, 1]], dtype=float)
    drive = _Slide(robot.data)
    with SimRobot(
        robot.model, robot.data, GlCamera(robot.model, "camera", 64, 64), drive, _FOOTPRINT, T_base_camera
    ) as believing:
        believing.place(Pose2(1.0, 0.0, 0.0))
        observation = believing.observe()
        # The picture is taken where the robot truly stands; the drive's wheels have it elsewhere, turned left.
        np.testing.assert_allclose(observation.depth_m, 2.0, atol=1e-4)
        assert observation.pose == believing.odometry == Pose2(0.75, 0.5, math.pi / 2)
        np.testing.assert_allclose(observation.T_world_camera[:3, 3], [0.75, 0.6, 1.25], atol=1e-12)
        # A metre ahead of where it believes to be, to the world's left, is a metre ahead of where it is.
        believing.look_at(np.array([0.75, 1.5, 1.0]))
        np.testing.assert_allclose(drive.looked_at_m, [2.0, 0.0, 1.0], atol=1e-12)
        assert believing.drive(Twist(0.5, 0.0), 0.2).moved_m == pytest.approx(0.1)
