"""mink's clearance limit: every obstacle is in it, and the servo stops at the distance that was set."""

import math

import mink
import mujoco
import numpy as np
import pytest

from anm_mj.control.clearance_limit import (
    BODY,
    ClearanceLimit,
    Obstacle,
    add_obstacles,
    require_all_pairs,
    static_obstacles,
)
from anm_mj.control.wheel_servo import BaseServo
from anm_mj.errors import RobotError
from anm_mj.frames import move_pose
from anm_mj.types import Pose2

_PERIOD_S = 0.02


def box(x, y, half_x, half_y, yaw_rad=0.0) -> Obstacle:
    quaternion = np.array([math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2)])
    return Obstacle(mujoco.mjtGeom.mjGEOM_BOX, np.array([half_x, half_y, 0.7]), np.array([x, y, 0.7]), quaternion)


def servo_among(description, kinematics, obstacles):
    speeds = (12.0, 12.0)
    return BaseServo(
        description, kinematics, period_s=_PERIOD_S, max_speeds=speeds, obstacles=obstacles, min_distance_m=0.005
    )


def drive_ahead(servo, kinematics, pose, periods=100):
    for _ in range(periods):
        speeds = servo.speeds(pose, move_pose(pose, 0.006, 0.0))
        pose = kinematics.odometry(pose, *(speeds * _PERIOD_S))
    return pose


def test_obstacle_pairs(compile_scene, description):
    boxes = "".join(f'<geom type="box" pos="{2 + i} 0 1" size="0.1 1 1"/>' for i in range(40))
    model, _ = compile_scene(boxes + '<geom type="box" pos="0 5 1" size="1 1 1" contype="0" conaffinity="0"/>')
    obstacles = static_obstacles(model)
    # Neither the floor, nor what nothing can touch, nor the robot itself.
    assert len(obstacles) == 40
    spec = mujoco.MjSpec.from_string(description.reduced_mjcf)
    add_obstacles(spec, description, obstacles)
    compiled = spec.compile()
    limit = ClearanceLimit(compiled, 40, min_distance_m=0.005)
    body = compiled.geom(BODY).id
    assert {pair for pair in limit.geom_id_pairs if body in pair} == set(limit.geom_id_pairs)
    assert len(set(limit.geom_id_pairs)) == 40


def test_a_pair_that_mink_drops_is_an_error(description):
    # Obstacles of the world itself and the robot's root body are parent and child: mink takes none of these pairs.
    spec = mujoco.MjSpec.from_string(description.reduced_mjcf)
    add_obstacles(spec, description, [])
    spec.worldbody.add_geom(name="obstacle_0", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 1.0, 0.7], pos=[1, 0, 0.7])
    model = spec.compile()
    assert mink.CollisionAvoidanceLimit(model, [([BODY], ["obstacle_0"])]).geom_id_pairs == []
    with pytest.raises(RobotError, match="mink leaves 1 of 1 obstacles out"):
        ClearanceLimit(model, 1, min_distance_m=0.005)


def test_missing_pairs_are_counted():
    require_all_pairs([(1, 4), (1, 5)], 1, [4, 5])
    with pytest.raises(RobotError, match="leaves 2 of 3"):
        require_all_pairs([(1, 4)], 1, [4, 5, 6])


@pytest.mark.parametrize("yaw_deg", [0.0, 10.0, 45.0, -70.0])
def test_stop_at_min_distance(description, kinematics, yaw_deg):
    servo = servo_among(description, kinematics, [box(1.05, 0.0, 0.05, 4.0), box(-9.0, 0.0, 0.1, 0.1)])
    end = drive_ahead(servo, kinematics, Pose2(0.6, 0.0, math.radians(yaw_deg)), 300)
    assert end.x_m == pytest.approx(1.0 - 0.17 - 0.005, abs=1e-4)


def test_oblique_obstacle(description, kinematics):
    askew = box(1.0, 1.0, 0.05, 4.0, math.radians(45.0))
    servo = servo_among(description, kinematics, [askew])
    end = drive_ahead(servo, kinematics, Pose2(0.4, 0.4, math.radians(45.0)), 300)
    to_face = (math.hypot(1.0, 1.0) - 0.05) - math.hypot(end.x_m, end.y_m)
    assert to_face == pytest.approx(0.17 + 0.005, abs=1e-4)


def test_walls_beside_and_behind(description, kinematics):
    servo = servo_among(description, kinematics, [box(0.0, 0.221, 5.0, 0.05), box(-0.2, 0.0, 0.02, 1.0)])
    free = servo_among(description, kinematics, None)
    start = Pose2(0.0, 0.0, math.radians(0.05))
    ends = [drive_ahead(one, kinematics, start, 60) for one in (servo, free)]
    assert ends[0].x_m == pytest.approx(ends[1].x_m, abs=1e-6)


def test_obstacle_above_the_robot(description, kinematics):
    lamp = Obstacle(
        mujoco.mjtGeom.mjGEOM_BOX, np.array([0.1, 2.0, 0.05]), np.array([0.6, 0.0, 1.5]), np.array([1.0, 0.0, 0.0, 0.0])
    )
    servo = servo_among(description, kinematics, [lamp])
    assert drive_ahead(servo, kinematics, Pose2(0.0, 0.0, 0.0), 150).x_m == pytest.approx(0.9, abs=1e-3)
