"""A camera that begins images before they are asked for shows what the camera within it shows."""

import threading

import mujoco
import numpy as np
import pytest

from anm_mj.errors import RenderError
from anm_mj.scene.folder import load_scene
from anm_mj.sim.ahead_camera import AheadCamera
from anm_mj.sim.camera import Camera
from anm_mj.sim.gl_camera import GlCamera
from anm_mj.sim.make_robot import make_robot
from anm_mj.types import Action
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


def test_a_robot_that_anticipates_sees_the_same(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    scene = load_scene("flat")
    forward, left, right = Action.MOVE_FORWARD, Action.TURN_LEFT, Action.TURN_RIGHT
    # Twice a second guess is taken back before it is due, once a guess was wrong.
    guesses = [(forward, left), (left,), (left, left), (forward, forward), (right,), (), (left, forward)]
    actions = [forward, left, right, forward, right, right, left]
    with make_robot(scene, image_px=64, anticipates=True) as robot, make_robot(scene, image_px=64) as plain:
        for guess, action in [*zip(guesses, actions, strict=True)] + [((forward, forward), forward)] * 80:
            robot.anticipate(*guess)
            collided = robot.act(action).collided
            assert plain.act(action).collided == collided
            seen, expected = robot.observe(), plain.observe()
            assert np.array_equal(seen.rgb, expected.rgb)
            assert np.array_equal(seen.depth_m, expected.depth_m, equal_nan=True)
            assert np.array_equal(seen.T_world_camera, expected.T_world_camera)
            if collided:
                return  # The guess was wrong here.
        pytest.fail("the robot never met the wall")
