"""Passages that a wide robot may or may not fit through: looked at early, because a building may lie behind them.

From afar the reveal of a doorway is unknown, and obstacles are thicker than they are. So the robot first keeps no
margin any more. Where this opens no path it looks through the passage from straight before it, and where that opens
none either, to the sides of the passage. Robot and passage are then in line: from beside a passage that leaves a few
centimetres it would have to drive back first.
"""

import math

import numpy as np
from jaxtyping import Float

from anm_mj.frames import wrap_angle
from anm_mj.planning.paths import narrow_gaps, segments_clear, shortcut_path
from anm_mj.planning.policies.gvg.candidate_places import candidate_places
from anm_mj.planning.policies.gvg.gvg_config import GvgConfig
from anm_mj.planning.policies.gvg.information_gain import InformationGain
from anm_mj.planning.stages import PlanningState, Stages
from anm_mj.types import ARRIVED_M, FORWARD_STEP_M, TURN_STEP_RAD, Plan

_SAME_M = 0.75
"""Passages nearer to each other than this are one [m]."""
_ABOUT_AS_GOOD = 0.8
_WAY_SHARE = 0.2
"""The straight approach that ends nearest to a passage is the best one; a metre of way to it counts as so many metres
that are left before the passage."""
_STAND_OFF_M = 0.5
"""From this much before the end of its approach the camera sees both sides of a passage [m]."""
_PARTS = 12
"""An approach is tried in so many parts."""
_SIDES_RAD = math.radians(45.0)
_MAX_LOOKS = 2


class NarrowDoors:
    """Remembers which passages were looked at, and how often."""

    def __init__(self, config: GvgConfig, stages: Stages, *, is_wide: bool) -> None:
        """Start before the first passage; a robot that is not wide tries them before its run ends only."""
        self._config, self._stages, self._is_wide = config, stages, is_wide
        self._looked_at_m: list[Float[np.ndarray, "2"]] = []

    def consider(self, state: PlanningState, gain: InformationGain) -> tuple[PlanningState, Plan | None]:
        """The state, without a margin from now on where a passage is worth it; and a look where this opens no way."""
        if not self._is_wide:
            return state, None
        with state.watch.stage("choice"):
            door = self._find(state, gain)
        if door is not None and self._stages.drop_margin():
            state = self._stages.update_graph(state.topdown, state.pose, state.watch)
            door = self._find(state, gain)
        return state, None if door is None else self._look(state, *door, gain.camera.azimuth_rad)

    def drop_margin(self, state: PlanningState, gain: InformationGain) -> bool:
        """Keep no margin from now on where much is expected behind a narrow passage; whether this may open a way."""
        _, beyond_m = narrow_gaps(state.paths)
        if not len(beyond_m) or gain.best_view_gains(beyond_m).max() < self._config.large_gain_m2:
            return False
        return self._stages.drop_margin()

    def _find(
        self, state: PlanningState, gain: InformationGain
    ) -> tuple[int, Float[np.ndarray, "2"], Float[np.ndarray, "2"]] | None:
        """The vertex from which to approach a passage worth a look, where to look from, and the place behind it [m].

        None without such a passage. What is expected behind it, discounted by the way, is at least ``door_share`` of
        the best that is expected of places that a path leads to.
        """
        vertex, beyond_m = narrow_gaps(state.paths)
        middle_m = (state.graph.vertex_xy_m[vertex] + beyond_m) / 2
        new = np.array([self._num_looks(xy) < _MAX_LOOKS for xy in middle_m], dtype=bool)
        vertex, beyond_m = vertex[new], beyond_m[new]
        if not len(vertex):
            return None
        behind_m2 = gain.best_view_gains(beyond_m)
        apart_m = np.linalg.norm(beyond_m - state.graph.vertex_xy_m[vertex], axis=1)
        value_m2 = behind_m2 * self._discount((state.paths.distance_m[vertex] + apart_m) / FORWARD_STEP_M)
        value_m2[behind_m2 < self._config.large_gain_m2] = 0.0
        others = candidate_places(state, gain, self._config)
        least_m2 = self._config.door_share * float((others.gain_m2 * self._discount(others.steps)).max())
        if value_m2.max() <= least_m2:
            return None
        good = np.flatnonzero(value_m2 >= _ABOUT_AS_GOOD * value_m2.max())
        vertex, beyond_m, apart_m = vertex[good], beyond_m[good], apart_m[good]
        start_m, share = state.graph.vertex_xy_m[vertex], np.arange(1, _PARTS) / _PARTS
        ends_m = start_m[:, None] + share[:, None] * (beyond_m - start_m)[:, None]
        starts_m = np.broadcast_to(start_m[:, None], ends_m.shape)
        clear = segments_clear(
            state.topdown, starts_m.reshape(-1, 2), ends_m.reshape(-1, 2), state.paths.safe_m, state.pose
        )
        driven_m = apart_m * clear.reshape(len(good), -1).sum(axis=1) / _PARTS
        best = int((apart_m - driven_m + _WAY_SHARE * state.paths.distance_m[vertex]).argmin())
        driven = max(driven_m[best] - _STAND_OFF_M, 0.0) / apart_m[best]
        return int(vertex[best]), start_m[best] + driven * (beyond_m - start_m)[best], beyond_m[best]

    def _look(
        self,
        state: PlanningState,
        vertex: int,
        beside_m: Float[np.ndarray, "2"],
        beyond_m: Float[np.ndarray, "2"],
        azimuth_rad: float,
    ) -> Plan:
        """A look through or beside a passage with a camera that looks so far beside the heading [rad]."""
        middle_m = (state.graph.vertex_xy_m[vertex] + beyond_m) / 2
        again = self._num_looks(middle_m) > 0
        self._looked_at_m.append(middle_m)
        x, y = beyond_m - beside_m
        yaw = wrap_angle(math.atan2(y, x) - azimuth_rad)
        # Who stands there and looks through already has seen what there is to see.
        is_there = math.dist(beside_m, state.pose.xy_m) < ARRIVED_M
        again |= is_there and abs(wrap_angle(yaw - state.pose.yaw_rad)) < TURN_STEP_RAD
        headings = (wrap_angle(yaw + _SIDES_RAD), wrap_angle(yaw - _SIDES_RAD)) if again else (yaw,)
        reason = (
            f"a look {'beside' if again else 'through'} the narrow passage to ({beyond_m[0]:.1f}, {beyond_m[1]:.1f})"
        )
        paths = state.paths
        path_xy_m = np.vstack((paths.path_to(vertex), beside_m))
        path_xy_m = shortcut_path(path_xy_m, state.topdown, paths.safe_m, state.pose)
        return state.plan(reason, path_xy_m=path_xy_m, headings_rad=headings)

    def _num_looks(self, middle_m: Float[np.ndarray, "2"]) -> int:
        return sum(math.dist(middle_m, seen) < _SAME_M for seen in self._looked_at_m)

    def _discount(self, steps: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        return np.exp(-steps / self._config.discount_steps)
