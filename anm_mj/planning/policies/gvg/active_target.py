"""The target that the robot is sent to: where it looks from, what is expected of it, and when to decide again."""

import math
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from anm_mj.frames import wrap_angle
from anm_mj.planning.paths import remaining_path
from anm_mj.planning.policies.gvg.gvg_config import GvgConfig
from anm_mj.planning.policies.gvg.information_gain import ExpectedView, InformationGain, PromisedRays
from anm_mj.planning.policies.gvg.views import NUM_AZIMUTHS, Viewpoint, signed_turns, view_sectors
from anm_mj.types import ARRIVED_M, NEAR_TARGET_M, TURN_STEP_RAD, Plan, Pose2, TopDownMap


class ActiveTarget:
    """One target from its choice until it is closed.

    Vertices of the graph move with every frame. The target follows the vertex that stands for it now, but no farther
    from the viewpoint that it was chosen for than candidates lie apart.
    """

    def __init__(
        self,
        viewpoint: Viewpoint,
        *,
        expected_gain_m2: float,
        promised: tuple[PromisedRays, PromisedRays],
        view: ExpectedView,
        seen_m2: float,
        config: GvgConfig,
        view_side: int,
    ) -> None:
        """Choose a target; a view covers ``view_side`` sectors on either side of the middle one."""
        self._view_side, self._config = view_side, config
        self._chosen = viewpoint
        self.viewpoint = viewpoint
        """Where it is now."""
        self.expected_gain_m2 = expected_gain_m2
        """New surface that the view there, and the turns to it, were expected to show at its choice [m2]."""
        self.promised = promised
        """The rays that were to show it: those where the robot stood, and those at the target."""
        self.view = view
        """What the view alone was expected to show at its choice."""
        self.seen_before_m2 = seen_m2
        """Surface seen before its choice [m2]."""
        self._plan = Plan("")
        self._view_gain_m2 = 0.0
        self._decided_at_m2 = seen_m2
        self._num_reuses = 0

    def decide(self, viewpoint: Viewpoint, plan: Plan, *, view_gain_m2: float, seen_m2: float) -> None:
        """Take over a full decision: where the target is now, what leads there, and the gain of the view alone."""
        self.viewpoint, self._plan = viewpoint, plan
        self._view_gain_m2, self._decided_at_m2, self._num_reuses = view_gain_m2, seen_m2, 0

    def is_near(self, xy_m: Float[np.ndarray, "2"]) -> bool:
        """Whether a place is nearer to the target than candidates lie apart."""
        return math.dist(xy_m, self.viewpoint.xy_m) < self._config.candidate_spacing_m

    def is_same(self, viewpoint: Viewpoint) -> bool:
        """Whether a viewpoint stands for this target: near it and its first place, with a view that overlaps most."""
        near = math.dist(viewpoint.xy_m, self._chosen.xy_m) < self._config.candidate_spacing_m
        turns = abs(signed_turns(viewpoint.heading, self._chosen.heading))
        return near and self.is_near(viewpoint.xy_m) and turns <= self._view_side

    def is_reached(self, pose: Pose2) -> bool:
        """Whether the robot stands at the target and looks along its heading."""
        error = wrap_angle(self.viewpoint.heading * TURN_STEP_RAD - pose.yaw_rad)
        return math.dist(self.viewpoint.xy_m, pose.xy_m) < NEAR_TARGET_M and abs(error) < TURN_STEP_RAD

    @property
    def promised_m2(self) -> float:
        """New surface that all of it was expected to show at its choice [m2]."""
        return float(sum(rays.gain_m2.sum() for rays in self.promised))

    def done_m2(self, gain: InformationGain, *, reached: bool) -> float:
        """The part of what was expected of it that the robot has looked at [m2].

        If the target was ``reached``, that is all of its view, and otherwise what was seen of it from elsewhere.
        """
        looked = np.zeros(NUM_AZIMUTHS, bool)
        looked[(self._chosen.heading + view_sectors(self._view_side)) % NUM_AZIMUTHS] = reached
        start, end = self.promised
        return gain.done_m2(start) + gain.done_m2(end, looked)

    def needs_decision(self, pose: Pose2, seen_m2: float) -> bool:
        """Whether a full decision is due: the target reached, the plan done or old, or the surface much changed."""
        enough_m2 = max(self._config.replan_gain_m2, self._config.replan_gain_share * self._view_gain_m2)
        return (
            self.is_reached(pose)
            or abs(seen_m2 - self._decided_at_m2) > enough_m2
            or self._num_reuses >= self._config.max_plan_reuse
            or self._is_followed(pose)
        )

    def is_worth(self, view_gain_m2: float) -> bool:
        """Whether the view is worth going on for, if it is expected to show this much now [m2]."""
        return view_gain_m2 >= max(self._config.reuse_share * self._view_gain_m2, self._config.min_gain_m2)

    def remaining_path(self, pose: Pose2) -> Float[np.ndarray, "k 2"]:
        """The rest of the plan's path, from the robot on [m]; empty for a turn on the spot."""
        path_xy_m = self._plan.path_xy_m
        return remaining_path(path_xy_m, pose) if len(path_xy_m) else path_xy_m

    def reuse(
        self,
        path_xy_m: Float[np.ndarray, "k 2"],
        *,
        view_gain_m2: float,
        seen_m2: float,
        topdown: TopDownMap,
        stage_ms: dict[str, float],
    ) -> Plan:
        """The plan of the last full decision again, with the rest of its path [m] and the map as of now."""
        self._num_reuses += 1
        reason = (
            f"plan reused: expected gain {view_gain_m2:.1f} m², "
            f"{seen_m2 - self._decided_at_m2:.1f} m² seen since the last full decision"
        )
        return replace(self._plan, reason=reason, path_xy_m=path_xy_m, topdown=topdown, stage_ms=stage_ms)

    def _is_followed(self, pose: Pose2) -> bool:
        """Whether nothing of the plan is left to do; its heading may differ from the sector's by half a turn step."""
        path = self._plan.path_xy_m
        there = not len(path) or math.dist(path[-1], pose.xy_m) < ARRIVED_M
        # Headings lie whole turn steps away, except for the error of the wheels.
        return there and all(
            abs(wrap_angle(yaw - pose.yaw_rad)) < 0.75 * TURN_STEP_RAD for yaw in self._plan.headings_rad
        )
