"""Robots put together with a scene that has been imported from a mesh file."""

import math

import numpy as np
import pytest
import trimesh

from anm_mj.errors import ConfigError, RobotError, SceneError
from anm_mj.frames import back_project
from anm_mj.people.people_config import PeopleConfig
from anm_mj.robot.robot_config import DEFAULT_ROBOT, RobotConfig
from anm_mj.robot.robot_presets import robot_path
from anm_mj.scene.folder import Scene, load_scene
from anm_mj.scene.importing.import_scene import import_scene
from anm_mj.scene.navigable import is_clear
from anm_mj.sim.make_robot import make_robot
from anm_mj.sim.sensors.sensor_config import SensorConfig
from anm_mj.sim.simulation_config import DRIVES, SimulationConfig, in_reality
from anm_mj.types import DEFAULT_FOOTPRINT, FORWARD_STEP_M, Action, Pose2
from tests.robots import ROVER_XML


@pytest.fixture(scope="module")
def room(tmp_path_factory) -> Scene:
    """A room 5 m by 4 m with walls 0.1 m thick and a crate in the middle."""
    parts = [
        trimesh.creation.box(bounds=bounds)
        for bounds in (
            [[-2.6, -2.1, -0.1], [2.6, 2.1, 0.0]],
            [[-2.6, -2.1, 0.0], [-2.5, 2.1, 2.5]],
            [[2.5, -2.1, 0.0], [2.6, 2.1, 2.5]],
            [[-2.5, -2.1, 0.0], [2.5, -2.0, 2.5]],
            [[-2.5, 2.0, 0.0], [2.5, 2.1, 2.5]],
            [[-0.4, -0.4, 0.0], [0.4, 0.4, 0.8]],
        )
    ]
    folder = tmp_path_factory.mktemp("scene")
    trimesh.util.concatenate(parts).export(folder / "room.ply")
    return import_scene(folder / "room.ply", folder / "room", up="z", scale=1.0)


@pytest.fixture(params=DRIVES)
def robot(request, room):
    with make_robot(room, start=Pose2(-1.5, 0.0, 0.0), drive=request.param, image_px=64) as robot:
        yield robot


def test_depth_lies_on_the_walls(robot):
    for _ in range(3):
        observation = robot.observe()
        points = back_project(observation.depth_m, observation.intrinsics, observation.T_world_camera)
        x, y, z = np.abs(points).T
        off_surfaces_m = np.stack(
            [np.abs(x - 2.5), np.abs(y - 2.0), z, np.abs(x - 0.4), np.abs(y - 0.4), np.abs(z - 0.8)]
        )
        assert len(points) > 1000
        assert off_surfaces_m.min(axis=0).max() < 1e-3
        robot.act(Action.TURN_LEFT)


def test_crate_stops_the_robot(robot):
    results = [robot.act(Action.MOVE_FORWARD) for _ in range(20)]
    assert results[-1].collided
    assert not results[0].collided
    # The crate begins at x = -0.4; the physics drive touches it with its shell, the kinematic one keeps the footprint.
    assert -0.4 - 0.18 - 0.065 - 1e-6 < robot.pose.x_m < -0.4 - 0.169
    observation = robot.observe()
    assert observation.step == 20
    assert observation.T_world_camera[2, 3] == pytest.approx(1.25, abs=1e-3)


def test_image_size(robot):
    observation = robot.observe()
    assert observation.rgb.shape == (64, 64, 3)
    assert (observation.intrinsics.fx, observation.intrinsics.cx) == pytest.approx((32.0, 32.0))


def test_forgotten_textures_stay_in_the_images():
    with make_robot(load_scene("room"), image_px=64) as whole:
        image = whole.observe().rgb
        pixels = whole.model.tex_data.copy()
    with make_robot(load_scene("room"), image_px=64, forgets_textures=True) as lean:
        assert np.array_equal(lean.observe().rgb, image)
        assert np.count_nonzero(lean.model.tex_data) < np.count_nonzero(pixels)


def test_the_default_start_is_the_scenes_first(room):
    with make_robot(room, image_px=16) as robot:
        start, pose = room.starts[0], robot.pose
    assert (pose.x_m, pose.y_m, pose.yaw_rad) == pytest.approx((start.x_m, start.y_m, start.yaw_rad))


def test_a_wide_robot_starts_at_the_first_place_that_is_clear_for_it():
    scene = load_scene("flat")
    with make_robot(scene, robot="stretch3") as robot:
        assert not is_clear(scene, scene.starts[0], robot.footprint)
        assert robot.pose.xy_m.tolist() in [start.xy_m.tolist() for start in scene.starts[1:]]


def test_start_in_collision(room):
    with pytest.raises(SceneError, match=r"cannot start at \(0\.50, 0\.00\).*nearest clear place is \("):
        make_robot(room, start=Pose2(0.5, 0.0, math.pi / 2))


def test_start_outside_the_scene(room):
    with pytest.raises(SceneError, match=r"lies outside scene room, which reaches from \(-2\.6 m, -2\.1 m\)"):
        make_robot(room, start=Pose2(7.0, 0.0, 0.0))


def test_unknown_drive(room):
    with pytest.raises(ConfigError, match="choose one of kinematic, physics"):
        make_robot(room, drive="magic")


def test_unknown_robot_or_pose_source(room):
    with pytest.raises(RobotError, match="a name: diff_drive"):
        make_robot(room, robot="r2d2")
    with pytest.raises(ConfigError, match="choose one of true, odometry"):
        make_robot(room, pose="guess")


def test_camera_of_the_rover(room):
    with make_robot(room, start=Pose2(-1.5, 0.0, 0.0), robot=str(ROVER_XML), image_px=32) as rover:
        observation = rover.observe()
        assert rover.footprint.radius_m == pytest.approx(0.216, abs=1e-3)
        assert len(rover.robot_hash) == 64
    np.testing.assert_allclose(observation.T_world_camera[:3, 3], [-1.35, -0.02, 0.20], atol=1e-6)
    # The crate's side is 0.95 m ahead; it fills the middle of the picture, and the robot's own body none of it.
    assert observation.depth_m[16, 16] == pytest.approx(0.95, abs=1e-3)
    assert np.nanmin(observation.depth_m) > 0.3


def test_the_footprint_encloses_the_robot():
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(robot_path("diff_drive")))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    tops_m = []
    for i in range(model.ngeom):
        centre, half = model.geom_aabb[i, :3], model.geom_aabb[i, 3:]
        corners = centre + half * np.array(np.meshgrid(*[[-1, 1]] * 3)).T.reshape(-1, 3)
        corners = corners @ data.geom_xmat[i].reshape(3, 3).T + data.geom_xpos[i]
        # A bounding box's corners lie outside a round body: for these its own radius counts.
        round_about_z = model.geom_type[i] == mujoco.mjtGeom.mjGEOM_CYLINDER and model.geom(i).name != "lens"
        reach_m = model.geom_size[i, 0] if round_about_z else np.linalg.norm(corners[:, :2], axis=1).max()
        assert reach_m < DEFAULT_FOOTPRINT.radius_m, model.geom(i).name
        tops_m.append(corners[:, 2].max())
    assert max(tops_m) == pytest.approx(DEFAULT_FOOTPRINT.z_max_m)
    assert model.geom("chassis").pos[2] - model.geom("chassis").size[1] == pytest.approx(DEFAULT_FOOTPRINT.z_min_m)


def test_third_party_scene(public_scenes, tmp_path):
    source = public_scenes / "rmf_office.glb"
    if not source.is_file():
        pytest.skip(f"no rmf_office.glb in {public_scenes}")
    scene = import_scene(source, tmp_path / "office")
    with make_robot(load_scene(scene.folder), image_px=64) as robot:
        observation = robot.observe()
        assert np.isfinite(observation.depth_m).mean() > 0.5
        assert len(np.unique(observation.rgb.reshape(-1, 3), axis=0)) > 100
        assert not robot.act(Action.TURN_LEFT).collided


def test_a_point_that_is_not_finite_cannot_be_looked_at(robot):
    with pytest.raises(RobotError, match="all three must be finite"):
        robot.look_at(np.array([math.nan, 0.0, 0.0]))


def test_another_robot_comes_with_its_own_settings(room):
    config = SimulationConfig("", image_px=32, start=(-1.5, 0.0, 0.0))
    with make_robot(room, config, robot="turtlebot3_burger") as robot:
        # Its file has no camera.
        assert robot.observe().T_world_camera[2, 3] == pytest.approx(0.21)
    real = SimulationConfig("", **in_reality("real", DEFAULT_ROBOT) | {"start": (-1.5, 0.0, 0.0), "image_px": 32})
    exact = {"drive": "kinematic", "sensor": SensorConfig(), "people": PeopleConfig()}
    with make_robot(room, real, robot="turtlebot3_burger", **exact) as robot:
        robot.act(Action.MOVE_FORWARD)
        # By the noise of the encoders, which the reality has.
        assert robot.odometry.x_m != pytest.approx(robot.pose.x_m, abs=1e-6)


def test_a_reality_beside_a_configuration_is_refused(room):
    with pytest.raises(ConfigError, match="reality is 'real', but"):
        make_robot(room, SimulationConfig("", start=(-1.5, 0.0, 0.0)), reality="real")


def test_a_reality_is_what_its_name_says(room):
    with make_robot(room, reality="real", image_px=32, start=Pose2(-1.5, 0.0, 0.0), sensor=SensorConfig()) as robot:
        # A motion by torque takes its time to come to rest, and there are three people; what is given goes before.
        assert robot.act(Action.MOVE_FORWARD).moved_m != FORWARD_STEP_M
        robot.observe()
        people = robot.true_view().people
        assert people is not None
        assert len(people.states) == 3


@pytest.mark.parametrize("option", [{"sensor": "d435i"}, {"people": 3}, {"model": {}}])
def test_an_option_of_another_kind_is_refused(room, option):
    with pytest.raises(ConfigError, match=r"give a \w+Config"):
        make_robot(room, **option)


def test_settings_that_nothing_reads_are_told(room, caplog):
    idle = {"sensor": SensorConfig(odometry_radius_error=0.1), "people": PeopleConfig(fastest_mps=1.5)}
    make_robot(room, start=Pose2(-1.5, 0.0, 0.0), image_px=32, **idle).close()
    assert "sensor.odometry_radius_error, people.fastest_mps: without effect" in caplog.text
    caplog.clear()
    idle["people"] = PeopleConfig(number=1, fastest_mps=1.5)
    make_robot(room, start=Pose2(-1.5, 0.0, 0.0), image_px=32, pose="odometry", **idle).close()
    assert "without effect" not in caplog.text


def test_a_restart_repeats_all_errors(room):
    noisy = {"pose": "odometry", "model": RobotConfig(wheel_noise=0.1), "image_px": 32}
    ends = set()
    with make_robot(room, start=(start := Pose2(-1.5, 0.0, 0.0)), **noisy) as robot:
        for _ in range(2):
            robot.restart(start)
            for _ in range(9):
                robot.act(Action.TURN_LEFT)
            ends.add(robot.odometry.yaw_rad)
    assert len(ends) == 1


def test_the_first_pose_of_odometry_has_a_yaw_as_all_others(room):
    with make_robot(room, SimulationConfig(str(room.folder), start=(-1.5, 0.0, 630.0), pose="odometry")) as robot:
        assert robot.observe().pose.yaw_rad == pytest.approx(-math.pi / 2)
