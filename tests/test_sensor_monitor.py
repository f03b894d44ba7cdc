from dataclasses import replace

import numpy as np
import pytest

from anm_mj.explore import explore
from anm_mj.sensor_monitor import PATIENCE_FRAMES, SensorMonitor
from anm_mj.types import Action, Plan, Pose2, StopReason
from anm_mj.viz.viewer import NullViewer
from tests.fake_robot import FakeRobot, ListRecorder
from tests.planning.worlds import room
from tests.test_explore import Scripted, straight_to


class FaultyRobot(FakeRobot):
    """Its camera fails from a step on."""

    def __init__(self, world, pose, change, from_step):
        super().__init__(world, pose)
        self.change, self.from_step = change, from_step

    def observe(self):
        seen = super().observe()
        return self.change(seen) if self.steps >= self.from_step else seen


def with_depth(value):
    return lambda seen: replace(seen, depth_m=np.full_like(seen.depth_m, value))


def outcome_of(change, from_step, plan):
    world = room(5, 4)
    robot = FaultyRobot(world, Pose2(1.0, 1.5, 0.0), change, from_step)
    return explore(robot, world, Scripted(plan), num_steps=100, recorder=ListRecorder(), viewer=NullViewer())


@pytest.mark.parametrize("value", [np.nan, np.inf, 0.0, -1.0])
def test_blind_camera_ends_the_run(value: float):
    outcome = outcome_of(with_depth(value), 5, straight_to(4.0, 1.5))
    assert outcome.stop_reason is StopReason.SENSOR_FAULT
    assert outcome.num_steps == 5 + PATIENCE_FRAMES - 1


def test_blind_robot_is_never_complete():
    done = Plan("all seen", np.zeros((0, 2)), stop=StopReason.COMPLETE)
    assert outcome_of(with_depth(np.nan), 0, done).stop_reason is StopReason.SENSOR_FAULT


def test_one_frame_without_depth_hides_no_end():
    done = Plan("all seen", np.zeros((0, 2)), stop=StopReason.COMPLETE)
    turn = Plan("turn", np.zeros((0, 2)), actions=(Action.TURN_LEFT,))
    world = room(5, 4)
    robot = FaultyRobot(world, Pose2(1.0, 1.5, 0.0), with_depth(np.nan), 1)
    outcome = explore(robot, world, Scripted(turn, done), num_steps=100, recorder=ListRecorder(), viewer=NullViewer())
    assert outcome.stop_reason is StopReason.COMPLETE


def test_frozen_image_ends_the_run():
    outcome = outcome_of(with_depth(30.0), 5, straight_to(4.0, 1.5))
    assert outcome.stop_reason is StopReason.SENSOR_FAULT
    assert outcome.num_steps == 5 + PATIENCE_FRAMES


def test_still_robot_may_see_the_same():
    monitor, seen = SensorMonitor(), FakeRobot(room(5, 4), Pose2(1.0, 1.5, 0.0)).observe()
    for _ in range(3 * PATIENCE_FRAMES):
        monitor.add(seen, moved=False)
    assert monitor.fault is None


def test_one_good_frame_is_enough():
    monitor, seen = SensorMonitor(), FakeRobot(room(5, 4), Pose2(1.0, 1.5, 0.0)).observe()
    for step in range(4 * PATIENCE_FRAMES):
        good = step % PATIENCE_FRAMES == 0
        monitor.add(with_depth(10.0 + step if good else np.nan)(seen), moved=True)
        assert monitor.fault is None


def test_repeated_image_is_logged_once(caplog):
    monitor, seen = SensorMonitor(), FakeRobot(room(5, 4), Pose2(1.0, 1.5, 0.0)).observe()
    for _ in range(4):
        monitor.add(seen, moved=True)
    assert [record.message for record in caplog.records] == ["Frame 0 repeats the last one although the robot moved."]
