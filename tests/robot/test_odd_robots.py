"""Robots as others write them, that must work: endless ranges, couplings, odd defaults, cameras on their side."""

import math

import mujoco
import numpy as np
import pytest

from anm_mj.errors import RobotError
from anm_mj.robot.description import describe_robot
from anm_mj.robot.robot_config import RobotConfig
from anm_mj.sim.drives.drive_trial import drive_over_a_floor
from anm_mj.sim.drives.physics_drive import PhysicsDrive
from anm_mj.types import Action, Pose2

WHEEL = (
    '<body name="wheel_{side}" pos="0 {y} -0.04"><joint name="wheel_{side}" axis="0 1 0"/>'
    '<geom type="cylinder" size="0.06 0.02" zaxis="0 1 0" mass="0.3"/></body>'
)
PLAIN = (
    '<mujoco><worldbody><body name="chassis" pos="0 0 0.1"><geom type="box" size="0.18 0.12 0.05" mass="5"/>'
    '<camera name="eye" pos="0.1 0 0.3" xyaxes="0 -1 0 0 0 1" fovy="70"/>'
    '<geom type="sphere" size="0.03" pos="-0.15 0 -0.07"/>'
    + WHEEL.format(side="left", y=0.15)
    + WHEEL.format(side="right", y=-0.15)
    + "</body></worldbody><actuator>"
    '<velocity joint="wheel_left" kv="1"/><velocity joint="wheel_right" kv="1"/></actuator></mujoco>'
)
STEERED = "".join(
    f'<body pos="0.12 {y} -0.04"><joint name="steer_{side}" axis="0 0 1"/><geom size="0.01" mass="0.1"/><body>'
    f'<joint name="front_{side}" axis="0 1 0"/><geom type="cylinder" size="0.06 0.02" zaxis="0 1 0"/></body></body>'
    for side, y in (("a", 0.15), ("b", -0.15))
)


def written(tmp_path, *changes):
    text = PLAIN
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    path = tmp_path / "odd.xml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    "changes",
    [
        [(' axis="0 1 0"', ' axis="0 1 0" range="-100000 100000"')],
        [("<worldbody>", '<default><geom contype="2" conaffinity="4" condim="1"/></default><worldbody>')],
        [("<actuator>", '<equality><joint joint1="wheel_left" joint2="wheel_right"/></equality><actuator>')],
        [("<actuator>", '<tendon><fixed name="t"><joint joint="wheel_left" coef="1"/></fixed></tendon><actuator>'),
         ('<velocity joint="wheel_left" kv="1"/>', '<motor tendon="t"/>')],
        [('name="chassis"', 'name="chassis" gravcomp="1"')],
        [("<worldbody>", '<default><motor ctrlrange="-1 1" ctrllimited="true" forcerange="-1 1" gear="7"/></default>'
          "<worldbody>"),
         ('<velocity joint="wheel_left" kv="1"/>', '<motor joint="wheel_left"/>'),
         ('<velocity joint="wheel_right" kv="1"/>', '<motor joint="wheel_right"/>')],
        [('<camera name="eye"', '<flexcomp name="flag" type="grid" count="3 3 1" spacing="0.02 0.02 0.02" dim="2" '
          'pos="0 0 0.2" radius="0.005" mass="0.1"><edge equality="true"/></flexcomp><camera name="eye"')],
        [('kv="1"', 'kv="10"')],
        [("<worldbody>", '<worldbody><geom name="ground" type="plane" size="9 9 1"/>'),
         ('<geom type="cylinder" size="0.06 0.02" zaxis="0 1 0" mass="0.3"/></body></body>',
          '<geom name="tyre" type="cylinder" size="0.06 0.02" zaxis="0 1 0" mass="0.3"/></body></body>'),
         ("<actuator>", '<contact><pair geom1="ground" geom2="tyre"/><exclude body1="world" body2="chassis"/></contact>'
          '<sensor><framepos objtype="geom" objname="ground"/></sensor><actuator>')],
    ],
    ids=["endless range", "defaults without contact", "coupled wheels", "tendon", "weightless", "defaults of motors",
         "a flag", "stiff servos", "contacts and sensors of its world"],
)  # fmt: skip
def test_it_drives(tmp_path, changes):
    robot = describe_robot(written(tmp_path, *changes))
    test = drive_over_a_floor(robot)
    assert test.fault is None
    assert test.moved_m == pytest.approx(test.asked_m, abs=0.005)
    assert math.degrees(test.turned_rad) == pytest.approx(90.0, abs=1.0)


@pytest.mark.parametrize("name", ["joint_base", "joint_0"])
def test_a_free_joint_keeps_the_name_that_actuators_know_it_by(tmp_path, name):
    free = ('<geom type="box"', f'<freejoint name="{name}"/><geom type="box"')
    thruster = ("</actuator>", f'<general joint="{name}" gear="0 0 1 0 0 0"/></actuator>')
    robot = describe_robot(written(tmp_path, free, thruster))
    assert robot.base_joints == (name,)
    assert drive_over_a_floor(robot).fault is None


@pytest.mark.parametrize(
    ("before", "after", "most_radps"),
    [
        ('<velocity joint="wheel_right" kv="1"/>', '<velocity joint="wheel_right" kv="1" ctrlrange="0 6"/>', 6.0),
        ('name="wheel_right" axis', 'name="wheel_right" stiffness="2" axis', math.inf),
    ],
    ids=["rolls one way", "a spring"],
)
def test_a_servo_that_cannot_turn_its_wheel_is_replaced(tmp_path, before, after, most_radps):
    robot = describe_robot(written(tmp_path, (before, after)))
    assert robot.max_wheel_radps == most_radps
    assert [note.rpartition(" ")[2] for note in robot.notes] == ["actuator_1"]
    spec = mujoco.MjSpec.from_string('<mujoco><worldbody><geom type="plane" size="0 0 1"/></worldbody></mujoco>')
    spec.attach(robot.spec.copy(), prefix="r/", frame=spec.worldbody.add_frame())
    model = spec.compile()
    drive = PhysicsDrive(model, mujoco.MjData(model), robot, prefix="r/")
    drive.place(Pose2(0.0, 0.0, 0.0))
    for _ in range(9):
        drive.act(Action.TURN_RIGHT)
    assert math.degrees(drive.pose.yaw_rad) == pytest.approx(-90.0, abs=1.0)


def test_sensors_on_its_own_wheels_stay(tmp_path):
    added = '<jointpos name="a" joint="wheel_left"/><framepos name="b" objtype="body" objname="crate"/>'
    crate = '<worldbody><body name="crate" pos="3 0 0"><geom size="0.1"/></body>'
    sensors = f"<sensor>{added}</sensor><actuator>"
    robot = describe_robot(written(tmp_path, ("<worldbody>", crate), ("<actuator>", sensors)))
    assert [sensor.name for sensor in robot.spec.sensors] == ["a"]


def test_sensors_of_replaced_motors_go_with_them(tmp_path):
    sensors = '<sensor><actuatorfrc name="torque" actuator="m"/><actuatorvel actuator="n"/></sensor>'
    named = '<custom><tuple name="t"><element objtype="actuator" objname="m"/></tuple></custom>'
    left, right = ('<velocity joint="wheel_left" kv="1"/>', '<velocity joint="wheel_right" kv="1"/>')
    motors = (left, '<motor name="m" joint="wheel_left"/>'), (right, '<motor name="n" joint="wheel_right"/>')
    robot = describe_robot(written(tmp_path, ("<actuator>", f"{sensors}{named}<actuator>"), *motors))
    assert not robot.spec.sensors
    assert drive_over_a_floor(robot).fault is None


@pytest.mark.parametrize(
    ("compiler", "mass_kg"),
    [
        ('settotalmass="20"', 20.0),
        ('settotalmass="20" boundmass="1"', 20.0),
        ('inertiagrouprange="0 0"', 5.0 + 0.6 + 0.113),
        ('inertiagrouprange="1 5"', 3.6),
    ],
)
def test_masses_are_those_of_the_file(tmp_path, compiler, mass_kg):
    changes = [("<worldbody>", f"<compiler {compiler}/><worldbody>")]
    if "1 5" in compiler:
        seen = '<geom size="0.05" mass="3" group="1" contype="0" conaffinity="0"/><camera name="eye"'
        changes += [('<camera name="eye"', seen), ('mass="0.3"', 'mass="0.3" group="1"')]
    path = written(tmp_path, *changes)
    robot = describe_robot(path)
    assert robot.mass_kg == pytest.approx(mass_kg, abs=1e-3)
    assert robot.mass_kg == pytest.approx(float(mujoco.MjModel.from_xml_path(str(path)).body_mass.sum()))
    world = mujoco.MjSpec()
    world.attach(robot.spec.copy(), prefix="r/", frame=world.worldbody.add_frame())
    assert float(world.compile().body_mass.sum()) == pytest.approx(mass_kg, abs=1e-3)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", ['nkey="2"', 'memory="1M"', 'nuserdata="5"', 'nuser_body="3" nuser_cam="1"'])
def test_room_that_its_file_asks_for_does_not_disturb_a_scene(tmp_path, size):
    robot = describe_robot(written(tmp_path, ("<worldbody>", f"<size {size}/><worldbody>")))
    assert drive_over_a_floor(robot).fault is None


@pytest.mark.parametrize("sinks_m", [0.0, 0.005])
def test_it_stands_on_the_floor_whatever_margin_its_file_gives(tmp_path, sinks_m):
    margin = '<default><geom margin="0.01"/></default><worldbody>'
    caster = ('pos="-0.15 0 -0.07"', f'pos="-0.15 0 {-0.07 - sinks_m}"')
    robot = describe_robot(written(tmp_path, ("<worldbody>", margin), caster))
    spec = mujoco.MjSpec.from_string('<mujoco><worldbody><geom type="plane" size="0 0 1"/></worldbody></mujoco>')
    spec.attach(robot.spec.copy(), prefix="r/", frame=spec.worldbody.add_frame())
    model = spec.compile()
    data = mujoco.MjData(model)
    drive = PhysicsDrive(model, data, robot, prefix="r/")
    drive.place(Pose2(0.0, 0.0, 0.0))
    drive.act(Action.MOVE_FORWARD)
    mujoco.mj_forward(model, data)
    assert data.body("r/wheel_left").xpos[2] == pytest.approx(robot.wheel_radius_m, abs=1e-3)


def test_its_only_camera_needs_no_name(tmp_path):
    named = describe_robot(written(tmp_path))
    seen = describe_robot(written(tmp_path, ('<camera name="eye"', "<camera")))
    assert (seen.camera, seen.fovy_deg) == ("camera_0", 70.0)
    np.testing.assert_array_equal(seen.T_base_camera, named.T_base_camera)
    second = '<camera name="eye" pos="0 0 0.4" xyaxes="0 -1 0 0 0 1"/><camera pos="0.1'
    assert describe_robot(written(tmp_path, ('<camera name="eye" pos="0.1', second))).camera == "eye"


@pytest.mark.parametrize(
    "default", ['mode="track"', 'resolution="640 480" sensorsize="0.004 0.003" focal="0.003 0.003"']
)
def test_a_mounted_camera_is_none_of_the_defaults(tmp_path, default):
    path = written(tmp_path, ("<worldbody>", f"<default><camera {default}/></default><worldbody>"))
    robot = describe_robot(path, RobotConfig(camera_pose="0.2,0,0.3,10,60"))
    model = robot.spec.compile()
    camera = model.camera(robot.camera)
    assert robot.fovy_deg == 60.0
    assert camera.mode == mujoco.mjtCamLight.mjCAMLIGHT_FIXED
    assert not model.cam_sensorsize[camera.id].any()


def test_a_camera_on_its_side_is_turned_upright(tmp_path):
    upright = describe_robot(written(tmp_path))
    for axes in ("0 0 -1 0 -1 0", "0 1 0 0 0 -1"):
        robot = describe_robot(written(tmp_path, ("0 -1 0 0 0 1", axes)))
        np.testing.assert_allclose(robot.T_base_camera, upright.T_base_camera, atol=1e-9)
        assert any("turned upright" in note for note in robot.notes)
    assert upright.notes == ()


def test_the_base_of_a_urdf_is_not_fused_with_the_world(tmp_path):
    mass = '<inertial><mass value="{}"/><inertia ixx="1e-2" iyy="1e-2" izz="1e-2" ixy="0" ixz="0" iyz="0"/></inertial>'
    wheels = "".join(
        f'<link name="{side}_wheel"><collision><origin rpy="1.5708 0 0"/><geometry><cylinder radius="0.06" '
        f'length="0.03"/></geometry></collision>{mass.format(0.3)}</link><joint name="{side}_wheel_joint" '
        f'type="continuous"><parent link="base"/><child link="{side}_wheel"/><origin xyz="0 {y} -0.03"/>'
        '<axis xyz="0 1 0"/></joint>'
        for side, y in (("left", 0.15), ("right", -0.15))
    )
    box = '<collision><geometry><box size="0.3 0.2 0.1"/></geometry></collision>'
    body = f'<link name="base">{box}{mass.format(3)}</link>'
    path = tmp_path / "odd.urdf"
    path.write_text(f'<robot name="odd">{body}{wheels}</robot>')
    robot = describe_robot(path, RobotConfig(camera_pose="0.1,0,0.3,0,70"))
    assert (robot.root, robot.wheel_joints) == ("base", ("left_wheel_joint", "right_wheel_joint"))
    assert robot.mass_kg == pytest.approx(3.6)


@pytest.mark.parametrize(
    "joint", ['name="wheel_drop_{}" type="slide" axis="0 0 1"', 'name="{}_wheel_arm" axis="0 1 0" range="-5 5"']
)
def test_suspensions_that_are_named_like_wheels_are_none(tmp_path, joint):
    changes = [("<actuator>", ""), ("</actuator>", "")]
    changes += [(f'<velocity joint="wheel_{side}" kv="1"/>', "") for side in ("left", "right")]
    for side, y in (("left", 0.15), ("right", -0.15)):
        arm = f'<joint {joint.format(side)}/><geom size="0.01" mass="0.1" contype="0" conaffinity="0"/>'
        changes.append((f'<body name="wheel_{side}" pos="0 {y} -0.04">', f'<body pos="0 {y} -0.04">{arm}<body>'))
    changes.append(('mass="0.3"/></body>', 'mass="0.3"/></body></body>'))
    robot = describe_robot(written(tmp_path, *changes))
    assert robot.wheel_joints == ("wheel_left", "wheel_right")
    assert robot.locked == tuple(joint.format(side).split('"')[1] for side in ("left", "right"))


def test_cars_are_refused_unless_their_driven_wheels_are_named(tmp_path):
    act = '<position joint="steer_a" kp="9"/><position joint="steer_b" kp="9"/></actuator>'
    path = written(tmp_path, ("</body></worldbody>", f"{STEERED}</body></worldbody>"), ("</actuator>", act))
    with pytest.raises(RobotError, match=r"steers its wheels \(steer_a, steer_b\), like a car"):
        describe_robot(path)
    named = describe_robot(path, RobotConfig(left_wheel="wheel_left", right_wheel="wheel_right"))
    assert {"steer_a", "steer_b"} <= set(named.locked)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ([("<worldbody>", '<default><geom contype="0" conaffinity="0"/></default><worldbody>')], "no solid geom"),
        ([(f'pos="0 {y} -0.04"', f'pos="0 {y / 100} -0.04"') for y in (0.15, -0.15)], "are 3 mm apart"),
    ],
    ids=["nothing solid", "tiny"],
)
def test_it_is_refused_in_a_sentence(tmp_path, changes, said):
    with pytest.raises(RobotError, match=said):
        describe_robot(written(tmp_path, *changes))


def test_a_body_that_meets_nothing_is_noted(tmp_path):
    path = written(tmp_path, ("<geom ", '<geom contype="0" conaffinity="0" '))
    path.write_text(
        path.read_text()
        .replace('zaxis="0 1 0"', 'zaxis="0 1 0" contype="1"')
        .replace('contype="0" conaffinity="0" type="cylinder"', 'type="cylinder"')
    )
    robot = describe_robot(path)
    assert any("nothing but its wheels is solid" in note for note in robot.notes)
    assert robot.footprint.z_max_m < 0.13
