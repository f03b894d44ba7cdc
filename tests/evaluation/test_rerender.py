from dataclasses import replace
from unittest.mock import Mock

import numpy as np

from anm_mj.evaluation.rerender import observe_at
from anm_mj.io.read_run import Run
from anm_mj.scene.folder import load_scene
from anm_mj.sim.make_robot import make_robot
from anm_mj.types import Intrinsics, Pose2
from tests.robots import ROVER_XML


def test_views_of_a_run_are_those_of_its_robot():
    scene, robot = load_scene("room"), str(ROVER_XML)
    record = Mock(spec=Run, config={"robot": robot}, intrinsics=Intrinsics.from_fov(64, 64, 1.2))
    start = scene.starts[0]
    poses = [start, replace(start, yaw_rad=start.yaw_rad + 1.0)]
    views = list(observe_at(scene, poses, 64, record))
    assert [view.step for view in views] == [0, 1]
    with make_robot(scene, image_px=64, robot=robot) as rover:
        for view, pose in zip(views, poses, strict=True):
            rover.place(pose)
            seen = rover.observe()
            np.testing.assert_array_equal(view.depth_m, seen.depth_m)
            np.testing.assert_allclose(view.T_world_camera, seen.T_world_camera)
    assert not np.array_equal(views[0].depth_m, views[1].depth_m)


def test_settings_of_a_run_that_no_image_depends_on_are_not_told(caplog):
    scene = load_scene("room")
    record = Mock(spec=Run, config={"model": {"wheel_noise": 0.02}}, intrinsics=Intrinsics.from_fov(16, 16, 1.2))
    assert len(list(observe_at(scene, scene.starts[:1], 16, record))) == 1
    assert "without effect" not in caplog.text


def test_views_are_rendered_where_the_robot_does_not_fit_at_the_scenes_start():
    scene = load_scene("home")
    low = scene.bounds_m[0, :2]
    in_a_wall = replace(scene, starts=(Pose2(float(low[0]), float(low[1]), 0.0),))
    poses = [scene.starts[0], replace(scene.starts[0], yaw_rad=1.0)]
    seen, again = (list(observe_at(world, poses, 16)) for world in (in_a_wall, scene))
    for one, other in zip(seen, again, strict=True):
        np.testing.assert_array_equal(one.depth_m, other.depth_m)
    assert len(list(observe_at(replace(scene, starts=()), poses[:1], 16))) == 1
