"""Judges the planner under depth noise that the program ships no preset of: models drawn at random, runs paired.

    python scripts/judge_noise.py --scenes rmf_office flat --models 5 --starts 3 --steps 500

Each run with noise is held against the run with exact depth from the same start. What counts is the path: the share of
the observable surface that exact depth at the poses of the run covers, whatever the camera made of it. Below the table
stand the mean difference with its standard error (over all scenes that of their means), the turns and changes of target
relative to the exact runs, and the voxels that the map calls occupied although no surface is near.

A model is made of effects of real depth cameras, each of which a draw has with probability ``HAS`` and a uniform size
between two bounds (:func:`draw_noise`). The camera says a range of ``STATED_M``, whatever it truly sees.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Float32
from scipy import ndimage
from scipy.spatial import KDTree

from anm_mj.bench.statistics import scene_means
from anm_mj.cli.command_line import run_script
from anm_mj.config import make_config
from anm_mj.evaluation.completion_curve import CHECKPOINT_STEPS, CompletionCurve
from anm_mj.events import Decided, Stepped
from anm_mj.explore import explore
from anm_mj.ground_truth.cache import cached_ground_truth
from anm_mj.ground_truth.ground_truth import GroundTruth
from anm_mj.ground_truth.pixel_rays import CameraExtrinsics
from anm_mj.ground_truth.reduced_depth import reduce_depth
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.registry import make_policy
from anm_mj.scene.folder import Scene, load_scene
from anm_mj.sim.make_robot import make_robot
from anm_mj.sim.sensors.camera_sensor import depth_edges
from anm_mj.types import (
    OCCUPIED,
    Action,
    ActionResult,
    Footprint,
    MotionResult,
    Observation,
    OccupancyGrid,
    Twist,
)

if TYPE_CHECKING:
    from anm_mj.sim.sim_robot import SimRobot

HAS = 0.6
"""Probability that a model has an effect."""
STATED_M = 10.0
"""What the camera's maker says of its range [m]."""
PHANTOM_M = 0.2
"""An occupied voxel farther than this from all true surface is a phantom [m]; noise shifts real ones by less."""
BODY_M = 0.1, 1.2
"""Heights of the voxels that are counted [m]."""


@dataclass(frozen=True)
class Noise:
    """One camera's errors; all that is 0 is absent."""

    axial_per_m: float = 0.0
    """Standard deviation of depth is this times its square [1/m], independent from pixel to pixel."""
    jitter_px: float = 0.0
    """Standard deviation of the place in the image that a depth comes from [px]."""
    lost: float = 0.0
    """Share of pixels lost anywhere."""
    edge_lost: float = 0.0
    """Share of pixels lost beside steps in depth."""
    flying: float = 0.0
    """Share of pixels beside steps in depth that lie between both surfaces."""
    speckle: float = 0.0
    """Share of pixels with any depth up to the range."""
    step_per_m: float = 0.0
    """Inverse depth comes in multiples of this [1/m]."""
    bias: float = 0.0
    """Depth is too long by this share, for the camera's life."""
    drift_per_m: float = 0.0
    """As ``axial_per_m``, of errors that pixels within 12 px share and that last some ten frames [1/m]."""
    range_m: float = STATED_M
    """Nothing farther is measured [m]."""


def draw_noise(seed: int) -> Noise:
    """A model of the family; the bounds are those of stereo and time-of-flight cameras indoors."""
    rng = np.random.default_rng([seed, 41])

    def size(low: float, high: float) -> float:
        drawn, has = float(rng.uniform(low, high)), rng.random() < HAS
        return drawn if has else 0.0

    return Noise(
        axial_per_m=size(0.0005, 0.004),
        jitter_px=size(0.2, 0.8),
        lost=size(0.005, 0.05),
        edge_lost=size(0.2, 0.8),
        flying=size(0.1, 0.5),
        speckle=size(0.0001, 0.002),
        step_per_m=size(0.0005, 0.005),
        bias=size(-0.015, 0.015),
        drift_per_m=size(0.0003, 0.002),
        range_m=size(4.0, 9.0) or STATED_M,
    )


class NoisyCamera:
    """A simulated robot whose depth has the errors of a model; it keeps the exact views beside them."""

    def __init__(self, robot: SimRobot, noise: Noise | None, seed: int) -> None:
        """Wrap a robot with an exact camera; without a model it stays exact."""
        self._robot, self._noise = robot, noise
        self._rng = np.random.default_rng([seed, 42])
        self._drift: Float32[np.ndarray, "h w"] | None = None
        self.exact: list[Observation] = []
        """The views so far, without errors."""

    @property
    def footprint(self) -> Footprint:
        """Of the robot."""
        return self._robot.footprint

    def act(self, action: Action) -> ActionResult:
        """Passed on."""
        return self._robot.act(action)

    def drive(self, twist: Twist, duration_s: float) -> MotionResult:
        """Passed on."""
        return self._robot.drive(twist, duration_s)

    def observe(self) -> Observation:
        """The view from the present pose, with errors."""
        seen = self._robot.observe()
        self.exact.append(seen)
        if self._noise is None:
            return seen
        return replace(seen, depth_m=self._measure(seen.depth_m, self._noise), range_m=STATED_M)

    def _measure(self, exact_m: Float32[np.ndarray, "h w"], noise: Noise) -> Float32[np.ndarray, "h w"]:
        rng, shape = self._rng, exact_m.shape
        true_m = np.where(np.isfinite(exact_m), exact_m, np.float32(np.inf))
        if noise.jitter_px:
            at = np.indices(shape) + np.rint(noise.jitter_px * rng.standard_normal((2, *shape))).astype(int)
            true_m = true_m[np.clip(at[0], 0, shape[0] - 1), np.clip(at[1], 0, shape[1] - 1)]
        inverse = (1.0 / true_m).astype(np.float32)
        edge: Bool[np.ndarray, "h w"] = depth_edges(inverse, 0.05)
        inverse += np.float32(noise.axial_per_m) * rng.standard_normal(shape, np.float32)
        inverse += np.float32(noise.drift_per_m) * self._next_drift(shape)
        if noise.step_per_m:
            inverse = np.rint(inverse / noise.step_per_m) * noise.step_per_m
        with np.errstate(divide="ignore"):
            depth_m = (1.0 + noise.bias) / inverse
        flies = edge & (rng.random(shape) < noise.flying)
        beside_m = np.roll(true_m, 1, axis=1)
        between_m = beside_m + rng.random(shape) * (np.where(np.isfinite(true_m), true_m, beside_m) - beside_m)
        depth_m[flies] = between_m[flies]
        lost = (edge & (rng.random(shape) < noise.edge_lost)) | (rng.random(shape) < noise.lost)
        lost |= ~np.isfinite(true_m) | ~(depth_m > 0.0) | (depth_m > noise.range_m)
        depth_m[lost] = np.nan
        speckle = rng.random(shape) < noise.speckle
        depth_m[speckle] = rng.uniform(0.3, noise.range_m, int(speckle.sum()))
        return depth_m.astype(np.float32)

    def _next_drift(self, shape: tuple[int, ...]) -> Float32[np.ndarray, "h w"]:
        """Errors of unit variance that neighbours in the image and in time share."""
        small = tuple(math.ceil(n / 12) + 1 for n in shape)
        fresh = np.asarray(ndimage.zoom(self._rng.standard_normal(small), 12, order=1), np.float32)[
            : shape[0], : shape[1]
        ]
        self._drift = fresh if self._drift is None else 0.9 * self._drift + math.sqrt(1.0 - 0.9**2) * fresh
        return self._drift


@dataclass
class Outcome:
    """What a run came to."""

    scene: str
    start: int
    model: int
    """Number of the model; -1 for exact depth."""
    final: float
    """Observable surface that the path shows [%]."""
    area: float
    """Its mean over the budget [%]."""
    steps: int
    turns: int
    changes: int
    """Targets that were chosen."""
    contacts: int
    path_m: float
    phantoms: int
    """Occupied voxels far from surface, at the heights of the body."""
    end: str


class Counts:
    """Counts turns, contacts and targets."""

    def __init__(self) -> None:
        self.turns = self.contacts = self.changes = 0

    def on_event(self, event: object) -> None:
        """Take an event in."""
        if isinstance(event, Stepped):
            self.turns += event.result.action in (Action.TURN_LEFT, Action.TURN_RIGHT)
            self.contacts += event.result.collided
        elif isinstance(event, Decided):
            self.changes += event.plan.reason.startswith("target chosen")


def main(
    scenes: tuple[str, ...] = ("home",),
    models: int = 5,
    first_model: int = 0,
    starts: int = 1,
    steps: int = 500,
    preset: str = "quick",
    policy: str = "gvg",
    json_file: Path | None = None,
) -> None:
    """Run, and print a table.

    Args:
        scenes: names or folders.
        models: how many noise models.
        first_model: number of the first one, which its draw depends on.
        starts: how many of each scene's own starts.
        steps: budget of actions.
        preset: of the map.
        policy: which is judged.
        json_file: where to write the rows; nowhere if not given.
    """
    numbers = range(first_model, first_model + models)
    for number in numbers:
        has = ", ".join(f"{name} {value:.2g}" for name, value in asdict(draw_noise(number)).items() if value)
        print(f"model {number}: {has}")
    rows: list[Outcome] = []
    print(
        "\n| scene | start | noise | final, area [%] | turns, targets | path [m] | phantoms | end |\n"
        + "|---" * 8
        + "|"
    )
    for name in scenes:
        world = load_scene(name)
        for start in range(min(starts, len(world.starts))):
            for number in (-1, *numbers):
                row = _run(world, start, number, steps, preset, policy)
                rows.append(row)
                print(
                    f"| {row.scene} | {row.start} | {'exact' if number < 0 else number} "
                    f"| {row.final:.1f}, {row.area:.1f} | {row.turns}, {row.changes} | {row.path_m:.1f} "
                    f"| {row.phantoms} | {row.end} at {row.steps}, {row.contacts} contacts |",
                    flush=True,
                )
                if json_file is not None:
                    json_file.write_text(json.dumps([asdict(r) for r in rows], indent=1) + "\n", encoding="utf-8")
    _summarize(rows)


def _run(world: Scene, start: int, number: int, steps: int, preset: str, policy_name: str) -> Outcome:
    config = make_config(preset, [], scene=world.name, policy=policy_name)
    with make_robot(world, start=world.starts[start]) as simulated:
        noise = None if number < 0 else draw_noise(number)
        robot, counts = NoisyCamera(simulated, noise, 1000 * start + number + 1), Counts()
        policy = make_policy(policy_name, PolicyContext(robot.footprint, config.policy_settings, config.planning))
        mapper = NeuralMap(config.mapping, seed=0)
        ended = explore(robot, mapper, policy, num_steps=steps, observers=(counts,))
    first = robot.exact[0]
    camera = CameraExtrinsics.of_view(first.intrinsics, first.T_world_camera, first.pose)
    truth = cached_ground_truth(world, robot.footprint, camera, first.pose)
    curve = CompletionCurve(truth)
    for seen in robot.exact:
        curve.frame(seen.step, reduce_depth(seen.depth_m), seen.intrinsics, seen.T_world_camera, seen.pose)
    curve.last()
    ratios = [row.observable_ratio or 0.0 for row in curve.rows]
    held = ratios + [ratios[-1]] * (steps // CHECKPOINT_STEPS + 1 - len(ratios))
    return Outcome(
        world.name,
        start,
        number,
        final=ratios[-1],
        area=float(np.mean(held)),
        steps=ended.num_steps,
        turns=counts.turns,
        changes=counts.changes,
        contacts=counts.contacts,
        path_m=curve.path_m,
        phantoms=_phantoms(mapper.occupancy_grid(), truth),
        end=ended.stop_reason,
    )


def _phantoms(grid: OccupancyGrid, truth: GroundTruth) -> int:
    places_m = grid.origin_m + (np.argwhere(grid.state == OCCUPIED)[:, ::-1] + 0.5) * grid.resolution_m
    places_m = places_m[(places_m[:, 2] > BODY_M[0]) & (places_m[:, 2] < BODY_M[1])]
    apart_m, _ = KDTree(truth.samples).query(places_m, distance_upper_bound=PHANTOM_M)
    return int(np.count_nonzero(~np.isfinite(apart_m)))


def _summarize(rows: list[Outcome]) -> None:
    exact = {(row.scene, row.start): row for row in rows if row.model < 0}
    noisy = [row for row in rows if row.model >= 0]
    if not noisy:
        return
    print("\n| scene | pairs | final | area | turns / exact | targets / exact | phantoms |\n" + "|---" * 7 + "|")
    for name in (*dict.fromkeys(row.scene for row in noisy), "all"):
        pairs = [(row, exact[row.scene, row.start]) for row in noisy if name in (row.scene, "all")]
        final, area = (
            np.array([getattr(row, key) - getattr(other, key) for row, other in pairs]) for key in ("final", "area")
        )
        turns, changes = (
            sum(getattr(row, key) for row, _ in pairs) / max(sum(getattr(other, key) for _, other in pairs), 1)
            for key in ("turns", "changes")
        )
        phantoms = np.mean([row.phantoms for row, _ in pairs])
        scenes = [row.scene for row, _ in pairs]
        changed = (_mean(scene_means(scenes, values.tolist()) if name == "all" else values) for values in (final, area))
        cells = (name, len(pairs), *changed, f"{turns:.2f}", f"{changes:.2f}", f"{phantoms:.0f}")
        print(f"| {' | '.join(map(str, cells))} |")


def _mean(values: Float[np.ndarray, " n"]) -> str:
    error = values.std(ddof=1) / math.sqrt(len(values)) if len(values) > 1 else math.nan
    return f"{values.mean():+.1f} ± {error:.1f}"


if __name__ == "__main__":
    run_script(main)
