"""A policy of your own: drives to the nearest place at the border of the unknown. Copy the file and change it.

anm-mj explore home --policy my_policy:MyPolicy --set policy.near_m=0.8
"""

from dataclasses import dataclass

import numpy as np

from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.stages import Stages
from anm_mj.protocols import Mapper
from anm_mj.types import TURN_STEP_RAD, Action, Observation, Plan, Pose2, StopReason

FULL_TURN = round(2.0 * np.pi / TURN_STEP_RAD)
NOWHERE = np.zeros((0, 2))


def distances_m(ones: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Distances between all pairs of places (n, 2) and (m, 2), of shape (n, m) [m]."""
    return np.linalg.norm(ones[:, None] - others[None], axis=2)


@dataclass(frozen=True)
class MyConfig:
    """Settings of the policy, given with ``--set policy.NAME=VALUE``; every field needs a default."""

    near_m: float = 1.0
    """A place is worth going to if the border of the unknown is nearer to it than this [m]."""
    apart_m: float = 0.5
    """Distance of a new target from all earlier ones [m]."""


class MyPolicy:
    """Looks around, then goes to the nearest place at the border of the unknown, until there is none."""

    Config = MyConfig

    def __init__(self, context: PolicyContext[MyConfig]):
        """Take what is known before the first observation: body, settings and seed."""
        self.settings = context.settings
        self.stages = Stages(context.planning, context.footprint)  # Top-down map, Voronoi graph, safe paths.
        self.visited: list[np.ndarray] = []

    def observe(self, observation: Observation) -> None:
        """Hear every observation, also those between two decisions."""
        self.stages.observe(observation)

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """Decide. Asked when the last plan is done, or an obstacle appeared on its path."""
        if not self.visited:
            self.visited.append(observation.pose.xy_m)
            return Plan("look around", NOWHERE, actions=(Action.TURN_LEFT,) * FULL_TURN)
        state = self.stages.read(mapper, observation)
        places, border = state.graph.vertex_xy_m, state.topdown.frontier_xy_m
        if len(places) == 0 or len(border) == 0:
            return Plan("nothing unknown is left", NOWHERE, stop=StopReason.COMPLETE)
        to_border_m = distances_m(places, border)
        to_visited_m = distances_m(places, np.array(self.visited))
        good = (to_border_m.min(axis=1) < self.settings.near_m) & (to_visited_m.min(axis=1) > self.settings.apart_m)
        cost_m = np.where(good, state.paths.distance_m, np.inf)
        if not np.isfinite(cost_m).any():
            return Plan("no way leads to the unknown", NOWHERE, stop=StopReason.NO_REACHABLE_TARGET)
        best = int(np.argmin(cost_m))
        self.visited.append(places[best])
        towards = border[np.argmin(to_border_m[best])] - places[best]
        heading_rad = float(np.arctan2(towards[1], towards[0]))
        reason = f"{cost_m[best]:.1f} m to the border of the unknown"
        return Plan(reason, state.paths.path_to(best), headings_rad=(heading_rad,))

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Learn that an action met an obstacle, which the map did not show."""
        self.stages.on_collision(pose, action)
