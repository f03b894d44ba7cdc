"""What the real world stands for, and what goes before it."""

import pytest

from anm_mj.config import make_config, read_config
from anm_mj.environments.environment_config import EnvironmentConfig, explore_config
from anm_mj.errors import ConfigError, TaskError
from anm_mj.io.to_json import to_json
from anm_mj.sim.simulation_config import REALITIES


def test_the_ideal_world_is_the_default():
    assert make_config("default", [], scene="home", reality="ideal") == make_config("default", [], scene="home")


def test_the_real_world_has_all_errors_and_a_map_that_tells_people_apart():
    config = make_config("default", [], scene="home", reality="real")
    assert (config.reality, config.drive, config.pose, config.sensor.name) == ("real", "physics", "slam", "d435i")
    assert config.sensor.odometry_alpha == (0.01, 0.01, 0.01, 0.01)
    assert (config.sensor.delay_s, config.model.wheel_noise, config.people.number) == (0.1, 0.02, 3)
    assert config.mapping.moving.detect
    # A run that is resumed is made of what its folder says.
    assert read_config(to_json(config)) == config
    # The texts say the same.
    world = REALITIES["real"]
    drive, pose, sensor = (world.options[name] for name in ("drive", "pose", "sensor"))
    spelt = make_config("default", list(world.texts), scene="home", drive=drive, pose=pose, sensor=sensor)
    assert (spelt.sensor, spelt.model, spelt.people) == (config.sensor, config.model, config.people)


def test_what_is_given_goes_before_it():
    settings = ["people.number=0", "sensor.delay_s=0"]
    config = make_config("default", settings, scene="home", reality="real", sensor="exact", drive="kinematic")
    assert (config.people.number, config.sensor.delay_s, config.sensor.depth) == (0, 0.0, "exact")
    assert (config.drive, config.pose) == ("kinematic", "slam")
    assert not config.mapping.moving.detect


def test_a_world_that_does_not_exist_is_named():
    with pytest.raises(ConfigError, match=r"no reality 'rael' \(did you mean real\?\); choose one of ideal, real"):
        make_config("default", [], scene="home", reality="rael")
    with pytest.raises(TaskError, match="no reality 'rael'"):
        explore_config(reality="rael")


def test_environments_are_real_too_and_know_their_pose_by_odometry():
    config = explore_config(reality="real", people=1)
    assert (config.drive, config.sensor, config.pose, config.people) == ("physics", "d435i", "odometry", 1)
    made = config.simulation
    assert (made.sensor.delay_s, made.model.wheel_noise, made.people.number) == (0.1, 0.02, 1)
    assert explore_config() == explore_config(reality="ideal")
    assert EnvironmentConfig(reality="real") == explore_config(reality="real")
    assert EnvironmentConfig(reality="real").people == 3
    plain = EnvironmentConfig()
    assert (plain.drive, plain.pose, plain.sensor, plain.people) == ("kinematic", "true", "exact", 0)
    with pytest.raises(TaskError, match="no reality 'rael'"):
        EnvironmentConfig(reality="rael")
    with pytest.raises(TaskError, match='no pose "slam" here'):
        explore_config(pose="slam")
