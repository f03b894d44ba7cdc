"""A run that goes on from a stored state is the undisturbed one, for every policy, drive and sensor.

Whatever state anybody adds to a policy, a sensor, a robot or the map, it is in here: the run that goes on must do the
same steps, and must end in a state that is the same in every attribute.
"""

import time
from dataclasses import replace

import pytest

from anm_mj.anticipating_robot import AnticipatingRobot
from anm_mj.checkpoint.decode import restore
from anm_mj.checkpoint.encode import encode
from anm_mj.config import make_config
from anm_mj.explore import explore
from anm_mj.loop_state import LoopState
from anm_mj.planning.policies.registry import policies
from anm_mj.run_parts import make_parts
from anm_mj.sim.sensors.sensor_config import SENSORS
from tests.fake_robot import ListRecorder
from tests.scene.small import make_small_scene

SLOW = ("anm", "oracle", "frontier-full", "upen", "random", "azure-kinect")
"""They take seconds, or share their code with another one."""
STOP, END = 11, 20
TINY = (
    "image_px=48",
    "mapping.schedule.first_iterations=4",
    "mapping.schedule.iterations=1",
    "mapping.schedule.num_rays=64",
    "mapping.schedule.replay_bytes=1000000",
    "checkpoint.every_steps=0",
)


def slow_ones(names):
    return [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in names]


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes") / "small"
    make_small_scene(folder)
    return str(folder)


@pytest.fixture(autouse=True)
def no_time_passes(monkeypatch):
    """Times are the one thing that may differ."""
    monkeypatch.setattr(time, "perf_counter", lambda: 0.0)


def configuration(scene, policy="gvg", settings=(), **options):
    mapping = policies()[policy].mapping_preset
    config = make_config(
        mapping or "quick", [*TINY, *settings], scene=scene, policy=policy, seed=5, device="cpu", **options
    )
    # A short rotation at the start, so that a few steps reach what policies remember.
    if hasattr(config.policy_settings, "bootstrap_turns"):
        config = replace(config, policy_settings=replace(config.policy_settings, bootstrap_turns=4))
    return config


def go_on(parts, recorder, state, num_steps):
    followed = {"num_steps": num_steps, "observers": (AnticipatingRobot(parts.robot, state), recorder)}
    return explore(parts.robot, parts.mapper, parts.policy, **followed, state=state)


def roots(parts, state):
    return {"loop": state, "robot": parts.robot, "mapper": parts.mapper, "policy": parts.policy}


def now(parts, state):
    """The state, of which later steps change nothing."""
    graph = encode(roots(parts, state), parts.known)
    graph.arrays = [array.copy() for array in graph.arrays]
    return graph


def ends(config):
    """Steps and final state of an undisturbed run, and of one that goes on in newly made parts."""
    found = []
    with make_parts(config) as parts:
        recorder, state = ListRecorder(), LoopState()
        go_on(parts, recorder, state, STOP)
        stored = now(parts, state)
        before = len(recorder.steps)
        go_on(parts, recorder, state, END)
        found.append((recorder.steps[before:], now(parts, state)))
    with make_parts(config) as parts:
        recorder, state = ListRecorder(), LoopState()
        # As a run does before it goes on: the observable surface is looked for from the start.
        parts.robot.observe()
        restore(stored.nodes, stored.arrays, roots(parts, state), parts.known)
        go_on(parts, recorder, state, END)
        found.append((recorder.steps, now(parts, state)))
    return found


def assert_same(found):
    (steps, whole), (steps_again, again) = found
    assert len(steps) > 0
    assert steps_again == steps
    assert again.nodes == whole.nodes
    assert [array.tobytes() for array in again.arrays] == [array.tobytes() for array in whole.arrays]


@pytest.mark.parametrize("policy", slow_ones(policies()))
def test_every_policy_goes_on(scene, policy):
    settings = ("policy.rounds=200",) if policies()[policy].needs_truth else ()
    assert_same(ends(configuration(scene, policy, settings)))


@pytest.mark.parametrize("sensor", slow_ones(name for name in SENSORS if name != "exact"))
def test_every_sensor_goes_on_with_odometry_and_physics(scene, sensor):
    config = configuration(
        scene, "random", ("model.wheel_noise=0.01",), sensor=sensor, drive="physics", pose="odometry"
    )
    assert_same(ends(config))


@pytest.mark.parametrize("engine", ["torch"])
def test_every_engine_goes_on(scene, engine):
    assert_same(ends(configuration(scene, "random", (f"mapping.engine={engine}",))))


def test_the_comparison_would_find_a_forgotten_attribute(scene, monkeypatch):
    """A policy whose count is left out does not come back with it."""
    from anm_mj.planning.policies.random_walk import RandomWalk

    monkeypatch.setattr(RandomWalk, "REBUILT", ("_rng",), raising=False)
    (steps, _), (steps_again, _) = ends(configuration(scene, "random"))
    assert steps != steps_again
