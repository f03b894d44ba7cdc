"""Measures the planner: policies in a scene with the occupancy grid as their only map, or with the neural map.

    python scripts/bench_planner.py --scene home --steps 1000
    OMP_NUM_THREADS=1 python scripts/bench_planner.py --scene office --sensor d435i --steps 300
    python scripts/bench_planner.py --scene home --policy gvg anm-s --start 4.9 2.2 180
    python scripts/bench_planner.py --scene home --policy gvg --starts 3

Prints one line per policy and start: how much of what can be seen at all was seen, at the end and on average over the
budget (the area under the curve), the steps at which nine tenths were reached and at which the last useful surface was
seen (all but the last 0.25 % of the end's), the end, and what a decision took of one core's time.

By default nothing is learnt: without a field there is no uncertainty, and anm-s goes without regions of interest. With
``--sensor`` the map is the one of ``anm-mj explore``; what it is asked in a decision counts as the decision's.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Float32

from anm_mj.cli.command_line import run_script
from anm_mj.config import make_config
from anm_mj.evaluation.completion_curve import CompletionCurve
from anm_mj.events import Ended, Observed, Observer, Stepped
from anm_mj.explore import explore
from anm_mj.ground_truth.cache import cached_ground_truth
from anm_mj.ground_truth.pixel_rays import CameraExtrinsics
from anm_mj.ground_truth.reduced_depth import reduce_depth
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.registry import default_settings, make_policy
from anm_mj.protocols import Mapper, Policy
from anm_mj.scene.folder import Scene, load_scene
from anm_mj.sim.make_robot import make_robot
from anm_mj.sim.sensors.sensor_config import sensor_config
from anm_mj.types import (
    OCCUPIED,
    Action,
    MapUpdate,
    Observation,
    OccupancyGrid,
    Plan,
    Pose2,
    SurfacePoints,
    TrueView,
)

LAST_PERCENT = 0.25
"""What is seen after all but this much of the whole surface is of no use any more [%]."""
FAR_M = 0.1
"""What the map says of places away from occupied voxels [m]."""


class OccupancyMapper:
    """A map that knows free, occupied and unknown, and no more."""

    def __init__(self) -> None:
        self._grid = DepthOccupancy(OccupancyConfig())

    def integrate(self, observation: Observation) -> MapUpdate:
        """Fuse the depth."""
        self._grid.integrate(observation.depth_m, observation.intrinsics, observation.T_world_camera)
        return MapUpdate(math.nan, 0, 0)

    @property
    def truncation_m(self) -> float:
        """Distance from surface beyond which the SDF says no more than 'far' [m]."""
        return FAR_M

    def sdf(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, " n"]:
        """Negative in occupied voxels."""
        return np.where(self._grid.state_at(points_m) == OCCUPIED, -FAR_M / 2, FAR_M).astype(np.float32)

    def uncertainty(self, points_m: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, " n"]:
        """The same everywhere."""
        return np.ones(len(points_m), np.float32)

    def surface(
        self, centre_xy_m: Float[np.ndarray, "2"], radius_m: float, max_height_m: float = math.inf
    ) -> SurfacePoints:
        """None: there is no field."""
        del centre_xy_m, radius_m, max_height_m
        none = np.zeros((0, 3), np.float32)
        return SurfacePoints(none, none, np.zeros(0, np.float32))

    def occupancy_grid(
        self, centre_xy_m: Float[np.ndarray, "2"] | None = None, radius_m: float = math.inf
    ) -> OccupancyGrid:
        """The grid."""
        del centre_xy_m, radius_m
        return self._grid.grid


@dataclass
class Timed:
    """A policy whose decisions are timed, in CPU time of the process."""

    policy: Policy
    ms: list[float] = field(default_factory=list)

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """The policy's decision; those without a map read are left out."""
        begin = time.process_time()
        plan = self.policy.plan(mapper, observation)
        if plan.topdown is not None:
            self.ms.append(1e3 * (time.process_time() - begin))
        return plan

    def observe(self, observation: Observation) -> None:
        """Passed on."""
        self.policy.observe(observation)

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Passed on."""
        self.policy.on_collision(pose, action)


class Coverage:
    """Keeps the completion curve and counts turns and contacts."""

    def __init__(self, curve: CompletionCurve, true_view: Callable[[], TrueView]) -> None:
        self.curve = curve
        self._true_view = true_view
        self.num_turns = 0
        self.num_contacts = 0

    def on_event(self, event: object) -> None:
        """Take a frame in, count a step; decisions are timed elsewhere."""
        if isinstance(event, Observed):
            # Only exact depth counts as seen, and only where the sensor gave a value.
            seen, true = event.observation, self._true_view()
            self.curve.frame(seen.step, reduce_depth(true.depth_m), seen.intrinsics, true.T_world_camera, true.pose)
        elif isinstance(event, Stepped):
            self.num_turns += event.result.action is not Action.MOVE_FORWARD
            self.num_contacts += event.result.collided


def main(
    scene: str = "home",
    policy: tuple[str, ...] = ("gvg", "anm-s"),
    steps: int = 1000,
    start: tuple[float, float, float] | None = None,
    starts: int = 1,
    seed: int = 0,
    sensor: str | None = None,
) -> None:
    """Run and print.

    Args:
        scene: name or folder.
        policy: the policies to compare.
        steps: budget of actions.
        start: x [m], y [m], yaw [deg]; when left out, the scene's own starts.
        starts: how many of these.
        seed: of what a policy draws, and of the neural map.
        sensor: errors of the camera, as of ``anm-mj explore``, and with a neural map; None = exact, without one.
    """
    world = load_scene(scene)
    poses = [Pose2(start[0], start[1], math.radians(start[2]))] if start else list(world.starts[:starts])
    print("policy       start    seen     mean    90 % at   last at     steps  turns  contacts  p50 ms  p99 ms  end")
    for name in policy:
        for number, pose in enumerate(poses):
            outcome, coverage, timed = run(world, name, steps, pose, seed, sensor)
            row = [r.observable_ratio or 0.0 for r in coverage.curve.rows]
            reached = next((str(r.step) for r in coverage.curve.rows if (r.observable_ratio or 0.0) >= 90.0), "never")
            last = next(r.step for r in coverage.curve.rows if (r.observable_ratio or 0.0) >= row[-1] - LAST_PERCENT)
            held = row + [row[-1]] * max(steps // 10 + 1 - len(row), 0)
            p50, p99 = np.percentile(timed.ms or [0.0], [50, 99])
            share = coverage.num_turns / max(outcome.num_steps, 1)
            print(
                f"{name:12} {number:>5} {row[-1]:6.1f} % {np.mean(held):6.1f} % {reached:>9} {last:>9} "
                f"{outcome.num_steps:>9} {share:>6.0%} {coverage.num_contacts:>9} {p50:>7.1f} {p99:>7.1f}  "
                f"{outcome.stop_reason}",
                flush=True,
            )


def run(
    world: Scene,
    name: str,
    steps: int,
    pose: Pose2,
    seed: int,
    sensor: str | None = None,
    observers: tuple[Observer, ...] = (),
) -> tuple[Ended, Coverage, Timed]:
    """One run of one policy."""
    with make_robot(world, start=pose, sensor=sensor_config(sensor or "exact")) as robot:
        first = robot.observe()
        camera = CameraExtrinsics.of_view(first.intrinsics, first.T_world_camera, first.pose, first.range_m)
        truth = cached_ground_truth(world, robot.footprint, camera, first.pose)
        coverage = Coverage(CompletionCurve(truth), robot.true_view)
        timed = Timed(make_policy(name, PolicyContext(robot.footprint, default_settings(name), seed=seed)))
        # With the uncertainty that guides the policy.
        config = make_config("default", [], scene=world.name, policy=name)
        mapper = OccupancyMapper() if sensor is None else NeuralMap(config.mapping, seed=seed)
        outcome = explore(robot, mapper, timed, num_steps=steps, observers=(coverage, *observers))
        coverage.curve.last()
        return outcome, coverage, timed


if __name__ == "__main__":
    run_script(main)
