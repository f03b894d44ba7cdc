"""What policies with a planar grid of their own have in common: they scan every view and plan on that grid alone."""

import math

import numpy as np
from jaxtyping import Float

from anm_mj.planning.field_of_view import FieldOfView
from anm_mj.planning.policies.context import PolicyContext
from anm_mj.planning.policies.continued_run import remembered
from anm_mj.planning.scan_grid import RESOLUTION_M, ScanGrid
from anm_mj.protocols import Mapper
from anm_mj.types import FORWARD_STEP_M, Action, ExploredState, Observation, Pose2


class ScanPolicy:
    """Base of policies that decide on a :class:`~anm_mj.planning.scan_grid.ScanGrid`."""

    _azimuth_rad = 0.0
    """Where the camera looks beside the heading, as seen last [rad]."""

    def __init__(self, context: PolicyContext, range_m: float):
        """Start with an empty grid; depth beyond ``range_m`` is left out of it."""
        self.grid = ScanGrid(context.footprint, range_m)
        self._safe_m = context.footprint.radius_m + context.planning.margin_m
        self._slack_m = RESOLUTION_M / 2
        """A cell is passable if any point of it may keep the clearance [m]; vertices of a graph lie anywhere, too."""
        self._driven: list[tuple[float, float]] = []
        """Where the base was, x and y [m]."""

    def memory(self) -> dict[str, np.ndarray]:
        """The grid."""
        return {"log_odds": self.grid.log_odds, "origin_xy_m": self.grid.origin_xy_m}

    def continue_from(self, prior: ExploredState, mapper: Mapper) -> None:
        """Take over the grid of a prior run, or what the map says where that was another policy's."""
        log_odds, origin = remembered(prior, "log_odds", (None, None)), remembered(prior, "origin_xy_m", (2,))
        if log_odds is not None and origin is not None:
            self.grid.continue_from(log_odds, origin)
        else:
            self.grid.read_occupancy(mapper.occupancy_grid(), prior.poses)
        self._driven = [(float(x), float(y)) for x, y, _ in prior.poses]
        for x, y, yaw in prior.collisions:
            self.grid.block_ahead(Pose2(x, y, yaw))

    def observe(self, observation: Observation) -> None:
        """Take a scan into the grid."""
        self.grid.integrate(observation)
        self._azimuth_rad = FieldOfView.of(observation).azimuth_rad
        (x_m, y_m), last_m = observation.pose.xy_m, self._driven[-1] if self._driven else (math.inf, math.inf)
        moved_m = math.dist((x_m, y_m), last_m)
        if moved_m > RESOLUTION_M / 2:
            # A step is longer than a cell; farther apart lie poses that the base did not drive between.
            if moved_m < 2.0 * FORWARD_STEP_M:
                self._driven.append(((x_m + last_m[0]) / 2, (y_m + last_m[1]) / 2))
            self._driven.append((x_m, y_m))

    @property
    def _driven_m(self) -> Float[np.ndarray, "n 2"]:
        """Where the base was: the robot can go back the way it came, whatever was marked beside it since [m]."""
        return np.array(self._driven).reshape(-1, 2)

    def on_collision(self, pose: Pose2, action: Action) -> None:
        """Put the obstacle, which the scans did not show, into the grid."""
        if action is Action.MOVE_FORWARD:
            self.grid.block_ahead(pose)
