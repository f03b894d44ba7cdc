"""Explores with a policy of your own: this one follows the wall on its right.

    python scripts/03_your_policy.py
    anm-mj explore home --policy my_policy:WallFollower     # once the class stands in my_policy.py

A policy is a class with three methods; nothing has to be registered. docs/policy.md has a template that uses map, graph
and paths as the policies of the project do.
"""

from dataclasses import dataclass

import numpy as np

import anm_mj
from anm_mj.cli.command_line import run_script
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.protocols import Mapper
from anm_mj.types import Action, Observation, Plan, Pose2

NOWHERE = np.zeros((0, 2))


@dataclass(frozen=True)
class WallConfig:
    """Settings, given with --set policy.NAME=VALUE; every field needs a default."""

    apart_m: float = 0.3
    """Distance between the robot's outline and the wall [m]."""


class WallFollower:
    """Turns left where something is ahead, turns right where the wall on the right ends, else drives on."""

    Config = WallConfig

    def __init__(self, context: PolicyContext[WallConfig]):
        """Take what is known before the first observation: body, settings, seed."""
        self.body, self.settings = context.footprint, context.settings

    def observe(self, observation: Observation) -> None:
        """Hear what enters the map; the map keeps what was seen, so that there is nothing to remember."""

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """One action at a time, from the signed distances of the neural map."""
        ahead_m = self.clearance_m(mapper, observation.pose, 0.0)
        right_m = self.clearance_m(mapper, observation.pose, -np.pi / 2)
        if ahead_m < self.settings.apart_m:
            return Plan(f"{ahead_m:.1f} m ahead", NOWHERE, actions=(Action.TURN_LEFT,) * 3)
        if right_m > 3 * self.settings.apart_m:
            return Plan("the wall on the right ends", NOWHERE, actions=(Action.TURN_RIGHT, *(Action.MOVE_FORWARD,) * 2))
        return Plan(f"along a wall at {right_m:.1f} m", NOWHERE, actions=(Action.MOVE_FORWARD,) * 2)

    def clearance_m(self, mapper: Mapper, pose: Pose2, bearing_rad: float) -> float:
        """How far the body could move in a direction before it meets what the map holds, 2 m at most [m]."""
        yaw_rad = pose.yaw_rad + bearing_rad
        reach_m = self.body.radius_m + np.arange(0.05, 2.0, 0.05)
        points = np.zeros((len(reach_m), 3))
        points[:, :2] = pose.xy_m + reach_m[:, None] * [np.cos(yaw_rad), np.sin(yaw_rad)]
        blocked = np.zeros(len(reach_m), bool)
        for height_m in (0.15, 0.4, 0.8, 1.2):
            points[:, 2] = height_m
            blocked |= mapper.sdf(points) < 0.05
        return float(reach_m[np.argmax(blocked)] - self.body.radius_m) if blocked.any() else 2.0

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Learn nothing from an obstacle: the next image shows it."""


def main(scene: str = "home", steps: int = 300, seed: int = 0) -> None:
    """Explore with the policy above, and with the default one."""
    for policy in (f"{__name__}:WallFollower", "gvg"):
        made = anm_mj.explore_scene(scene, policy=policy, steps=steps, seed=seed)
        print(f"{policy:22} {made.metrics['completion_ratio']:5.1f} % of the surface, {made.folder}")


if __name__ == "__main__":
    run_script(main)
