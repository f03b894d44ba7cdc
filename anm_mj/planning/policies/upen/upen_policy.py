"""Uncertainty-driven planning with an ensemble of occupancy predictors (UPEN; Georgakis et al., ICRA 2022).

Four networks (:mod:`anm_mj.planning.policies.upen.occupancy_net`) predict the map in a square of 8 m around the robot
from a planar grid of the policy's own. A random tree grows over the ground that they predict to be free. Among its
paths of ten hops the robot takes the one along which the networks disagree most about what is occupied. It chooses
again after 10 steps of 25 cm or at the end of the path.

Deviations:

- The networks are smaller, and they are trained on floor plans of this project's generator (``scripts/train_upen.py``),
  not on Matterport3D.
- Every decision predicts from scratch instead of fusing predictions into a map.
- The tree is a plain one; the original rewires it.
- The robot follows paths on the grid instead of a learned point navigator.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Int8

from anm_mj.frames import world_to_cell
from anm_mj.planning.paths import NEAR_ROBOT_M, shortcut_path
from anm_mj.planning.policies.context import PolicyConfig, PolicyContext
from anm_mj.planning.policies.scan_policy import ScanPolicy
from anm_mj.planning.policies.upen.occupancy_net import (
    CELL_M,
    CROP_CELLS,
    FREE_CLASS,
    OCCUPIED_CLASS,
    VOID,
    load_ensemble,
    predict,
)
from anm_mj.planning.policies.upen.rrt import Tree, grow_tree
from anm_mj.planning.scan_grid import RESOLUTION_M
from anm_mj.protocols import Mapper
from anm_mj.types import (
    FORWARD_STEP_M,
    FREE,
    OCCUPIED,
    UNKNOWN,
    Action,
    Candidate,
    Observation,
    Plan,
    Pose2,
    TopDownMap,
)
from anm_mj.utils.arrays import values_at
from anm_mj.utils.settings import setting
from anm_mj.utils.stopwatch import Stopwatch

WEIGHTS = Path(__file__).with_name("weights.npz")
MAX_LOGGED = 20
"""Candidates kept for the plan log."""


@dataclass(frozen=True)
class UpenConfig(PolicyConfig):
    """The random tree that the policy grows, and how long it follows a path."""

    range_m: float = setting(10.0, at_most=100.0)
    """Depth beyond this is left out of the policy's own grid [m]."""
    num_samples: int = setting(2500, at_most=100_000)
    """Samples that the tree is grown towards."""
    hop_m: float = setting(0.25, at_least=0.1)
    """Length of an edge of the tree [m]: no path ends where the robot counts as arrived already, at 9.75 cm."""
    num_hops: int = setting(10, at_most=1000)
    """Edges of the paths that are compared."""
    replan_steps: int = round(10 * 0.25 / FORWARD_STEP_M)
    """The policy decides again after this many steps: ten of the original's steps of 25 cm, which is about the length
    of a path. After ten steps of 6.5 cm the robot would turn to one path after the other and follow none."""
    max_occupied_probability: float = setting(0.5, at_most=1.0)
    """Paths avoid unknown cells whose mean predicted probability of an obstacle is higher."""


class Upen(ScanPolicy):
    """Takes the path along which an ensemble of predictors disagrees most."""

    Config = UpenConfig
    REBUILT = ("_ensemble",)

    def __init__(self, context: PolicyContext[UpenConfig]):
        """Load the networks; the grid is empty. Raises PlanError if weights are missing or of another shape."""
        self.config = context.settings
        self._ensemble = load_ensemble(WEIGHTS)
        self._rng = np.random.default_rng([context.seed, 3])
        super().__init__(context, self.config.range_m)

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """The path of most disagreement; a random turn where there is no path."""
        del mapper
        watch = Stopwatch()
        pose = observation.pose
        with watch.stage("topdown"):
            topdown = self.grid.topdown()
        with watch.stage("predict"):
            crop = egocentric_crop(topdown, pose)
            occupied = np.stack([predict(weights, crop)[OCCUPIED_CLASS] for weights in self._ensemble])
        with watch.stage("paths"):
            tree = self._tree(topdown, pose, occupied.mean(axis=0))
            ends = np.flatnonzero(tree.num_hops == min(self.config.num_hops, int(tree.num_hops.max())))
            paths = [tree.path_to(int(end)) for end in ends]
            scores = [float(value_along(occupied.var(axis=0), path, pose).sum()) for path in paths]
        if len(tree.xy_m) == 1:
            turn = (Action.TURN_LEFT, Action.TURN_RIGHT)[self._rng.integers(2)]
            return Plan(f"no path leads away from here: {turn.name}", actions=(turn,), topdown=topdown)
        best = int(np.argmax(scores))
        ranked = np.argsort(scores)[::-1][:MAX_LOGGED]
        return Plan(
            f"most disagreement ({scores[best]:.2f}) along one of {len(paths)} paths of {len(paths[best]) - 1} hops",
            shortcut_path(paths[best], topdown, self._safe_m, pose),
            valid_steps=self.config.replan_steps,
            candidates=tuple(
                Candidate(paths[k][-1], scores[k], scores[k], (len(paths[k]) - 1) * self.config.hop_m / FORWARD_STEP_M)
                for k in ranked
            ),
            topdown=topdown,
            stage_ms=watch.ms,
        )

    def _tree(self, topdown: TopDownMap, pose: Pose2, occupied: Float32[np.ndarray, "rows cols"]) -> Tree:
        """A tree over cells that are clear of obstacles and not predicted to be occupied."""
        rows, cols = np.indices(topdown.state.shape)
        xy = topdown.origin_xy_m + (np.stack([cols, rows], axis=-1) + 0.5) * RESOLUTION_M
        near = np.hypot(*np.moveaxis(xy - pose.xy_m, -1, 0)) < NEAR_ROBOT_M
        window = (np.abs(xy - pose.xy_m) < CROP_CELLS * CELL_M / 2).all(axis=-1)
        start = world_to_cell(pose.xy_m[None], topdown.origin_xy_m, topdown.resolution_m)[0]
        # In a tight spot the clearance that the robot has now is enough, as for all policies.
        least_m = self._safe_m - self._slack_m
        here_m = min(least_m, float(topdown.clearance_m[tuple(start)]))
        passable = window & (topdown.clearance_m >= np.where(near, here_m, least_m)) & (topdown.state != OCCUPIED)
        # An obstacle may have been marked where it stands; it leads away from there, but into none.
        passable[tuple(start)] = True
        guessed = passable & (topdown.state == UNKNOWN)
        passable[guessed] = value_along(occupied, xy[guessed], pose) < self.config.max_occupied_probability
        return grow_tree(
            passable,
            topdown.origin_xy_m,
            RESOLUTION_M,
            pose.xy_m,
            half_width_m=CROP_CELLS * CELL_M / 2,
            num_samples=self.config.num_samples,
            hop_m=self.config.hop_m,
            rng=self._rng,
        )


def egocentric_crop(topdown: TopDownMap, pose: Pose2) -> Int8[np.ndarray, "rows cols"]:
    """The known cells around the robot, its heading along the columns; occupied where any of the finer cells is."""
    centres = (np.arange(CROP_CELLS) + 0.5 - CROP_CELLS / 2) * CELL_M
    crop = np.full((CROP_CELLS, CROP_CELLS), VOID, np.int8)
    c, s = np.cos(pose.yaw_rad), np.sin(pose.yaw_rad)
    for shift in np.ndindex(3, 3):
        dy, dx = (np.array(shift) - 1) * (CELL_M / 3)
        ahead, aside = np.meshgrid(centres + dx, centres + dy)
        xy = np.stack([pose.x_m + c * ahead - s * aside, pose.y_m + s * ahead + c * aside], axis=-1)
        state = values_at(topdown.state, world_to_cell(xy, topdown.origin_xy_m, topdown.resolution_m), UNKNOWN)
        crop[(state == FREE) & (crop == VOID)] = FREE_CLASS
        crop[state == OCCUPIED] = OCCUPIED_CLASS
    return crop


def value_along(
    values: Float32[np.ndarray, "rows cols"], xy_m: Float[np.ndarray, "n 2"], pose: Pose2
) -> Float32[np.ndarray, " n"]:
    """Values of a crop around a pose at world points, zero outside of it."""
    c, s = np.cos(pose.yaw_rad), np.sin(pose.yaw_rad)
    ahead, aside = ((xy_m - pose.xy_m) @ np.array([[c, -s], [s, c]])).T
    cells = np.floor(np.stack([aside, ahead], axis=1) / CELL_M + CROP_CELLS / 2).astype(int)
    return values_at(values, cells, 0.0)
