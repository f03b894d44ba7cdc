"""Robots by name: which settings a name or a file gets, and what is said where the robot cannot be had."""

import importlib
import sys
import types

import pytest

from anm_mj.config import make_config
from anm_mj.errors import RobotError
from anm_mj.robot.description import describe_robot
from anm_mj.robot.robot_config import RobotConfig
from anm_mj.robot.robot_presets import MODELS, preset_config, robot_path, robot_presets
from tests.robots import ROVER_XML


def test_every_preset_is_valid():
    for name, preset in robot_presets().items():
        assert RobotConfig(**preset.model) == preset_config(name)
        assert preset.source.startswith("https://")
        assert all(preset_config(alias) == preset_config(name) for alias in (*preset.aliases, name))
        assert preset.description in ("", "stretch_3_mj_description")
        assert preset_config("stretch_3_mj_description") == preset_config("stretch3")


@pytest.mark.parametrize(
    ("name", "radius_m", "track_m", "height_m", "mass_kg"),
    [
        ("stretch3", 0.0505, 0.34, 1.41, 24.5),
        ("turtlebot3_burger", 0.033, 0.16, 0.192, 1.0),
        ("tb3_waffle_pi", 0.033, 0.287, 0.141, 1.8),
    ],
)
def test_robots_that_the_readme_names_are_there(monkeypatch, name, radius_m, track_m, height_m, mass_kg):
    monkeypatch.delenv("ANM_MJ_ROBOTS", raising=False)
    monkeypatch.setitem(sys.modules, "robot_descriptions", None)
    path = robot_path(name)
    robot = describe_robot(path, preset_config(name))
    assert path.is_relative_to(MODELS)
    assert robot.wheel_radius_m == pytest.approx(radius_m)
    assert robot.track_m == pytest.approx(track_m)
    assert robot.footprint.z_max_m == pytest.approx(height_m, abs=0.02)
    assert robot.mass_kg == pytest.approx(mass_kg, rel=0.02)


def test_a_file_gets_the_settings_of_its_name_where_they_fit(tmp_path):
    assert preset_config(str(ROVER_XML)) == preset_config("diff_drive") == RobotConfig()
    scene = tmp_path / "scene_turtlebot3_burger.xml"
    scene.write_text("<mujoco/>")
    assert preset_config(str(scene)).camera_pose
    stretch = tmp_path / "stretch.xml"
    stretch.write_text('<mujoco><include file="keys.xml"/></mujoco>')
    (tmp_path / "keys.xml").write_text('<mujoco><keyframe><key name="stow"/></keyframe></mujoco>')
    config = preset_config(str(stretch))
    assert (config.keyframe, config.camera) == ("stow", "")


def test_settings_of_the_user_come_before_those_of_the_preset():
    config = make_config("default", ["model.camera_pose=0,0,1,0,60"], scene="home", robot="stretch3")
    assert (config.model.keyframe, config.model.camera, config.model.camera_pose) == ("stow", "", "0,0,1,0,60")
    assert make_config("default", ["model.camera=a"], scene="home", robot="turtlebot3").model.camera_pose == ""


def test_a_robot_in_a_folder_of_the_user(tmp_path, monkeypatch):
    monkeypatch.setenv("ANM_MJ_ROBOTS", str(tmp_path))
    (tmp_path / "tb3").mkdir()
    for name in ("scene_turtlebot3_burger.xml", "turtlebot3_burger.xml", "other.xml"):
        (tmp_path / "tb3" / name).write_text("<mujoco/>")
    assert robot_path("turtlebot3_burger") == tmp_path / "tb3" / "turtlebot3_burger.xml"


def test_of_files_of_one_name_that_of_the_named_robot_is_taken(tmp_path, monkeypatch):
    monkeypatch.setenv("ANM_MJ_ROBOTS", str(tmp_path))
    for folder in ("hello_robot_stretch", "hello_robot_stretch_3"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "stretch.xml").write_text("<mujoco/>")
    assert robot_path("stretch3") == tmp_path / "hello_robot_stretch_3" / "stretch.xml"
    # By name as by path, what the file lacks is left out.
    assert preset_config("stretch3").keyframe == ""
    assert preset_config("stretch3").camera_pose


@pytest.mark.parametrize("name", ["x" * 5000, "x" * 5000 + ".xml"])
def test_a_name_that_no_file_can_have_is_no_robot(name):
    assert preset_config(name) == RobotConfig()
    with pytest.raises(RobotError, match="There is no robot file"):
        robot_path(name)


def test_without_the_package(monkeypatch):
    monkeypatch.delenv("ANM_MJ_ROBOTS", raising=False)
    monkeypatch.setitem(sys.modules, "robot_descriptions", None)
    with pytest.raises(RobotError, match=r"not installed, are not known: pip install 'anm-mj\[robots\]', or give"):
        robot_path("rover")


def test_with_the_package(monkeypatch):
    package = types.ModuleType("robot_descriptions")
    package.DESCRIPTIONS = {"stretch_3_mj_description": None, "rover_mj_description": None, "arm_description": None}
    monkeypatch.setitem(sys.modules, "robot_descriptions", package)
    rover = types.ModuleType("robot_descriptions.rover_mj_description")
    rover.MJCF_PATH = str(ROVER_XML)
    monkeypatch.setitem(sys.modules, rover.__name__, rover)
    assert robot_path("rover") == robot_path("rover_mj_description") == ROVER_XML
    arm = types.ModuleType("robot_descriptions.arm_description")
    monkeypatch.setitem(sys.modules, arm.__name__, arm)
    with pytest.raises(RobotError, match="arm_description of robot_descriptions has no MJCF file"):
        robot_path("arm_description")
    # Like a failed download: the module cannot be imported.
    with pytest.raises(RobotError, match=r"could not fetch stretch_3_mj_description .* check the network, or give"):
        robot_path("stretch_3_mj_description")


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        (
            "Cmd('git') failed due to: exit code(128)\n  cmdline: git clone -v -- https://git.example/r.git\n  stderr: "
            "'Cloning into '/x'...\nfatal: unable to access 'https://git.example/r.git/': Could not resolve host: "
            "git.example\n'",
            "git.example cannot be reached",
        ),
        ("exit code(128) stderr: 'Cloning into...\nfatal: repository not found\n'", "repository not found"),
        ("x" * 300, "OSError of its download"),
    ],
)
def test_a_failed_download_is_one_clear_sentence(monkeypatch, said, reason):
    package = types.ModuleType("robot_descriptions")
    package.DESCRIPTIONS = {"stretch_3_mj_description": None}
    monkeypatch.setitem(sys.modules, "robot_descriptions", package)
    monkeypatch.delenv("ANM_MJ_ROBOTS", raising=False)

    def fail(name):
        if name == "robot_descriptions":
            return package
        raise OSError(said)

    monkeypatch.setattr(importlib, "import_module", fail)
    with pytest.raises(
        RobotError, match=rf"could not fetch stretch_3_mj_description \({reason}\); check the network, or"
    ):
        robot_path("stretch_3_mj_description")


def test_what_is_no_robot(tmp_path):
    with pytest.raises(RobotError, match="is a folder; give the robot's MJCF file in it"):
        robot_path(str(tmp_path))
    with pytest.raises(RobotError, match=r"no robot file .*none\.xml; give an MJCF file or a name"):
        robot_path(str(tmp_path / "none.xml"))
