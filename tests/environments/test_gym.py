"""Exploration behind the Gymnasium interface, alone and many at once."""

import copy
import inspect
import os
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import anm_mj
import anm_mj.environments
from anm_mj.environments.gym import ExploreEnv
from anm_mj.environments.load import load_environment
from anm_mj.environments.wrappers import KeepDistance
from anm_mj.errors import RenderError, TaskError
from anm_mj.scene.folder import load_scene
from anm_mj.sim import gl
from anm_mj.types import Action

_ID = "AnmMj/Explore-v0"
_OPTIONS = {"scene": "home", "image_px": 32, "num_steps": 6}
_ROOT = Path(__file__).resolve().parents[2]


def test_people_look_the_same_whatever_episodes_there_were_before():
    looks = []
    for seeds in ((5,), (1, 5)):
        env = gymnasium.make(_ID, **_OPTIONS, people=2)
        for seed in seeds:
            env.reset(seed=seed)
        model = env.unwrapped._environment.physics.robot.model
        looks.append((model.geom_size.copy(), model.geom_rgba.copy(), model.mat_rgba.copy()))
        env.close()
    for first, second in zip(*looks, strict=True):
        np.testing.assert_array_equal(first, second)


@pytest.fixture
def env():
    env = gymnasium.make(_ID, render_mode="rgb_array", **_OPTIONS)
    yield env
    env.close()


@pytest.mark.parametrize(
    "options", [{"topdown": True}, {"actions": "velocity", "distance": True}, {"stop": False, "reward": "information"}]
)
def test_gymnasiums_own_checker_finds_nothing(options):
    env = gymnasium.make(_ID, **{**_OPTIONS, "scene": "room", **options}).unwrapped
    check_env(env)
    env.close()


def test_same_episode_as_dm_env(env):
    x, y = load_scene("home").starts[0].xy_m.tolist()
    start = (x, y, 30.0)
    observation, info = env.reset(options={"start": start})
    other = anm_mj.load_environment("home", start=start, image_px=32, num_steps=6)
    step = other.reset()
    np.testing.assert_allclose(info["pose"], [x, y, np.radians(30.0)], atol=1e-9)
    for action in (Action.MOVE_FORWARD, Action.TURN_LEFT, Action.TURN_LEFT, Action.MOVE_FORWARD):
        for name, value in step.observation.items():
            np.testing.assert_array_equal(observation[name], value)
        observation, reward, terminated, truncated, info = env.step(int(action))
        step = other.step(action)
        assert (reward, terminated, truncated) == (step.reward, False, False)
        assert info["coverage"] == other.task.coverage
    other.close()


def test_truncation_and_termination(env):
    env.reset(seed=0)
    ends = [env.step(Action.TURN_LEFT)[2:4] for _ in range(6)]
    assert ends == [(False, False)] * 5 + [(False, True)]
    env.reset()
    assert env.step(Action.STOP)[2:4] == (True, False)
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"call reset\(\) first"):
        env.step(Action.TURN_LEFT)


def test_the_picture_is_what_the_robot_sees(env):
    observation, _ = env.reset(seed=1)
    np.testing.assert_array_equal(env.render(), observation["rgb"])


def test_a_seed_of_the_environment_is_that_of_its_first_reset():
    poses = []
    for given, at_reset in ((3, None), (3, None), (None, 3), (4, 3), (4, None)):
        env = gymnasium.make(_ID, **_OPTIONS, **({} if given is None else {"seed": given}))
        # The second episode goes on with the sequence.
        poses.append([env.reset(seed=at_reset)[1]["pose"], env.reset()[1]["pose"]])
        env.close()
    other = anm_mj.load_environment("home", seed=3, image_px=32, num_steps=6)
    other.reset()
    pose = other.task.true.pose
    other.close()
    np.testing.assert_array_equal(poses[0][0], [pose.x_m, pose.y_m, pose.yaw_rad])
    for same in poses[1:4]:
        np.testing.assert_array_equal(same, poses[0])
    assert (np.array(poses[4]) != poses[0]).any()
    assert (poses[0][0] != poses[0][1]).any()


@pytest.mark.parametrize("seed", [-1, 1.5, True, "3"])
def test_a_seed_that_is_none_is_refused(seed):
    # Called past the tests' own check of types, which users have not.
    with pytest.raises(TaskError, match="give a whole number from 0 up"):
        inspect.unwrap(load_environment)("home", seed=seed)


def test_collision_in_info():
    env = gymnasium.make(_ID, **{**_OPTIONS, "num_steps": 400})
    _, info = env.reset(seed=2)
    assert not info["collided"]
    for _ in range(400):
        *_, info = env.step(Action.MOVE_FORWARD)
        if info["collided"]:
            break
    env.close()
    assert info["collided"]


@pytest.mark.parametrize("actions", ["discrete", "velocity"])
def test_a_robot_that_can_drive_no_more_ends_the_episode(tmp_path, actions):
    wheel = (
        '<body pos="0 {y} 0"><joint name="{side}_wheel" axis="0 1 0"/>'
        '<geom type="cylinder" size="0.05 0.015" zaxis="0 1 0" mass="0.2"/></body>'
    )
    robot = tmp_path / "tall.xml"
    robot.write_text(
        '<mujoco><worldbody><body name="base" pos="0 0 0.05"><geom type="cylinder" size="0.1 0.05" pos="0 0 0.08"/>'
        '<geom type="box" size="0.05 0.05 0.05" pos="0 0 1.2" mass="40"/><geom size="0.02" pos="-0.03 0 -0.03"/>'
        '<camera name="camera" pos="0.11 0 0.3" xyaxes="0 -1 0 0 0 1" fovy="70"/>'
        f"{wheel.format(y=0.06, side='left')}{wheel.format(y=-0.06, side='right')}</body></worldbody><actuator>"
        '<velocity joint="left_wheel" kv="1"/><velocity joint="right_wheel" kv="1"/></actuator></mujoco>'
    )
    options = {
        **_OPTIONS,
        "num_steps": 60,
        "robot": str(robot),
        "drive": "physics",
        "actions": actions,
        "reward": "area",
    }
    env = gymnasium.make(_ID, **options)
    _, info = env.reset(seed=0)
    assert info["fault"] == ""
    terminated = truncated = False
    while not (terminated or truncated):
        action = Action.MOVE_FORWARD if actions == "discrete" else np.array([1.0, 0.0], np.float32)
        *_, terminated, truncated, info = env.step(action)
    assert terminated
    assert info["fault"] == "TOPPLED"
    # The next episode begins upright.
    _, info = env.reset(seed=1)
    assert info["fault"] == ""
    env.close()


def test_spaces_without_a_simulator():
    program = f"""
import sys, gymnasium, anm_mj.environments
env = gymnasium.make({_ID!r}, scene="home")
print(env.observation_space["rgb"].shape, env.action_space.n, *({{"mujoco", "torch"}} & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=_ROOT)
    assert done.stdout.strip() == "(128, 128, 3) 4"


@pytest.mark.parametrize("copy_of", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copies_are_made_before_the_simulator(env, copy_of):
    fresh = copy_of(ExploreEnv("home", image_px=32))
    wanted = env.reset(seed=5)[1]["pose"]
    np.testing.assert_array_equal(fresh.reset(seed=5)[1]["pose"], wanted)
    with pytest.raises(TaskError, match="after its first reset"):
        copy_of(fresh)
    fresh.close()
    copy_of(fresh)


@pytest.mark.parametrize(("mode", "vector_kwargs"), [("sync", {}), ("async", {"context": "spawn"})])
def test_vector_environments(mode, vector_kwargs):
    actions = np.array([[1, 2], [2, 2], [1, 3]])
    vector = gymnasium.make_vec(_ID, num_envs=2, vectorization_mode=mode, vector_kwargs=vector_kwargs, **_OPTIONS)
    together = [vector.reset(seed=[7, 8])[0], *(vector.step(pair)[0] for pair in actions)]
    vector.close()
    single = gymnasium.make(_ID, **_OPTIONS)
    for which, seed in enumerate((7, 8)):
        alone = [single.reset(seed=seed)[0], *(single.step(pair[which])[0] for pair in actions)]
        for observation, batch in zip(alone, together, strict=True):
            for name in ("depth", "pose"):
                np.testing.assert_allclose(batch[name][which], observation[name], atol=1e-4)
            rgb = observation["rgb"].astype(int)
            assert np.abs(batch["rgb"][which] - rgb).max() <= 2
    single.close()


def test_forked_process(monkeypatch):
    env = gymnasium.make(_ID, **_OPTIONS)
    monkeypatch.setattr(gl, "_gl_process", os.getpid() + 1)
    with pytest.raises(RenderError, match='method "spawn"'):
        env.reset()


def test_an_environment_belongs_to_its_thread(env):
    env.reset(seed=5)
    with ThreadPoolExecutor(1) as other, pytest.raises(RenderError, match="in one thread"):
        other.submit(env.step, 2).result()
    env.step(2)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda env: env.reset(options={"begin": 1}), 'reset has no option "begin"; it has start'),
        (lambda env: env.reset(options={"start": "here"}), "is no pose; give three numbers"),
    ],
)
def test_invalid_reset(env, call, message):
    with pytest.raises(TaskError, match=message):
        call(env.unwrapped)


def test_an_unknown_render_mode_is_refused():
    with pytest.raises(TaskError, match='no render mode "human"'):
        ExploreEnv("home", render_mode="human")


def test_the_example_runs():
    program = [sys.executable, "scripts/gym_random.py", "home", "--num-envs", "1", "--num-steps", "5"]
    done = subprocess.run(program, capture_output=True, text=True, check=True, cwd=_ROOT)
    assert "steps/s" in done.stdout


def test_people_walk_in_an_environment_and_nearness_costs():
    env = KeepDistance(gymnasium.make(_ID, **_OPTIONS, people=2), within_m=100.0, weight=1.0)
    _, info = env.reset(seed=3)
    start_m, steps = info["people_m"], [env.step(2) for _ in range(3)]
    env.reset(seed=3)
    again = [env.step(2) for _ in range(3)]
    env.close()

    assert 0.0 < start_m < 20.0
    assert all(info["cost"] == 1.0 - info["people_m"] / 100.0 for *_, info in steps)
    assert [step[1] for step in steps] == [step[1] for step in again]
    with pytest.raises(TaskError, match="within_m is 0; give a distance above 0 m"):
        KeepDistance(env, within_m=0.0, weight=1.0)
