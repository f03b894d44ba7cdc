"""What a URDF says that MuJoCo does not read: where its meshes lie, and how fast its wheels may turn."""

import math

import pytest
import trimesh

from anm_mj.bench.sweep import read_jobs
from anm_mj.errors import RobotError
from anm_mj.robot.robot_config import RobotConfig
from anm_mj.sim.describe_file import describe_file, file_hash
from anm_mj.sim.drives.drive_trial import drive_over_a_floor

MOUNTED = RobotConfig(camera_pose="0.1,0,0.3,0,70")
_MASS = '<inertial><mass value="{}"/><inertia ixx="1e-2" iyy="1e-2" izz="1e-2" ixy="0" ixz="0" iyz="0"/></inertial>'


def written(tmp_path, limits, edge_m=0.3):
    """A robot of two wheels of 6 cm, in a package ``my_bot``, whose body is a mesh."""
    folder = tmp_path / "my_bot"
    folder.mkdir(exist_ok=True)
    (folder / "package.xml").write_text("<package><name>my_bot</name></package>")
    trimesh.creation.box((edge_m, 0.2, 0.1)).export(folder / "base.stl")
    wheels = "".join(
        f'<link name="{side}_wheel">{_MASS.format(0.3)}<collision><origin rpy="1.5708 0 0"/><geometry><cylinder '
        f'radius="0.06" length="0.03"/></geometry></collision></link><joint name="{side}_wheel_joint" '
        f'type="continuous"><parent link="base"/><child link="{side}_wheel"/><origin xyz="0 {y} -0.03"/><axis '
        f'xyz="0 1 0"/>{limit}</joint>'
        for side, y, limit in zip(("left", "right"), (0.15, -0.15), limits, strict=True)
    )
    caster = '<collision><origin xyz="-0.14 0 -0.07"/><geometry><sphere radius="0.02"/></geometry></collision>'
    shape = '<collision><geometry><mesh filename="package://my_bot/base.stl"/></geometry></collision>'
    path = folder / "bot.urdf"
    path.write_text(f'<robot name="bot"><link name="base">{_MASS.format(3)}{shape}{caster}</link>{wheels}</robot>')
    return path


@pytest.mark.parametrize(
    ("limits", "most_radps"),
    [
        (('<limit effort="5" velocity="4"/>', '<limit effort="5" velocity="3"/>'), 3.0),
        (('<limit effort="5" velocity="0"/>', '<limit effort="5"/>'), math.inf),
    ],
)
def test_wheels_turn_as_fast_as_the_limits_of_their_joints_say(tmp_path, limits, most_radps):
    robot = describe_file(written(tmp_path, limits), MOUNTED)
    assert robot.max_wheel_radps == most_radps
    trial = drive_over_a_floor(robot)
    assert trial.fault is None
    assert trial.moved_m == pytest.approx(trial.asked_m, abs=0.005)


@pytest.mark.parametrize(("velocity", "said"), [("fast", "'fast' of its joint"), ("0.01", "velocity of their limits")])
def test_a_velocity_that_none_can_have_is_refused_in_a_sentence(tmp_path, velocity, said):
    path = written(tmp_path, [f'<limit effort="5" velocity="{velocity}"/>'] * 2)
    with pytest.raises(RobotError, match=said):
        describe_file(path, MOUNTED)


def test_comparisons_take_a_urdf_and_know_its_meshes(tmp_path):
    path = written(tmp_path, ("", ""))
    before = file_hash(path)
    toml = tmp_path / "own.toml"
    toml.write_text('scenes = ["home"]\npolicies = ["gvg"]\nrobot = ["my_bot/bot.urdf"]\n')
    assert [job.robot_hash for job in read_jobs(toml)] == [before]
    assert file_hash(written(tmp_path, ("", ""), edge_m=0.31)) != before
    assert file_hash(written(tmp_path, ['<limit effort="5" velocity="4"/>'] * 2)) != before
