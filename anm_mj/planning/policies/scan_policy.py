"""What policies with a planar grid of their own have in common: they scan every view and plan on that grid alone."""

from __future__ import annotations

from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.scan_grid import ScanGrid
from anm_mj.types import Action, Observation, Pose2


class ScanPolicy:
    """Base of policies that decide on a :class:`~anm_mj.planning.scan_grid.ScanGrid`."""

    def __init__(self, context: PolicyContext, range_m: float):
        """Start with an empty grid.

        Args:
            context: what the policy is made from.
            range_m: depth beyond this is left out of the grid [m].
        """
        self.grid = ScanGrid(context.footprint, range_m)
        self._safe_m = context.footprint.radius_m + context.planning.margin_m

    def observe(self, observation: Observation) -> None:
        """Take a scan into the grid."""
        self.grid.integrate(observation)

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Put the obstacle, which the scans did not show, into the grid."""
        if action is Action.MOVE_FORWARD:
            self.grid.block_ahead(pose)
