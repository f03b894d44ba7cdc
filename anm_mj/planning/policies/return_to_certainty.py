"""Brings a robot that grows unsure of its pose back to where it was sure, whatever policy explores."""

import math

import numpy as np

from anm_mj.frames import wrap_angle
from anm_mj.planning.planning_config import PlanningConfig
from anm_mj.protocols import Mapper, Policy
from anm_mj.types import ARRIVED_M, TURN_STEP_RAD, Action, Observation, Plan, Pose2

SURE_SHARE = 0.5
"""The robot is sure of its pose again where its deviations are at most this share of those that it returns at."""
REPLAN_STEPS = 4
"""The return is planned again after this many steps."""
MOST_PLANS = 20
"""After so many plans of one return the policy explores on, until the robot is sure again; the first five turn it."""


class ReturnToCertainty:
    """A policy that drives back along its trail while the pose deviates too much."""

    def __init__(self, policy: Policy, config: PlanningConfig) -> None:
        self._policy = policy
        self._most_m, self._most_rad = config.return_deviation_m, config.return_deviation_rad
        self._trail: list[Pose2] = []
        """Poses from one that the robot was sure of to where it turned back; empty before the first."""
        self._is_unsure = False
        self._num_plans = 0

    def observe(self, observation: Observation) -> None:
        """Note where the robot is, and how sure it is of it."""
        if not self._num_plans:
            self._trail.append(observation.pose)
        if self._share(observation) <= SURE_SHARE:
            self._trail, self._is_unsure, self._num_plans = [observation.pose], False, 0
        self._policy.observe(observation)

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """The policy's decision, or the way back."""
        self._is_unsure |= self._share(observation) > 1.0
        back = self._back(observation) if self._is_unsure and self._num_plans < MOST_PLANS else None
        if back is None:
            return self._policy.plan(mapper, observation)
        self._num_plans += 1
        return back

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Pass a collision on; where it was on the way back, that is not clear."""
        if self._num_plans:
            self._num_plans = MOST_PLANS
        self._policy.on_collision(pose, action)

    def _share(self, observation: Observation) -> float:
        """How much the pose deviates, as a share of the deviations that the robot returns at."""
        return max(observation.position_deviation_m / self._most_m, observation.heading_deviation_rad / self._most_rad)

    def _back(self, observation: Observation) -> Plan | None:
        """The way back along the trail; None where there is nothing to do for it."""
        if not self._trail:
            return None
        sure, pose = self._trail[0], observation.pose
        away_m = math.dist(sure.xy_m, pose.xy_m)
        if away_m < ARRIVED_M and abs(wrap_angle(sure.yaw_rad - pose.yaw_rad)) < TURN_STEP_RAD:
            self._num_plans = MOST_PLANS
            return None
        trail_xy_m = np.array([place.xy_m for place in self._trail])
        # The nearest place of the trail may lie behind a robot that drives back already.
        nearest = int(np.linalg.norm(trail_xy_m - pose.xy_m, axis=1).argmin())
        path = np.vstack((pose.xy_m, trail_xy_m[max(nearest - 1, 0) :: -1]))
        return Plan(
            f"return to where the pose was certain, {away_m:.1f} m away: its standard deviations are "
            f"{100.0 * observation.position_deviation_m:.1f} cm and "
            f"{math.degrees(observation.heading_deviation_rad):.1f} degrees",
            path if away_m >= ARRIVED_M else np.zeros((0, 2)),
            headings_rad=(sure.yaw_rad,),
            valid_steps=REPLAN_STEPS,
        )
