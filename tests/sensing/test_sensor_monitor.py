import math
from dataclasses import replace

import numpy as np
import pytest

from anm_mj.explore import explore
from anm_mj.frames import move_pose
from anm_mj.sensing.expected_view import expected_view
from anm_mj.sensing.pixel_state import find_outliers
from anm_mj.sensing.sensor_monitor import (
    FULL_TURN_FRAMES,
    LEAST_RANGE_M,
    PATIENCE_FRAMES,
    RANGE_FRAMES,
    SensorMonitor,
)
from anm_mj.types import Action, Intrinsics, Observation, Plan, Pose2, StopReason
from tests.box_room import ROOM_HIGH_M, ROOM_LOW_M, camera_pose, room_depth
from tests.fake_robot import FakeRobot, ListRecorder
from tests.planning.worlds import room
from tests.test_explore import Scripted, straight_to

MOST_EMPTY_FRAMES = PATIENCE_FRAMES + FULL_TURN_FRAMES


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
    return explore(robot, world, Scripted(plan), num_steps=100, observers=(ListRecorder(),))


@pytest.mark.parametrize("value", [np.nan, np.inf, 0.0, -1.0])
def test_blind_camera_ends_the_run(value: float):
    outcome = outcome_of(with_depth(value), 5, straight_to(4.0, 1.5))
    assert outcome.stop_reason is StopReason.SENSOR_FAULT
    assert outcome.num_steps == 5 + PATIENCE_FRAMES - 1


@pytest.mark.parametrize("change", [with_depth(np.nan), with_depth(np.inf)], ids=["nan", "inf"])
def test_a_blind_robot_turns_instead_of_driving(change, caplog):
    world, recorder = room(5, 4), ListRecorder()
    robot = FaultyRobot(world, Pose2(1.0, 1.5, 0.0), change, 5)
    explore(robot, world, Scripted(straight_to(4.0, 1.5)), num_steps=100, observers=(recorder,))
    actions = [result.action for _, result, *_ in recorder.steps]
    assert set(actions[:5]) == {Action.MOVE_FORWARD}
    assert len(actions) == 16
    assert Action.MOVE_FORWARD not in actions[5:]
    assert "in 12 frames in a row; the last time, the map expected surface within 22.5 m in" in caplog.text


def test_nothing_is_seen_where_the_map_expects_nothing():
    """The right half of the world is unknown: looking there is no fault until a whole turn shows nothing."""
    world = room(5, 4, unknown=[(1.4, 0.0, 5.4, 4.4)])
    out, back = (FakeRobot(world, Pose2(1.2, 1.5, yaw)).observe() for yaw in (0.0, math.pi))
    monitor = SensorMonitor()
    monitor.check(out)
    for count in range(1, MOST_EMPTY_FRAMES + 1):
        kept = monitor.check(with_depth(np.inf)(out), moved=True, grid_at=world.occupancy_grid)
        assert np.isposinf(kept.depth_m).all()
        assert monitor.sees
        assert not monitor.is_blind
        assert (monitor.fault is None) == (count < MOST_EMPTY_FRAMES)
    monitor.check(out, moved=True)
    assert monitor.fault is None
    for count in range(1, PATIENCE_FRAMES + 1):
        monitor.check(with_depth(np.inf)(out), moved=True, grid_at=world.occupancy_grid)
        kept = monitor.check(with_depth(np.inf)(back), moved=True, grid_at=world.occupancy_grid)
        assert np.isnan(kept.depth_m).all()
        assert not monitor.sees
        assert (monitor.fault is None) == (count < PATIENCE_FRAMES)


@pytest.mark.parametrize("is_dead", [False, True])
def test_a_robot_without_depth_looks_around_whatever_its_policy_looks_at(is_dead):
    """The right half of the world is unknown, and the policy would turn to and fro before it."""
    world = room(5, 4, unknown=[(1.4, 0.0, 5.4, 4.4)])

    def change(seen):
        return with_depth(np.inf)(seen) if is_dead or math.cos(seen.pose.yaw_rad) > 0.5 else seen

    to_and_fro = Plan("both", np.zeros((0, 2)), actions=(Action.TURN_LEFT, Action.TURN_RIGHT))
    robot, recorder = FaultyRobot(world, Pose2(1.2, 1.5, 0.0), change, 1), ListRecorder()
    outcome = explore(robot, world, Scripted(to_and_fro), num_steps=100, observers=(recorder,))
    actions = [result.action for _, result, *_ in recorder.steps]
    assert (outcome.stop_reason is StopReason.SENSOR_FAULT) == is_dead
    assert set(actions[PATIENCE_FRAMES : PATIENCE_FRAMES + 6]) == {Action.TURN_LEFT}
    # Where it was before, the map expects depth: the camera is dead before the turn is whole.
    assert len(actions) < MOST_EMPTY_FRAMES if is_dead else len(actions) == 100


def test_a_robot_looks_around_before_a_wall_that_it_is_too_near_to_measure():
    """The map has the wall where the camera should see it, and the policy would turn to and fro before it."""
    world = room(5, 4)

    def change(seen):
        return with_depth(np.nan)(seen) if math.cos(seen.pose.yaw_rad) > 0.7 else seen

    to_and_fro = Plan("both", np.zeros((0, 2)), actions=(Action.TURN_LEFT, Action.TURN_RIGHT))
    robot, recorder = FaultyRobot(world, Pose2(1.2, 1.5, 0.0), change, 1), ListRecorder()
    outcome = explore(robot, world, Scripted(to_and_fro), num_steps=40, observers=(recorder,))
    assert outcome.stop_reason is StopReason.BUDGET
    assert [result.action for _, result, *_ in recorder.steps][4:8] == [Action.TURN_LEFT] * 4


def test_a_robot_that_has_looked_around_may_go_on_into_what_it_sees_nothing_of():
    """The way leads through a sector of 200 degrees without any depth; each look around would turn it back."""
    world = room(5, 4, unknown=[(1.4, 0.0, 5.4, 4.4)])

    def change(seen):
        return with_depth(np.inf)(seen) if math.cos(seen.pose.yaw_rad) > -0.17 else seen

    robot, recorder = FaultyRobot(world, Pose2(1.2, 1.5, 0.0), change, 1), ListRecorder()
    outcome = explore(robot, world, Scripted(straight_to(3.6, 1.5)), num_steps=50, observers=(recorder,))
    actions = [result.action for _, result, *_ in recorder.steps]
    assert outcome.stop_reason is StopReason.BUDGET
    assert actions.count(Action.MOVE_FORWARD) > 25


def test_a_wall_too_near_to_be_measured_is_not_expected():
    world = room(5, 4)
    near, far = (FakeRobot(world, Pose2(x_m, 1.5, 0.0)).observe() for x_m in (4.9, 3.9))
    assert (
        expected_view(near, 5.0, world.occupancy_grid).share < 0.1 < expected_view(far, 5.0, world.occupancy_grid).share
    )
    assert expected_view(far, 1.0, world.occupancy_grid).share == 0.0


def test_blind_robot_is_never_complete():
    done = Plan("all seen", np.zeros((0, 2)), stop=StopReason.COMPLETE)
    assert outcome_of(with_depth(np.nan), 0, done).stop_reason is StopReason.SENSOR_FAULT


def test_one_frame_without_depth_hides_no_end():
    done = Plan("all seen", np.zeros((0, 2)), stop=StopReason.COMPLETE)
    turn = Plan("turn", np.zeros((0, 2)), actions=(Action.TURN_LEFT,))
    world = room(5, 4)
    robot = FaultyRobot(world, Pose2(1.0, 1.5, 0.0), with_depth(np.nan), 1)
    outcome = explore(robot, world, Scripted(turn, done), num_steps=100, observers=(ListRecorder(),))
    assert outcome.stop_reason is StopReason.COMPLETE


def test_frozen_image_ends_the_run():
    outcome = outcome_of(with_depth(30.0), 5, straight_to(4.0, 1.5))
    assert outcome.stop_reason is StopReason.SENSOR_FAULT
    assert outcome.num_steps == 5 + PATIENCE_FRAMES


def test_still_robot_may_see_the_same():
    monitor, seen = SensorMonitor(), FakeRobot(room(5, 4), Pose2(1.0, 1.5, 0.0)).observe()
    for _ in range(3 * PATIENCE_FRAMES):
        monitor.check(seen, moved=False)
    assert monitor.fault is None


def test_one_good_frame_is_enough():
    monitor, seen = SensorMonitor(), FakeRobot(room(5, 4), Pose2(1.0, 1.5, 0.0)).observe()
    for step in range(4 * PATIENCE_FRAMES):
        good = step % PATIENCE_FRAMES == 0
        monitor.check(with_depth(10.0 + step if good else np.nan)(seen), moved=True)
        assert monitor.fault is None


def test_repeated_image_is_logged_once(caplog):
    monitor, seen = SensorMonitor(), FakeRobot(room(5, 4), Pose2(1.0, 1.5, 0.0)).observe()
    for _ in range(4):
        monitor.check(seen, moved=True)
    assert [record.message for record in caplog.records] == ["Frame 0 repeats the last one although the robot moved."]


def coloured(seen):
    return replace(seen, rgb=np.full_like(seen.rgb, 90))


def black_after_colour(seen):
    """Black but for its noise, with the depth of the last frame that had colours."""
    if seen.step < 5:
        return coloured(seen)
    return with_depth(30.004)(replace(seen, rgb=np.full_like(seen.rgb, seen.step % 2)))


def half_size(seen):
    half = replace(seen.intrinsics, width=2, height=2)
    return replace(seen, rgb=seen.rgb[:2, :2], depth_m=seen.depth_m[:2, :2], intrinsics=half)


def without_pose(seen):
    nowhere = Pose2(math.nan, math.nan, math.nan)
    return replace(seen, pose=nowhere, T_world_camera=np.full((4, 4), np.nan))


@pytest.mark.parametrize(
    ("change", "from_step"), [(black_after_colour, 0), (half_size, 5), (without_pose, 5)], ids=["black", "half", "pose"]
)
def test_a_camera_that_cannot_be_believed_ends_the_run(change, from_step, caplog):
    outcome = outcome_of(change, from_step, straight_to(4.0, 1.5))
    assert outcome.stop_reason is StopReason.SENSOR_FAULT
    assert outcome.num_steps == 5 + PATIENCE_FRAMES - 1
    assert "in 12 frames in a row; the run ends" in caplog.text


def test_a_camera_without_colours_is_no_fault():
    monitor, seen = SensorMonitor(), FakeRobot(room(5, 4), Pose2(1.0, 1.5, 0.0)).observe()
    for step in range(2 * PATIENCE_FRAMES):
        kept = monitor.check(with_depth(3.0 + 0.01 * step)(seen), moved=True)
        assert np.isfinite(kept.depth_m).all()
    assert monitor.fault is None


def test_depth_that_goes_on_behind_black_images_is_believed():
    """The lights go out. Single values in the noise behind a closed lens are no depth."""
    monitor, seen = SensorMonitor(), box_view(Pose2(-0.5, 0.1, 0.7))
    monitor.check(seen)
    for count in range(1, PATIENCE_FRAMES + 1):
        dark = replace(box_view(Pose2(-0.5, 0.1, 0.7 + 0.1 * count)), rgb=np.zeros_like(seen.rgb))
        assert np.isfinite(monitor.check(dark, moved=True).depth_m).all()
    assert monitor.fault is None
    rng = np.random.default_rng(4)
    for _ in range(PATIENCE_FRAMES):
        noise = np.where(rng.random(seen.depth_m.shape) < 0.02, rng.uniform(0.2, 6.0, seen.depth_m.shape), np.nan)
        kept = monitor.check(replace(dark, depth_m=noise.astype(np.float32)), moved=True)
        assert np.isnan(kept.depth_m).all()
    assert "black images" in monitor.fault


def test_a_robot_may_stand_still_in_the_dark():
    monitor, seen = SensorMonitor(), box_view(Pose2(-0.5, 0.1, 0.7))
    monitor.check(coloured(seen))
    dark = replace(box_view(Pose2(-0.5, 0.1, 0.8)), rgb=np.zeros_like(seen.rgb))
    monitor.check(dark, moved=True)
    for _ in range(PATIENCE_FRAMES):
        assert np.isfinite(monitor.check(dark, action=Action.WAIT).depth_m).all()
    assert monitor.fault is None
    # Neither proves that a camera which shows the same after every turn is in order.
    for count in range(PATIENCE_FRAMES):
        noisy = replace(dark, rgb=np.full_like(dark.rgb, 1 + count % 2))
        assert np.isnan(monitor.check(noisy, action=Action.TURN_LEFT, moved=True).depth_m).all()
        assert np.isnan(monitor.check(noisy, action=Action.MOVE_FORWARD).depth_m).all()
    assert "black images" in monitor.fault
    # Nor is the same image again one of what the robot has turned to.
    for moved in (True, False):
        assert np.isnan(monitor.check(noisy, action=Action.TURN_LEFT, moved=moved).depth_m).all()


def test_a_camera_that_raises_ends_the_run_with_what_it_said(caplog):
    def fails(seen):
        raise OSError("the cable is loose")

    outcome = outcome_of(fails, 5, straight_to(4.0, 1.5))
    assert outcome.stop_reason is StopReason.SENSOR_FAULT
    assert outcome.num_steps == 5
    assert "OSError: the cable is loose" in caplog.text


@pytest.mark.parametrize("change", [with_depth(np.inf), with_depth(0.0), lambda seen: half_size(coloured(seen))])
def test_faulty_frames_reach_map_and_policy_without_depth(change):
    monitor, robot = SensorMonitor(), FakeRobot(room(5, 4), Pose2(1.0, 1.5, 0.0))
    first = coloured(with_depth(2.0)(robot.observe()))
    assert np.isfinite(monitor.check(first).depth_m).all()
    kept = monitor.check(change(first), moved=True)
    assert np.isnan(kept.depth_m).all()
    assert kept.depth_m.shape == first.depth_m.shape
    assert np.isfinite(kept.T_world_camera).all()


def test_a_frame_without_a_pose_gets_the_one_that_was_driven_to():
    monitor, robot = SensorMonitor(), FakeRobot(room(5, 4), Pose2(1.0, 1.5, 0.3))
    monitor.check(with_depth(2.0)(robot.observe()))
    robot.act(Action.MOVE_FORWARD)
    true = robot.observe()
    kept = monitor.check(without_pose(true), action=Action.MOVE_FORWARD, moved=True)
    assert kept.pose.xy_m == pytest.approx(true.pose.xy_m)
    assert np.allclose(kept.T_world_camera, true.T_world_camera)
    assert np.isnan(kept.depth_m).all()


def test_the_first_pose_that_is_said_is_no_jump_and_tells_the_mount(caplog):
    monitor, start = SensorMonitor(), Pose2(-0.5, 0.1, 0.7)
    kept = monitor.check(without_pose(box_view(start)))
    assert kept.pose == Pose2(0.0, 0.0, 0.0)
    assert np.isnan(kept.depth_m).all()
    driven = move_pose(start, 0.065, 0.0)
    # A map that knows nothing fits every pose.
    kept = monitor.check(box_view(driven), action=Action.MOVE_FORWARD, moved=True, sdf_m=lambda at: at[:, 0] * 0.0)
    assert kept.pose == driven
    assert "from where the last action led" not in caplog.text
    after = move_pose(driven, 0.065, 0.0)
    kept = monitor.check(without_pose(box_view(after)), action=Action.MOVE_FORWARD, moved=True)
    assert kept.pose.xy_m == pytest.approx(after.xy_m)
    assert np.allclose(kept.T_world_camera, camera_pose(after))


def box_view(pose, said=None):
    """A frame of the box room, with a pose that may not be the true one."""
    T_world_camera = camera_pose(pose)
    said = said or pose
    intrinsics = Intrinsics.from_fov(64, 64, math.pi / 2)
    depth_m = room_depth(T_world_camera, intrinsics)
    return Observation(0, 0.0, np.full((64, 64, 3), 90, np.uint8), depth_m, intrinsics, camera_pose(said), said)


def box_sdf(points_m):
    """What a map says that knows the box room exactly."""
    inside = np.minimum(points_m - ROOM_LOW_M, ROOM_HIGH_M - points_m).min(axis=1)
    return np.clip(inside, -0.1, 0.1).astype(np.float32)


def moved_aside(pose, aside_m=0.2):
    return Pose2(pose.x_m - aside_m * math.sin(pose.yaw_rad), pose.y_m + aside_m * math.cos(pose.yaw_rad), pose.yaw_rad)


@pytest.mark.parametrize("really", [False, True])
def test_the_map_decides_whether_a_jump_of_the_pose_is_true(really: bool, caplog):
    start = Pose2(-0.5, 0.1, 0.7)
    monitor = SensorMonitor()
    monitor.check(box_view(start))
    driven = move_pose(start, 0.065, 0.0)
    said = moved_aside(driven)
    true = said if really else driven
    kept = monitor.check(box_view(true, said), action=Action.MOVE_FORWARD, moved=True, sdf_m=box_sdf)
    assert kept.pose.xy_m == pytest.approx(true.xy_m)
    assert np.allclose(kept.T_world_camera, camera_pose(true))
    assert "lies 0.20 m and 0 degrees from where the last action led" in caplog.text
    # The correction stays, and the next frame is no jump.
    after = move_pose(driven, 0.0, math.radians(10.0))
    aside = moved_aside(driven)
    said = Pose2(aside.x_m, aside.y_m, after.yaw_rad)
    true = said if really else after
    kept = monitor.check(box_view(true, said), action=Action.TURN_LEFT, moved=True, sdf_m=box_sdf)
    assert kept.pose.xy_m == pytest.approx(true.xy_m)
    assert len(caplog.records) == 1


@pytest.mark.parametrize("share", [0.005, 0.01, 0.05])
def test_outliers_are_left_out_and_nothing_else(share: float, caplog):
    monitor, seen = SensorMonitor(), box_view(Pose2(-0.5, 0.1, 0.7))
    rng = np.random.default_rng(4)
    wrong = rng.random(seen.depth_m.shape) < share
    depth_m = np.where(wrong, rng.uniform(0.2, 10.0, wrong.shape).astype(np.float32), seen.depth_m)
    kept = monitor.check(replace(seen, depth_m=depth_m)).depth_m
    off = np.isfinite(kept) & (np.abs(kept - seen.depth_m) > 0.3 * seen.depth_m)
    assert off.sum() <= 0.1 * wrong.sum()
    assert np.isfinite(kept[~wrong]).mean() > 0.99
    assert "no pixel beside it agrees with" in caplog.text


def test_a_good_frame_is_handed_on_as_it_is(caplog):
    seen = box_view(Pose2(-0.5, 0.1, 0.7))
    kept = SensorMonitor().check(seen)
    assert kept.depth_m is seen.depth_m
    # Not by ==, which compares arrays from Python 3.13 on.
    assert all(getattr(kept, name) is getattr(seen, name) for name in vars(seen) if name != "pixel_state")
    assert not caplog.records


def test_a_leg_one_pixel_wide_is_no_outlier():
    depth_m = np.full((32, 32), 5.0, np.float32)
    depth_m[8:24, 10] = 2.0
    depth_m[28, 28] = 2.0
    found = find_outliers(depth_m)
    assert found[28, 28]
    assert not found[9:23].any()


def shown_range_m(depths_m, lost, said_m=10.0):
    """The range that the images of a camera have shown: walls so far away, with the upper half lost."""
    seen = FakeRobot(room(5, 4), Pose2(1.0, 1.5, 0.0)).observe()
    monitor = SensorMonitor()
    for depth_m in depths_m:
        image = np.full_like(seen.depth_m, depth_m)
        image[: len(image) // 2] = lost
        kept = monitor.check(replace(seen, depth_m=image, range_m=said_m))
    assert kept.range_m == said_m
    return kept.shown_range_m


def test_the_range_of_a_camera_is_learnt_from_its_images():
    depths_m = np.linspace(1.0, 6.0, RANGE_FRAMES + 1)
    assert shown_range_m(depths_m[:-1], np.nan) == math.inf
    assert shown_range_m(depths_m, np.nan) == pytest.approx(6.0)
    assert shown_range_m(depths_m / 2, np.nan) == LEAST_RANGE_M
    assert shown_range_m(depths_m, np.inf) == math.inf
