"""Both drives at a velocity."""

import math

import numpy as np
import pytest
import trimesh

from anm_mj.errors import RobotError
from anm_mj.frames import move_pose, wrap_angle
from anm_mj.sim.drives.kinematic_drive import KinematicDrive
from anm_mj.sim.drives.physics_drive import PhysicsDrive
from anm_mj.types import Action, Pose2, Twist
from tests.robots import clearance_of

_WALL = '<geom type="box" pos="1.05 0 1" size="0.05 3 1"/>'


@pytest.fixture
def exact(compile_scene, description):
    return KinematicDrive(*compile_scene(), description, clearance_of())


@pytest.fixture
def physics(compile_scene, description):
    return PhysicsDrive(*compile_scene(), description)


def walled():
    return clearance_of(trimesh.creation.box(bounds=[[1.0, -3.0, 0.0], [1.1, 3.0, 2.5]]))


@pytest.mark.parametrize("twist", [Twist(0.4, 0.0), Twist(0.3, 1.0), Twist(-0.2, 0.5), Twist(0.0, -1.5)])
def test_a_velocity_is_its_exponential(exact, twist):
    exact.place(Pose2(0.1, 0.2, 0.3))
    result = exact.drive(twist, 0.7)
    expected = move_pose(Pose2(0.1, 0.2, 0.3), 0.7 * twist.forward_mps, 0.7 * twist.turn_radps)
    assert (exact.pose.x_m, exact.pose.y_m) == pytest.approx((expected.x_m, expected.y_m), abs=1e-12)
    assert exact.pose.yaw_rad == pytest.approx(expected.yaw_rad, abs=1e-12)
    assert (result.moved_m, result.duration_s) == pytest.approx((0.7 * abs(twist.forward_mps), 0.7))
    steps = 0.7 * abs(twist.forward_mps) / 0.065 + math.degrees(0.7 * abs(twist.turn_radps)) / 10.0
    assert result.equivalent_steps == pytest.approx(steps)


def test_physics_follows_the_kinematic_course(exact, physics):
    course = [Twist(0.3, 0.0), Twist(0.3, 0.8), Twist(0.2, -1.0), Twist(-0.1, 0.0), Twist(0.0, 1.2)]
    for twist in course:
        physics.drive(twist, 0.6)
        # Where the accelerations of the course lead to: the pose that the servo follows.
        assert math.dist(physics.pose.xy_m, physics._reference.xy_m) < 0.004
        assert abs(wrap_angle(physics.pose.yaw_rad - physics._reference.yaw_rad)) < math.radians(1.0)
    physics.drive(Twist(0.0, 0.0), 0.6)
    at_rest = physics.pose
    physics.drive(Twist(0.0, 0.0), 0.3)
    assert math.dist(physics.pose.xy_m, at_rest.xy_m) < 1e-4
    for twist in course:
        exact.drive(twist, 0.6)
    assert math.dist(physics.pose.xy_m, exact.pose.xy_m) < 0.05


def test_action_brakes_first(physics):
    physics.drive(Twist(0.4, 0.0), 0.5)
    before = physics.pose
    result = physics.act(Action.MOVE_FORWARD)
    assert not result.collided
    assert result.moved_m == pytest.approx(0.065, abs=0.002)
    assert 0.065 < physics.pose.x_m - before.x_m < 0.065 + 0.07


def test_saturated_velocity_keeps_the_arc(physics):
    physics.drive(Twist(5.0, 10.0), 1.0)
    start = physics.pose
    result = physics.drive(Twist(5.0, 10.0), 0.5)
    assert max(abs(result.wheel_speeds.left_radps), abs(result.wheel_speeds.right_radps)) < 12.0
    assert result.turned_rad / result.moved_m == pytest.approx(2.0, rel=0.05)
    assert physics.pose != start


def test_driving_into_a_wall(compile_scene, description):
    exact = KinematicDrive(*compile_scene(_WALL), description, walled())
    exact.place(Pose2(0.6, 0.0, 0.0))
    refused = exact.drive(Twist(0.5, 0.0), 1.0)
    assert refused.collided
    assert refused.moved_m == 0.0
    assert exact.pose.x_m == pytest.approx(0.6, abs=1e-12)
    assert not exact.drive(Twist(0.5, 0.0), 0.4).collided
    physics = PhysicsDrive(*compile_scene(_WALL), description)
    physics.place(Pose2(0.6, 0.0, 0.0))
    stopped = physics.drive(Twist(0.5, 0.0), 2.0)
    assert stopped.collided
    assert physics.pose.x_m < 1.0 - 0.17
    assert not physics.drive(Twist(-0.3, 0.0), 0.5).collided
    assert physics.pose.x_m < 0.8


def test_sweep_of_an_arc():
    # A post that the chord of the arc clears by 1 cm, and the arc does not.
    start, forward_m, turn_rad = Pose2(0.0, 0.0, 0.0), 1.0, 1.2
    middle = move_pose(start, forward_m / 2, turn_rad / 2)
    outside = np.array([math.sin(middle.yaw_rad), -math.cos(middle.yaw_rad)])
    for gap_m, blocked in ((0.001, False), (-0.001, True)):
        x, y = middle.xy_m + (0.18 + 0.005 + gap_m) * outside
        post = trimesh.creation.cylinder(0.005, 2.0, sections=64)
        post.apply_translation([x, y, 1.0])
        clearance = clearance_of(post)
        assert clearance.sweep_collides(start, forward_m, turn_rad) == blocked
        end = move_pose(start, forward_m, turn_rad)
        assert clearance.sweep_collides(end, -forward_m, -turn_rad) == blocked


def test_turning_on_the_spot_sweeps_nothing():
    clearance = walled()
    assert not clearance.sweep_collides(Pose2(1.0 - 0.181, 0.0, 0.0), 0.0, 3.0)


@pytest.mark.parametrize("duration_s", [0.0, -1.0, math.nan, math.inf])
def test_invalid_duration(exact, physics, duration_s):
    for drive in (exact, physics):
        with pytest.raises(RobotError, match="its duration must be positive"):
            drive.drive(Twist(0.1, 0.0), duration_s)


@pytest.mark.parametrize("twist", [Twist(math.nan, 0.0), Twist(0.0, math.inf)])
def test_invalid_velocity(exact, physics, twist):
    for drive in (exact, physics):
        before = drive.pose
        with pytest.raises(RobotError, match="both must be finite"):
            drive.drive(twist, 0.1)
        assert drive.pose == before
