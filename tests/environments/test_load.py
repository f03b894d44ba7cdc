"""Exploration behind the dm_env interface."""

import math
from pathlib import Path

import numpy as np
import pytest
from absl.testing import absltest
from dm_env import StepType
from dm_env.test_utils import EnvironmentTestMixin

import anm_mj
from anm_mj.environments.load import ExploreEnvironment
from anm_mj.environments.surface_coverage import SampleGrid
from anm_mj.environments.task import sensed_depth
from anm_mj.errors import SceneError, TaskError
from anm_mj.evaluation.completion import Coverage
from anm_mj.ground_truth.cache import cached_ground_truth
from anm_mj.ground_truth.pixel_rays import CameraExtrinsics
from anm_mj.ground_truth.reduced_depth import reduce_depth
from anm_mj.scene.folder import load_scene
from anm_mj.scene.navigable import is_clear
from anm_mj.sim.simulation_config import DRIVES
from anm_mj.types import DEFAULT_FOOTPRINT, Action, Intrinsics

ROVER = Path(__file__).resolve().parents[1] / "rover.xml"
_ACTIONS = [Action.TURN_LEFT] * 3 + [Action.MOVE_FORWARD] * 4 + [Action.TURN_RIGHT]


def _load(**options) -> ExploreEnvironment:
    return anm_mj.load_environment("home", **{"image_px": 32, **options})


@pytest.fixture(scope="module")
def environment():
    environment = _load(num_steps=len(_ACTIONS), topdown=True)
    yield environment
    environment.close()


class TestContract(EnvironmentTestMixin, absltest.TestCase):
    """dm_env's own tests of its contract."""

    def make_object_under_test(self):
        return _load(num_steps=5, topdown=True)

    def make_action_sequence(self):
        # Cut off after five steps, then, one step after the reset, stopped.
        yield from np.array([1, 2, 3, 1, 1, 0, 1, 0, 0, 1], np.int32)


def test_an_episode_is_cut_off_with_discount_1(environment):
    environment.reset()
    steps = [environment.step(action) for action in _ACTIONS]
    assert [step.step_type for step in steps] == [StepType.MID] * 7 + [StepType.LAST]
    assert steps[-1].discount == 1.0


def test_stop_ends_the_episode_with_discount_0(environment):
    environment.reset()
    environment.step(Action.TURN_LEFT)
    last = environment.step(np.array(Action.STOP))
    assert (last.step_type, last.discount, last.reward) == (StepType.LAST, 0.0, 0.0)
    assert environment.step(Action.TURN_LEFT).first()


def test_rewards_match_the_evaluation(environment):
    environment.reset()
    view = environment.task.view
    camera = CameraExtrinsics.of_view(Intrinsics.from_fov(256, 256, math.radians(90.0)), view.T_world_camera, view.pose)
    truth = cached_ground_truth(load_scene("home"), DEFAULT_FOOTPRINT, camera, view.pose)
    evaluation = Coverage(truth.samples, truth.observable)
    total = environment.task.coverage
    assert total > 0.0
    for action in [None, *_ACTIONS]:
        if action is not None:
            total += environment.step(action).reward
        view = environment.task.view
        evaluation.add(reduce_depth(view.depth_m), view.intrinsics, view.T_world_camera)
    assert environment.task.coverage == pytest.approx(total, abs=1e-12)
    completion = evaluation.completion()
    percent = completion.ratio_percent if truth.observable is None else completion.observable_ratio_percent
    assert environment.task.coverage == pytest.approx(percent / 100.0, abs=1e-12)


def test_the_pose_is_relative_to_the_start(environment):
    first = environment.reset().observation
    np.testing.assert_allclose(first["pose"], [0.0, 0.0, 0.0], atol=1e-9)
    for action in (Action.TURN_LEFT, Action.TURN_LEFT, Action.TURN_LEFT, Action.TURN_RIGHT):
        observation = environment.step(action).observation
    np.testing.assert_allclose(observation["pose"], [0.0, 0.0, math.radians(20.0)], atol=1e-6)


def test_forward_step():
    environment = _load(start=(load_scene("home").starts[0].x_m, load_scene("home").starts[0].y_m, 123.0))
    environment.reset()
    pose = environment.step(Action.MOVE_FORWARD).observation["pose"]
    environment.close()
    np.testing.assert_allclose(pose, [0.065, 0.0, 0.0], atol=1e-6)


def test_time_is_that_of_the_episode(environment):
    environment.reset()
    assert environment.physics.time() == 0.0
    environment.step(Action.MOVE_FORWARD)
    assert environment.physics.time() == pytest.approx(environment.control_timestep())


def test_nothing_within_range_is_depth_0():
    depth_m = np.array([[np.nan, 0.5, 10.0, 10.5, np.inf]], np.float32)
    sensed = sensed_depth(depth_m)
    assert sensed.dtype == np.float32
    np.testing.assert_array_equal(sensed, np.array([[0.0, 0.5, 10.0, 0.0, 0.0]], np.float32))


@pytest.mark.parametrize("drive", DRIVES)
def test_episodes_are_deterministic(drive):
    x, y = load_scene("home").starts[0].xy_m.tolist()
    environment = _load(start=(x, y, 0.0), drive=drive)
    episodes = []
    for _ in range(2):
        steps = [environment.reset(), *(environment.step(action) for action in _ACTIONS)]
        episodes.append([(step.reward, *(value.tobytes() for value in step.observation.values())) for step in steps])
    environment.close()
    assert episodes[0] == episodes[1]


def test_the_seed_decides_the_starts():
    starts = []
    for seed in (3, 3, 4):
        environment = _load(seed=seed, image_px=16)
        poses = []
        for _ in range(2):
            environment.reset()
            poses.append(environment.task.view.pose)
        environment.close()
        starts.append(poses)
    assert starts[0] == starts[1] != starts[2]
    assert starts[0][0] != starts[0][1]


def test_reuse_after_close():
    environment = _load()
    environment.close()
    for _ in range(2):
        assert environment.reset().first()
        environment.close()
        environment.close()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"task": "fly"}, 'no task "fly"; choose one of explore'),
        ({"seed": -1}, "The seed is -1"),
        ({"steps": 5}, 'no option "steps"; it has num_steps, start'),
        ({"num_steps": 0}, "num_steps is 0; an episode has 1 to"),
        ({"drive": "magic"}, "no drive 'magic'; choose one of kinematic, physics"),
        ({"image_px": 8}, "image_px is 8"),
        ({"actions": "jump"}, 'no actions "jump"; choose one of discrete, velocity'),
        ({"reward": "gold"}, 'no reward "gold"; choose one of surface, area, information'),
        ({"actions": "velocity", "num_steps": 10_000}, "an episode has 1 to 9900"),
        ({"start": (0.0, 1.0)}, r"start \(0.0, 1.0\) is no pose"),
        ({"start": (0.0, math.nan, 0.0)}, "is no pose"),
        ({"num_steps": "10"}, r"num_steps is '10' \(Expected int \| None, got str\); give a value of the right type"),
        ({"image_px": "128"}, "image_px is '128'"),
        ({"people": "3"}, "people is '3'"),
        ({"stop": "false"}, "stop is 'false'"),
        ({"robot": None}, "robot is None"),
    ],
)
def test_invalid_options(options, message):
    with pytest.raises(TaskError, match=message):
        anm_mj.load_environment("home", **options)


def test_start_in_collision():
    with pytest.raises(SceneError, match="nearest clear place is"):
        _load(start=(100.0, 100.0, 0.0))


@pytest.fixture
def whole_surface(monkeypatch):
    """The search for the observable surface takes seconds per scene and robot; here the whole surface counts."""

    def grid(scene, *_):
        return SampleGrid(scene.triangles()[0])

    monkeypatch.setattr("anm_mj.environments.task.observable_surface", grid)


def test_every_episode_draws_a_scene(whole_surface):
    environment = anm_mj.load_environment(["room", "flat"], image_px=16, num_steps=5)
    names = []
    for _ in range(4):
        environment.reset()
        names.append(environment.task.scene.name)
        assert is_clear(environment.task.scene, environment.task.view.pose, DEFAULT_FOOTPRINT)
    environment.close()
    assert set(names) == {"room", "flat"}


def test_noise_differs_between_episodes_and_repeats_with_the_seed():
    x, y = load_scene("room").starts[0].xy_m.tolist()
    seen = []
    for _ in range(2):
        environment = anm_mj.load_environment("room", image_px=32, start=(x, y, 0.0), sensor="d435i", seed=3)
        seen.append([environment.reset().observation["rgb"] for _ in range(2)])
        environment.close()
    assert (seen[0][0] != seen[0][1]).any()
    np.testing.assert_array_equal(seen[0], seen[1])


def test_an_agent_without_stop():
    environment = anm_mj.load_environment("room", image_px=16, num_steps=3, stop=False)
    assert environment.action_spec().num_values == 3
    environment.reset()
    assert environment.step(0).mid()
    assert environment.physics.result.action is Action.MOVE_FORWARD
    environment.step(1)
    assert environment.physics.result.action is Action.TURN_LEFT
    with pytest.raises(TaskError, match="0 MOVE_FORWARD, 1 TURN_LEFT, 2 TURN_RIGHT"):
        environment.step(3)
    environment.close()


def test_velocities():
    x, y = load_scene("room").starts[0].xy_m.tolist()
    environment = anm_mj.load_environment("room", image_px=16, num_steps=3, actions="velocity", start=(x, y, 0.0))
    environment.reset()
    turned = environment.step(np.array([0.0, 1.0], np.float32)).observation["pose"]
    assert turned[2] == pytest.approx(1.8 * 0.2, abs=0.02)
    moved = environment.step(np.array([0.5, 0.0], np.float32)).observation["pose"]
    assert np.hypot(*(moved[:2] - turned[:2])) == pytest.approx(0.25 * 0.2, abs=0.005)
    with pytest.raises(TaskError, match="is no velocity"):
        environment.step(1)
    last = environment.step(np.zeros(2, np.float32))
    assert (last.last(), last.discount) == (True, 1.0)
    environment.close()


@pytest.mark.parametrize("reward", ["area", "information"])
def test_other_rewards(reward):
    environment = anm_mj.load_environment("room", image_px=64, reward=reward)
    environment.reset()
    begun = environment.task.known
    rewards = [environment.step(Action.TURN_LEFT).reward for _ in range(8)]
    assert begun > 0.0
    assert sum(rewards) == pytest.approx(environment.task.known - begun)
    assert sum(rewards) > 0.0
    environment.close()


def test_another_robot(whole_surface):
    environment = anm_mj.load_environment("room", image_px=16, robot=str(ROVER), num_steps=3)
    environment.reset()
    assert environment.physics.robot.footprint != DEFAULT_FOOTPRINT
    assert environment.step(Action.TURN_LEFT).mid()
    environment.close()


@pytest.mark.parametrize("action", [4, -1, "left", None, 1.7, "1", math.inf, [1, 2]])
def test_invalid_action(environment, action):
    environment.reset()
    with pytest.raises(TaskError, match="is no action; give one of 0 STOP, 1 MOVE_FORWARD"):
        environment.step(action)
