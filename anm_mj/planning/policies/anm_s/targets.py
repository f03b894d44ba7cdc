"""The present target, and earlier ones that led into an obstacle or were dropped on the way."""

import math

import numpy as np
from jaxtyping import Bool, Float, Int

from anm_mj.planning.policies.anm_s.anm_s_config import AnmSConfig
from anm_mj.planning.policies.anm_s.visited import num_within
from anm_mj.types import NEAR_TARGET_M, Pose2, Region


class Targets:
    """Remembers where the robot goes and where it failed to go."""

    def __init__(self, config: AnmSConfig):
        self._config = config
        self.xy_m: Float[np.ndarray, "2"] | None = None
        """The present target [m]; None = there is none."""
        self.unvisited = False
        """Whether the present target was unvisited when it was chosen."""
        self.regions: tuple[Region, ...] = ()
        """The regions that the robot is to see from there."""
        self._failed_xy_m: list[Float[np.ndarray, "2"]] = []
        self._dropped_xy_m: list[Float[np.ndarray, "2"]] = []

    def memory(self) -> dict[str, np.ndarray]:
        """The failed and the dropped targets [m]."""
        return {
            "failed_xy_m": np.array(self._failed_xy_m).reshape(-1, 2),
            "dropped_xy_m": np.array(self._dropped_xy_m).reshape(-1, 2),
        }

    def continue_from(self, failed_xy_m: np.ndarray | None, dropped_xy_m: np.ndarray | None) -> None:
        """Remember the failed and the dropped targets of a prior run [m]; None = of another policy's run."""
        self._failed_xy_m = list([] if failed_xy_m is None else failed_xy_m.astype(float))
        self._dropped_xy_m = list([] if dropped_xy_m is None else dropped_xy_m.astype(float))

    def choose(self, xy_m: Float[np.ndarray, "2"], regions: tuple[Region, ...], *, unvisited: bool) -> None:
        """Make a vertex the present target."""
        self.xy_m, self.regions, self.unvisited = xy_m, regions, unvisited

    def drop_for(self, xy_m: Float[np.ndarray, "2"], pose: Pose2) -> None:
        """Remember the present target as dropped, if the robot has not reached it and a new one lies elsewhere."""
        before_m = self.xy_m
        if before_m is None or math.dist(before_m, pose.xy_m) < NEAR_TARGET_M:
            return
        if math.dist(before_m, xy_m) > self._config.same_target_m:
            self._dropped_xy_m.append(before_m)

    def fail(self) -> None:
        """Remember the present target as one whose path led into an obstacle, and give it up."""
        if self.xy_m is not None:
            self._failed_xy_m.append(self.xy_m)
        self.clear()

    def clear(self) -> None:
        """Give the present target up."""
        self.xy_m, self.regions = None, ()

    def is_near(self, pose: Pose2) -> bool:
        """Whether the robot is near the present target: there is no better place to see its regions from."""
        return self.xy_m is not None and bool(np.linalg.norm(self.xy_m - pose.xy_m) < NEAR_TARGET_M)

    def match(self, xy_m: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, " k"]:
        """Index of the place that now stands for the present target; empty when none is near enough."""
        if self.xy_m is None or not len(xy_m):
            return np.zeros(0, np.int64)
        away = np.linalg.norm(xy_m - self.xy_m, axis=1)
        return np.flatnonzero((away == away.min()) & (away <= self._config.same_target_m))[:1]

    def num_failures(self, xy_m: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, " n"]:
        """How many paths to about each place led into an obstacle."""
        return num_within(xy_m, self._failed_xy_m, self._config.fail_radius_m)

    def is_given_up(self, xy_m: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
        """Which places led into obstacles, or were dropped, too often."""
        dropped = num_within(xy_m, self._dropped_xy_m, self._config.fail_radius_m)
        return (self.num_failures(xy_m) >= self._config.max_fails) | (dropped >= self._config.max_changes)
