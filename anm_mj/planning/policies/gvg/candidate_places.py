"""The places that a decision compares: where the robot stands, and reachable vertices of the graph, thinned out."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from anm_mj.planning.policies.gvg.gvg_config import GvgConfig
from anm_mj.planning.policies.gvg.information_gain import InformationGain
from anm_mj.planning.stages import PlanningState
from anm_mj.types import FORWARD_STEP_M

HERE = -1
"""Stands for the robot's own place among the vertices."""


@dataclass(frozen=True)
class CandidatePlaces:
    """Places with the gain of their best view; the first is where the robot stands."""

    vertex: Int[np.ndarray, " n"]
    """Index into the graph; ``HERE`` for the robot's place."""
    xy_m: Float[np.ndarray, "n 2"]
    gain_m2: Float[np.ndarray, " n"]
    """Expected new surface in the best view [m2]."""
    steps: Float[np.ndarray, " n"]
    """Forward steps to get there."""
    num_unreachable: int
    """Vertices of the graph that no path leads to."""
    config: GvgConfig

    @property
    def best_gain_m2(self) -> float:
        """Gain of the best view of all [m2]."""
        return float(self.gain_m2.max())

    @property
    def discount_steps(self) -> float:
        """The discount length that fits where the gain lies: longer when most of it is far away [steps]."""
        gain = np.where(self.gain_m2 < self.config.min_gain_m2, 0.0, self.gain_m2)
        mean_steps = float((gain * self.steps).sum() / max(gain.sum(), 1e-9))
        least = self.config.discount_steps
        return float(np.clip(mean_steps, least, self.config.max_discount_ratio * least))

    def shortlist(self, discount_steps: float) -> Int[np.ndarray, " k"]:
        """The robot's own place and the others with most discounted gain, at most one per square.

        Gain after ``discount_steps`` counts 1/e.
        """
        value = self.gain_m2 * np.exp(-self.steps / discount_steps)
        value[self.gain_m2 < self.config.min_gain_m2] = 0.0
        square = np.floor(self.xy_m / self.config.shortlist_spacing_m).astype(np.int64)
        chosen = [0]
        taken: set[tuple[int, int]] = set()
        for i in np.argsort(-value, kind="stable"):
            if len(chosen) > self.config.max_candidates or value[i] <= 0.0:
                break
            key = (int(square[i, 0]), int(square[i, 1]))
            if i and key not in taken:
                taken.add(key)
                chosen.append(int(i))
        return np.array(chosen)


def candidate_places(state: PlanningState, gain: InformationGain, config: GvgConfig) -> CandidatePlaces:
    """The places that can be reached now.

    Gains come from the cache. Before no place is left with gain worth a step, all gains are recomputed: the cache
    may hold an old one for a place nearby.
    """
    reachable = np.isfinite(state.paths.distance_m)
    # A vertex at the robot's own place costs more turns than it shows.
    away = np.linalg.norm(state.graph.vertex_xy_m - state.pose.xy_m, axis=1) > config.same_place_m
    vertices = _thinned(state, reachable & away, config.candidate_spacing_m)
    xy_m = np.concatenate([state.pose.xy_m[None], state.graph.vertex_xy_m[vertices]])
    gain_m2 = gain.best_view_gains(xy_m)
    if gain_m2.max() < config.min_gain_m2:
        gain_m2 = gain.best_view_gains(xy_m, fresh=True)
    steps = np.concatenate([[0.0], state.paths.distance_m[vertices] / FORWARD_STEP_M])
    num_unreachable = int((~reachable).sum())
    return CandidatePlaces(np.concatenate([[HERE], vertices]), xy_m, gain_m2, steps, num_unreachable, config)


def _thinned(state: PlanningState, usable: Bool[np.ndarray, " n"], spacing_m: float) -> Int[np.ndarray, " m"]:
    """The vertex with most clearance in each square with a fixed place in the world, nearest first."""
    vertices = np.flatnonzero(usable)
    square = np.floor(state.graph.vertex_xy_m[vertices] / spacing_m).astype(np.int64)
    order = np.lexsort((-state.graph.clearance_m[vertices], square[:, 1], square[:, 0]))
    _, first = np.unique(square[order], axis=0, return_index=True)
    kept = vertices[order[first]]
    return kept[np.argsort(state.paths.distance_m[kept], kind="stable")]
