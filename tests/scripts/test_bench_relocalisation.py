"""The searches of the benchmark: where it puts a robot, and what it calls found."""

import math

import numpy as np
import pytest

from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.scene.folder import load_scene
from anm_mj.sim.make_robot import make_robot
from anm_mj.types import Action
from scripts import bench_relocalisation as bench
from tests.mapping.conftest import tiny_config
from tests.scene.small import make_small_scene

__all__ = ["tiny_config"]


@pytest.fixture(scope="module")
def mapped(tmp_path_factory, tiny_config):
    """A robot in a small scene that its map has seen from one place."""
    folder = tmp_path_factory.mktemp("scenes") / "small"
    make_small_scene(folder)
    scene, neural_map = load_scene(folder), NeuralMap(tiny_config, seed=0, device="cpu")
    with make_robot(scene, pose="slam", image_px=64, knows_start=False) as robot:
        for _ in range(36):
            seen = robot.observe()
            true = robot.true_view()
            neural_map.integrate(bench.replace(seen, T_world_camera=true.T_world_camera, pose=true.pose))
            robot.act(Action.TURN_LEFT)
        yield neural_map, robot, scene


@pytest.mark.slow
def test_a_robot_that_starts_somewhere_is_found(mapped):
    trial = bench.starts_somewhere(*mapped, np.random.default_rng(0))
    assert trial.steps is not None
    assert trial.steps >= 3
    assert trial.error_m < 0.1
    assert not trial.is_wrong
    # Its odometry begins at zero.
    assert mapped[1].pose != mapped[1].odometry


def test_a_believed_place_that_is_wrong_is_counted(mapped):
    _, robot, _ = mapped

    class Estimate:
        usable, relocalised = True, True
        observation = robot.observe()

    trial = bench.searched(robot, iter([Estimate()]))
    assert trial.is_wrong
    assert trial.steps == 0
    right, lost = bench.Trial(4, 0.01, 0.0, False), bench.Trial(None, math.nan, math.nan, False)
    assert bench.summary([right, trial, lost]).startswith("2 of 3 | 1 | 2, 4 | ")
