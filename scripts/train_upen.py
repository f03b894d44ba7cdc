"""Train the occupancy predictors of the upen policy on floor plans of the project's own generator.

    python scripts/train_upen.py            # a quarter of an hour on one core; writes what the policy loads

A sample is what a scanner with a 90 degree field of view has seen along a short walk through a generated apartment or
office, cropped about the walker, and what is really there. Each network learns from a random 70 % of the samples, as
published (Georgakis et al., ICRA 2022).
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import torch
from scipy import ndimage
from torch import Tensor

from anm_mj.cli.command_line import run_script
from anm_mj.frames import cell_to_world, world_to_cell
from anm_mj.planning.policies.upen.occupancy_net import CLASSES, VOID, WIDTHS, layer_shapes, predict
from anm_mj.planning.policies.upen.upen_policy import WEIGHTS, egocentric_crop
from anm_mj.scene.generation.building_map import generated_map
from anm_mj.types import FREE, OCCUPIED, TURN_STEP_RAD, UNKNOWN, Pose2, TopDownMap

NUM_NETWORKS = 4
SHARE = 0.7
ROBOT_CELLS = 4
"""Walkers keep this far from obstacles [cells of 5 cm]."""
WALL_CELLS = 4
"""What lies deeper than this inside obstacles is void: nobody will ever see it [cells of 5 cm]."""
WALK_STEPS = 60
CROPS_PER_WALK = 6
RANGE_M = 10.0
NUM_BEAMS = 181


def main(
    buildings: int = 250,
    walks: int = 5,
    epochs: int = 4,
    batch: int = 32,
    learning_rate: float = 1e-3,
    seed: int = 0,
    out: Path = WEIGHTS,
) -> None:
    """Make the samples, train the networks, write their weights and say how good they are on unseen buildings.

    Args:
        buildings: Generated buildings of 2 to 12 rooms.
        walks: Walks through each of them.
        epochs: Times that every network sees its samples.
        batch: Samples per step.
        learning_rate: Adam's, falling to zero along a half cosine.
        seed: Of buildings, walks and networks.
        out: File to write.
    """
    seen, truth = samples(range(buildings), walks, seed)
    held_seen, held_truth = samples(range(buildings, buildings + max(buildings // 10, 1)), walks, seed)
    print(f"{len(seen)} samples from {buildings} buildings")
    ensemble = []
    for k in range(NUM_NETWORKS):
        rng = np.random.default_rng([seed, 1, k])
        mine = rng.permutation(len(seen))[: max(round(SHARE * len(seen)), 1)]
        weights = train(seen[mine], truth[mine], epochs, batch, learning_rate, seed=k)
        ensemble.append(weights)
        print(f"network {k}: {accuracy(weights, held_seen, held_truth):.3f} of the unseen cells right")
    constant = max(float(((held_truth == c) & (held_seen == VOID)).sum()) for c in range(len(CLASSES)))
    print(f"always the commonest class: {constant / max(float((held_seen == VOID).sum()), 1.0):.3f}")
    arrays = {name: np.stack([weights[name] for weights in ensemble]).astype(np.float16) for name in ensemble[0]}
    np.savez_compressed(out, allow_pickle=False, **arrays)
    print(f"wrote {out} ({out.stat().st_size / 1e6:.2f} MB)")


def samples(seeds: range, walks: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """What walkers have seen and what is there, (n, 64, 64) each, by class."""
    seen, truth = [], []
    for building in seeds:
        rng = np.random.default_rng([seed, 2, building])
        kind = ("apartment", "office")[int(rng.integers(2))]
        plan = generated_map(int(rng.integers(2, 13)), building, kind)
        deep = np.asarray(ndimage.distance_transform_edt(plan.obstacles)) > WALL_CELLS
        state = np.where(plan.obstacles, np.int8(OCCUPIED), np.int8(FREE))
        state[deep] = UNKNOWN
        whole = _map(state, plan.origin_xy_m)
        clear = np.asarray(ndimage.distance_transform_edt(~plan.obstacles)) > ROBOT_CELLS
        for _ in range(walks):
            walk(whole, clear, rng, seen, truth)
    return np.array(seen), np.array(truth)


def walk(whole: TopDownMap, clear: np.ndarray, rng: np.random.Generator, seen: list, truth: list) -> None:
    """Walk straight until something is in the way, turn, and so on; crop what is known now and then."""
    known = np.full(whole.state.shape, UNKNOWN, np.int8)
    cells = np.argwhere(clear)
    xy = cell_to_world(cells[rng.integers(len(cells))][None], whole.origin_xy_m, whole.resolution_m)[0]
    yaw, turn = rng.uniform(-math.pi, math.pi), 1.0
    keep = set(rng.choice(WALK_STEPS, CROPS_PER_WALK, replace=False).tolist())
    for step in range(WALK_STEPS):
        scan(whole, known, xy, yaw)
        if step in keep:
            pose = Pose2(float(xy[0]), float(xy[1]), yaw)
            seen.append(egocentric_crop(_map(known, whole.origin_xy_m), pose))
            truth.append(egocentric_crop(whole, pose))
        ahead = xy + 0.2 * np.array([math.cos(yaw), math.sin(yaw)])
        row, col = world_to_cell(ahead[None], whole.origin_xy_m, whole.resolution_m)[0]
        if clear[row, col] and rng.random() > 0.1:
            xy = ahead
        else:
            turn = turn if rng.random() > 0.2 else -turn
            yaw += 3 * turn * TURN_STEP_RAD


def scan(whole: TopDownMap, known: np.ndarray, xy: np.ndarray, yaw: float) -> None:
    """Copy what a beam reaches from the truth into what is known."""
    angles = yaw + np.linspace(-math.pi / 4, math.pi / 4, NUM_BEAMS)
    along = np.arange(0.0, RANGE_M, whole.resolution_m / 2)
    points = xy + along[None, :, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)[:, None]
    cells = world_to_cell(points.reshape(-1, 2), whole.origin_xy_m, whole.resolution_m)
    cells = np.clip(cells, 0, np.array(whole.state.shape) - 1).reshape(NUM_BEAMS, len(along), 2)
    solid = whole.state[cells[..., 0], cells[..., 1]] != FREE
    reached = np.cumsum(solid, axis=1) - solid == 0
    row, col = cells[reached].T
    known[row, col] = np.where(whole.state[row, col] == FREE, FREE, OCCUPIED)


def train(seen: np.ndarray, truth: np.ndarray, epochs: int, batch: int, learning_rate: float, seed: int) -> dict:
    """One network's weights after Adam on the cross-entropy of all cells."""
    torch.manual_seed(seed)
    weights: dict[str, Tensor] = {}
    for name, shape in layer_shapes():
        weights[name] = (torch.randn(shape) * math.sqrt(2.0 / math.prod(shape[1:]))).requires_grad_()
        weights[f"{name}.bias"] = torch.zeros(shape[0], requires_grad=True)
    optimizer = torch.optim.Adam(weights.values(), lr=learning_rate)
    steps = epochs * math.ceil(len(seen) / batch)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for epoch in range(epochs):
        order, total = torch.randperm(len(seen)), 0.0
        for rows in order.split(batch):
            target = torch.from_numpy(truth[rows.numpy()].astype(np.int64))
            loss = torch.nn.functional.cross_entropy(logits(weights, seen[rows.numpy()]), target)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            total += float(loss.detach()) * len(rows)
        print(f"  epoch {epoch + 1}: cross-entropy {total / len(seen):.4f}")
    return {name: values.detach().numpy() for name, values in weights.items()}


def logits(weights: dict[str, Tensor], classes: np.ndarray) -> Tensor:
    """What ``occupancy_net.predict`` computes, before the softmax, for a batch and with gradients."""

    def twice(name: str, hidden: Tensor) -> Tensor:
        for part in ("0", "1"):
            hidden = torch.relu(convolve(f"{name}.{part}", hidden))
        return hidden

    def convolve(name: str, image: Tensor) -> Tensor:
        return torch.nn.functional.conv2d(image, weights[name], weights[f"{name}.bias"], padding=1)

    known = torch.from_numpy(classes.astype(np.int64))
    hidden = torch.nn.functional.one_hot(known, len(CLASSES)).permute(0, 3, 1, 2).float()
    kept: list[Tensor] = []
    for stage in range(len(WIDTHS)):
        if stage:
            kept.append(hidden)
            hidden = torch.nn.functional.max_pool2d(hidden, 2)
        hidden = twice(f"down{stage}", hidden)
    for stage in reversed(range(len(WIDTHS) - 1)):
        finer = hidden.repeat_interleave(2, dim=2).repeat_interleave(2, dim=3)
        hidden = twice(f"up{stage}", torch.cat((finer, kept[stage]), dim=1))
    return convolve("out", hidden)


def accuracy(weights: dict[str, np.ndarray], seen: np.ndarray, truth: np.ndarray) -> float:
    """Share of the cells that were not seen whose class is guessed right."""
    right = count = 0
    for known, real in zip(seen, truth, strict=True):
        unseen = known == VOID
        right += int((predict(weights, known).argmax(axis=0) == real)[unseen].sum())
        count += int(unseen.sum())
    return right / max(count, 1)


def _map(state: np.ndarray, origin_xy_m: np.ndarray) -> TopDownMap:
    return TopDownMap(np.zeros(state.shape, np.float32), state, 0.05, origin_xy_m)


if __name__ == "__main__":
    run_script(main)
