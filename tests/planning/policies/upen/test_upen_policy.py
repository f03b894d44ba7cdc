import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from anm_mj.errors import PlanError
from anm_mj.frames import world_to_cell
from anm_mj.planning.paths import clearance_at
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.guarded_policy import plan_fault
from anm_mj.planning.policies.upen.occupancy_net import (
    CELL_M,
    CROP_CELLS,
    FREE_CLASS,
    OCCUPIED_CLASS,
    VOID,
    layer_shapes,
    load_ensemble,
    predict,
)
from anm_mj.planning.policies.upen.rrt import grow_tree
from anm_mj.planning.policies.upen.upen_policy import WEIGHTS, Upen, UpenConfig, egocentric_crop, value_along
from anm_mj.types import ARRIVED_M, FREE, OCCUPIED, UNKNOWN, Footprint, Pose2, TopDownMap
from scripts.train_upen import logits
from tests.planning.policies.frontier.test_frontier_policy import hall, look
from tests.planning.worlds import BoxWorld

FOOTPRINT = Footprint(0.18, 0.05, 1.35)


@pytest.fixture
def weights():
    rng = np.random.default_rng(0)
    made = {name: rng.normal(0, 0.1, shape).astype(np.float32) for name, shape in layer_shapes()}
    return made | {f"{name}.bias": rng.normal(0, 0.1, shape[0]).astype(np.float32) for name, shape in layer_shapes()}


def test_numpy_and_torch_evaluate_the_same_network(weights):
    classes = np.random.default_rng(1).integers(0, 3, (CROP_CELLS, CROP_CELLS)).astype(np.int8)

    ours = predict(weights, classes)

    theirs = torch.softmax(logits({n: torch.from_numpy(w) for n, w in weights.items()}, classes[None]), dim=1)[0]
    np.testing.assert_allclose(ours, theirs.numpy(), atol=2e-6)


def test_weights_that_are_missing_or_of_another_net_are_said_so(tmp_path):
    with pytest.raises(PlanError, match=r"make them with scripts/train_upen\.py"):
        load_ensemble(tmp_path / "none.npz")
    np.savez(tmp_path / "other.npz", out=np.zeros((1, 2)))
    with pytest.raises(PlanError, match=r"out is of type float64 and shape \(1, 2\)"):
        load_ensemble(tmp_path / "other.npz")


def test_the_weights_that_ship_are_four_networks_that_differ_in_what_they_guess():
    nets = load_ensemble(WEIGHTS)
    crop = np.full((CROP_CELLS, CROP_CELLS), VOID, np.int8)
    crop[28:36, 28:60] = FREE_CLASS

    guesses = np.stack([predict(net, crop)[OCCUPIED_CLASS] for net in nets])

    assert len(nets) == 4
    assert guesses.var(axis=0).max() > 1e-3
    assert WEIGHTS.stat().st_size < 10e6


def test_what_was_seen_is_guessed_as_it_was_seen():
    crop = np.full((CROP_CELLS, CROP_CELLS), VOID, np.int8)
    crop[24:40, 28:60] = FREE_CLASS
    crop[23, 28:60] = crop[40, 28:60] = OCCUPIED_CLASS

    guess = np.mean([predict(net, crop) for net in load_ensemble(WEIGHTS)], axis=0).argmax(axis=0)

    assert (guess == crop)[crop == FREE_CLASS].mean() > 0.95
    assert (guess == crop)[crop == OCCUPIED_CLASS].mean() > 0.8


@pytest.mark.slow
def test_training_writes_what_the_policy_loads(tmp_path):
    # In a process of its own: torch's optimisers load an LLVM that crashes beside a software renderer's.
    script = Path(__file__).resolve().parents[4] / "scripts" / "train_upen.py"
    sizes = ("--buildings", "1", "--walks", "1", "--epochs", "1", "--out", str(tmp_path / "weights.npz"))
    done = subprocess.run([sys.executable, str(script), *sizes], capture_output=True, text=True, check=True)

    assert len(load_ensemble(tmp_path / "weights.npz")) == 4
    assert "of the unseen cells right" in done.stdout


def test_a_crop_turns_with_the_robot():
    state = np.full((400, 400), UNKNOWN, np.int8)
    state[200:240, 190:210] = FREE
    state[240:244, 190:210] = OCCUPIED
    world = TopDownMap(np.zeros(state.shape, np.float32), state, 0.05, np.array([-10.0, -10.0]))

    crop = egocentric_crop(world, Pose2(0.0, 0.0, math.pi / 2))

    middle = CROP_CELLS // 2
    assert crop[middle, middle + 2] == FREE_CLASS
    assert crop[middle, middle + round(2.1 / CELL_M)] == OCCUPIED_CLASS
    assert crop[middle, middle - 4] == VOID


def test_values_of_a_crop_are_found_again_in_the_world():
    values = np.zeros((CROP_CELLS, CROP_CELLS), np.float32)
    values[CROP_CELLS // 2, CROP_CELLS // 2 + 8] = 1.0
    pose = Pose2(3.0, -1.0, math.pi / 2)

    xy = np.array([[3.0 - 0.06, -1.0 + 8.5 * CELL_M], [3.0, -1.0], [90.0, 0.0]])

    np.testing.assert_array_equal(value_along(values, xy, pose), [1.0, 0.0, 0.0])


def test_a_tree_stays_on_passable_ground_and_counts_its_hops():
    passable = np.zeros((80, 80), bool)
    passable[30:50, 5:75] = True
    tree = grow_tree(
        passable,
        np.zeros(2),
        0.05,
        np.array([2.0, 2.0]),
        half_width_m=2.0,
        num_samples=400,
        hop_m=0.25,
        rng=np.random.default_rng(0),
    )

    assert len(tree.xy_m) > 20
    assert ((tree.xy_m[:, 1] >= 1.5) & (tree.xy_m[:, 1] <= 2.5)).all()
    farthest = int(np.argmax(tree.num_hops))
    path = tree.path_to(farthest)
    assert len(path) == tree.num_hops[farthest] + 1
    np.testing.assert_allclose(np.linalg.norm(np.diff(path, axis=0), axis=1), 0.25)


def test_the_path_taken_is_clear_and_the_same_for_the_same_seed():
    plans = []
    for _ in range(2):
        policy = Upen(PolicyContext(FOOTPRINT, UpenConfig(), seed=5))
        for k in range(4):
            policy.observe(look(Pose2(0.0, 0.0, math.radians(90 * k))))
        plans.append(policy.plan(BoxWorld((1.0, 1.0), []), look(Pose2(0.0, 0.0, 0.0))))

    np.testing.assert_array_equal(plans[0].path_xy_m, plans[1].path_xy_m)
    assert plans[0].topdown is not None
    assert clearance_at(plans[0].topdown, plans[0].path_xy_m).min() > FOOTPRINT.radius_m
    assert plans[0].valid_steps == 38


def test_paths_of_the_shortest_hops_lead_away():
    least_m = 0.1
    assert least_m > ARRIVED_M
    with pytest.raises(PlanError, match=r"hop_m.*at least 0\.1 "):
        UpenConfig(hop_m=ARRIVED_M)
    pose = Pose2(0.0, 0.0, 0.0)
    # Which paths are as long as their hops but for rounding is chance.
    for seed in range(12):
        policy = Upen(PolicyContext(FOOTPRINT, UpenConfig(hop_m=least_m, num_hops=1, num_samples=300), seed=seed))
        policy.observe(look(pose))
        assert plan_fault(policy.plan(BoxWorld((1.0, 1.0), []), look(pose)), pose) is None


def test_beside_an_obstacle_the_tree_needs_the_clearance_that_the_robot_has():
    policy = Upen(PolicyContext(FOOTPRINT, UpenConfig()))
    topdown = hall(occupied=[(2.2, 1.0, 2.6, 2.0)])
    pose = Pose2(2.0, 1.5, 0.0)
    here_m = clearance_at(topdown, pose.xy_m[None])[0]

    tree = policy._tree(topdown, pose, np.zeros((CROP_CELLS, CROP_CELLS), np.float32))

    assert here_m < FOOTPRINT.radius_m + 0.04
    assert len(tree.xy_m) > 20
    assert clearance_at(topdown, tree.xy_m).min() >= here_m - 0.036


def test_where_it_stands_in_an_obstacle_the_tree_leads_away_and_into_no_other():
    policy = Upen(PolicyContext(FOOTPRINT, UpenConfig()))
    # The cell that it stands in is marked, and a thing beside it.
    topdown = hall(occupied=[(2.0, 1.5, 2.05, 1.55), (2.15, 1.3, 2.3, 1.8)])
    pose = Pose2(2.025, 1.525, 0.0)

    tree = policy._tree(topdown, pose, np.zeros((CROP_CELLS, CROP_CELLS), np.float32))

    cells = world_to_cell(tree.xy_m[1:], topdown.origin_xy_m, topdown.resolution_m)
    assert len(cells) > 20
    assert (topdown.state[cells[:, 0], cells[:, 1]] != OCCUPIED).all()
    assert tree.xy_m[:, 0].max() > 4.0
