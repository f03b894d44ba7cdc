"""A policy of your own: drives to the nearest place at the border of the unknown. Copy the file and change it.

anm-mj explore home --policy my_policy:MyPolicy --set policy.near_m=0.8
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.stages import Stages
from anm_mj.protocols import Mapper
from anm_mj.types import ARRIVED_M, Action, Observation, Plan, Pose2, StopReason


@dataclass(frozen=True)
class MyConfig:
    """Settings of the policy, given with ``--set policy.NAME=VALUE``; every field needs a default."""

    near_m: float = 1.0  # A place is worth going to if the border of the unknown is nearer to it than this [m].
    apart_m: float = 0.5  # Distance of a new target from all earlier ones [m].


class MyPolicy:
    """Looks around, then goes to the nearest place at the border of the unknown, until there is none."""

    Config = MyConfig

    def __init__(self, context: PolicyContext[MyConfig]):
        """Take what is known before the first observation: body, settings and seed."""
        self.settings = context.settings
        self.stages = Stages(context.planning, context.footprint)  # Top-down map, Voronoi graph, safe paths.
        self.targets: list[np.ndarray] = []

    def observe(self, observation: Observation) -> None:
        """Hear every observation that enters the map, also those between two decisions."""
        self.stages.observe(observation)

    def plan(self, mapper: Mapper, observation: Observation) -> Plan:
        """Decide. Asked when the last plan is done, or an obstacle appeared on its path."""
        if not self.targets:
            self.targets.append(observation.pose.xy_m)
            return Plan("look around", actions=(Action.TURN_LEFT,) * 36)
        state = self.stages.read(mapper, observation)
        places, border = state.graph.vertex_xy_m, state.topdown.frontier_xy_m
        near = cdist(places, border).min(axis=1, initial=np.inf) < self.settings.near_m
        near &= cdist(places, self.targets).min(axis=1) > self.settings.apart_m
        cost_m = np.where(near & (cdist(places, [state.pose.xy_m])[:, 0] > ARRIVED_M), state.paths.distance_m, np.inf)
        if not np.isfinite(cost_m).any():
            return state.plan("no path leads to the unknown", stop=StopReason.COMPLETE)
        best = int(np.argmin(cost_m))
        self.targets.append(places[best])
        x, y = border[np.argmin(cdist(places[[best]], border))] - places[best]
        reason = f"{cost_m[best]:.1f} m to the border of the unknown"
        return state.plan(reason, path_xy_m=state.paths.path_to(best), headings_rad=(float(np.arctan2(y, x)),))

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Learn that an action met an obstacle, which the map did not show."""
        self.stages.on_collision(pose, action)
