"""A camera that begins images before they are asked for shows what the camera within it shows."""

import threading
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from anm_mj.errors import RenderError
from anm_mj.people.people_config import PeopleConfig
from anm_mj.scene.folder import load_scene
from anm_mj.sim.camera import Camera
from anm_mj.sim.gl_camera import GlCamera
from anm_mj.sim.make_robot import make_robot
from anm_mj.sim.sensors.sensor_config import SENSORS
from anm_mj.sim.sim_robot import SimRobot
from anm_mj.sim.simulation_config import SimulationConfig
from anm_mj.sim.views_ahead import AheadCamera
from anm_mj.types import Action, Observation, Pose2, Twist
from anm_mj.utils import threads

_MODEL = """<mujoco><worldbody><geom type="box" pos="3 0 0" size="0.5 9 9"/>
<body name="base"><joint name="x" type="slide" axis="1 0 0"/><geom size="0.1"/>
<camera name="camera" xyaxes="0 -1 0 0 0 1"/></body></worldbody></mujoco>"""


class Counting(Camera):
    """An image of one pixel that shows where the camera is, and who asked for it."""

    kind = "counting"

    def __init__(self, model):
        super().__init__(model, "camera", 1, 1)
        self.calls, self.threads, self.lent, self.closed = 0, set(), [], False
        self.started = threading.Event()

    def render(self, data):
        if self.closed:
            raise RenderError("closed")
        self.calls += 1
        self.started.set()
        self.threads.add(threading.get_ident())
        self.lent.append(threads._lent)
        return np.zeros((1, 1, 3), np.uint8), data.cam_xpos[:1, :1].astype(np.float32)

    def close(self):
        self.closed = True


@pytest.fixture
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(_MODEL)


def at(model: mujoco.MjModel, x_m: float) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[0] = x_m
    mujoco.mj_forward(model, data)
    return data


def test_an_image_that_was_begun_is_the_one_that_is_given_out(model):
    inner = Counting(model)
    with AheadCamera(lambda: inner) as camera:
        camera.begin(at(model, 1.0))
        assert camera.render(at(model, 1.0))[1] == 1.0
        assert inner.calls == 1
        # Once only.
        assert camera.render(at(model, 1.0))[1] == 1.0
        assert inner.calls == 2
        assert camera.intrinsics == inner.intrinsics
        assert camera.kind == "counting"


def test_another_view_than_the_one_begun_is_rendered(model):
    inner = Counting(model)
    with AheadCamera(lambda: inner) as camera:
        camera.begin(at(model, 1.0))
        assert inner.started.wait(60.0)
        assert camera.render(at(model, np.nextafter(1.0, 2.0)))[1] == np.float32(1.0)
        assert inner.calls == 2


def test_images_are_given_out_in_the_order_in_which_they_were_begun(model):
    inner = Counting(model)
    with AheadCamera(lambda: inner) as camera:
        for x_m in (1.0, 2.0, 3.0):
            camera.begin(at(model, x_m))
        assert camera.num_begun == 3
        assert [camera.render(at(model, x_m))[1].item() for x_m in (1.0, 2.0)] == [1.0, 2.0]
        # The third may still be being drawn.
        assert camera.num_begun == 1
        assert camera.render(at(model, 3.0))[1] == 3.0
        assert (inner.calls, camera.num_begun) == (3, 0)


def test_a_wrong_guess_gives_up_those_after_it(model):
    inner = Counting(model)
    with AheadCamera(lambda: inner) as camera:
        camera.begin(at(model, 1.0))
        camera.begin(at(model, 2.0))
        assert camera.render(at(model, 5.0))[1] == 5.0
        assert camera.num_begun == 0
        for x_m in (1.0, 2.0, 3.0):
            camera.begin(at(model, x_m))
        camera.give_up(1)
        assert camera.num_begun == 1
        assert camera.render(at(model, 1.0))[1] == 1.0


def test_all_images_come_from_one_thread_and_lend_it_a_core(model):
    inner = Counting(model)
    with AheadCamera(lambda: inner) as camera:
        camera.begin(at(model, 1.0))
        camera.render(at(model, 1.0))
        camera.render(at(model, 2.0))
        assert len(inner.threads) == 1
        assert threading.get_ident() not in inner.threads
        # Whoever waits for an image computes nothing else.
        assert inner.lent == [1, 0]
    assert threads._lent == 0


def test_an_image_that_failed_ahead_fails_when_it_is_wanted(model):
    inner = Counting(model)
    camera = AheadCamera(lambda: inner)
    inner.closed = True
    camera.begin(at(model, 1.0))
    with pytest.raises(RenderError, match="closed"):
        camera.render(at(model, 1.0))
    inner.closed = False
    assert camera.render(at(model, 1.0))[1] == 1.0
    camera.close()
    camera.close()
    camera.begin(at(model, 1.0))
    with pytest.raises(RenderError, match="closed"):
        camera.render(at(model, 1.0))


def test_what_fails_when_the_camera_is_made_is_told(model):
    with pytest.raises(RenderError, match='no camera "other"'):
        AheadCamera(lambda: GlCamera(model, "other", 8, 8))


def same(seen: Observation, expected: Observation) -> bool:
    arrays = ("rgb", "depth_m", "T_world_camera")
    equal = all(np.array_equal(getattr(seen, each), getattr(expected, each), equal_nan=True) for each in arrays[:2])
    return equal and np.array_equal(seen.T_world_camera, expected.T_world_camera) and seen.pose == expected.pose


# An image of the present and one that is late, of an exact camera and of a noisy one.
REAL = {"pose": "odometry", "sensor": replace(SENSORS["d435i"], delay_s=0.1), "people": PeopleConfig(number=2)}


@pytest.mark.parametrize("options", [{}, {"drive": "physics"}, {"drive": "physics", **REAL}, REAL])
def test_a_robot_that_anticipates_does_and_sees_the_same(monkeypatch, options):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    scene, config = load_scene("flat"), SimulationConfig("flat", **{"image_px": 64, **options})
    config = replace(config, model=replace(config.model, wheel_noise=0.02))
    forward, left, right = Action.MOVE_FORWARD, Action.TURN_LEFT, Action.TURN_RIGHT
    # Twice a second guess is taken back before it is due, twice a guess was wrong.
    guesses = [(forward, left), (left,), (left, left), (forward, forward), (right,), (), (left, forward), (right,)]
    actions = [forward, left, right, forward, right, right, left, forward]
    with make_robot(scene, config, anticipates=True) as robot, make_robot(scene, config) as plain:
        for guess, action in [*zip(guesses, actions, strict=True)] + [((forward, forward), forward)] * 80:
            robot.anticipate(*guess)
            result = robot.act(action)
            assert plain.act(action) == result
            assert same(robot.observe(), plain.observe())
            assert np.array_equal(robot.get_state(), plain.get_state())
            if result.collided:
                return  # The kinematic guess was wrong here.
        pytest.fail("the robot never met the wall")


def test_an_action_that_was_begun_elsewhere_is_forgotten(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    scene, forward = load_scene("flat"), Action.MOVE_FORWARD
    config = SimulationConfig("flat", drive="physics", pose="odometry", image_px=64)
    config = replace(config, model=replace(config.model, wheel_noise=0.02))

    def moved(robot: SimRobot) -> None:
        robot.drive(Twist(0.2, 0.3), 0.2)

    def placed(robot: SimRobot) -> None:
        robot.place(Pose2(robot.pose.x_m, robot.pose.y_m, 0.5))

    with make_robot(scene, config, anticipates=True) as robot, make_robot(scene, config) as plain:
        start = robot.pose
        # Before anything has moved, nothing but the seed tells one restart from the other.
        for each in (robot, plain):
            each.restart(start, seed=1)
        for between in (
            lambda each: each.restart(start, seed=2),
            moved,
            placed,
            lambda each: each.restart(start, seed=3),
            lambda each: each.look_at(np.ones(3)),
        ):
            robot.anticipate(forward)
            between(robot)
            between(plain)
            assert robot.act(forward) == plain.act(forward)
            assert same(robot.observe(), plain.observe())
            robot.anticipate(forward)
            assert robot.act(forward) == plain.act(forward)
            # Without an image between them.
            assert robot.act(forward) == plain.act(forward)
            assert same(robot.observe(), plain.observe())


def test_an_action_that_was_begun_is_not_executed_again(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    with make_robot(load_scene("flat"), drive="physics", image_px=64, anticipates=True) as robot:
        for taken in (True, False):
            robot.anticipate(Action.MOVE_FORWARD if taken else Action.TURN_LEFT)
            before, executed = robot.pose, []
            monkeypatch.setattr(robot._drive, "_execute", lambda action, to=executed: to.append(action) or False)
            result = robot.act(Action.MOVE_FORWARD)
            monkeypatch.undo()
            monkeypatch.setenv("OMP_NUM_THREADS", "2")
            assert bool(executed) is not taken
            assert (robot.pose != before) is taken
            assert not result.collided
            robot.observe()
