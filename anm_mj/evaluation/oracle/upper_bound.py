"""Estimated upper bound on coverage: a relaxation leaves out the time to see many things, but not the path to each.

A sample counts from the first step at which the robot could see it if it drove straight to where it is seen from and
turned to it by the shorter side. So the bound at a step is the number of samples that some pose can see by
then. It is loose where much is to be seen in many places, because it is in all of them at the same time. It is an
estimate, because the poses and the samples are chosen ones: a sample may be seen earlier from between the places.

Poses are those of the tour search: places at most a spacing apart, whose views stand for those about them. Travel is
bounded from below by that slack and by how much a path over a grid is longer than a straight one.
"""

import math

import numpy as np
from jaxtyping import Float, Int, UInt64
from skimage.graph import MCP_Geometric

from anm_mj.evaluation.oracle.visibility import count
from anm_mj.frames import world_to_cell
from anm_mj.geometry.polyline import NUM_HEADINGS
from anm_mj.ground_truth.observable import ReachableArea
from anm_mj.types import FORWARD_STEP_M

GRID_DETOUR = 1.0 / math.cos(math.pi / 8.0)
"""Most by which a path over the eight neighbours of grid cells is longer than the straight one."""


def earliest_steps(
    area: ReachableArea, places_m: Float[np.ndarray, "p 2"], start_m: Float[np.ndarray, "2"], yaw: int, spacing_m: float
) -> Int[np.ndarray, "p yaws"]:
    """A lower bound on the actions to each place and heading. ``yaw`` is the heading at the start; a pose is at most
    ``spacing_m`` from its place in each axis.
    """
    reached = MCP_Geometric(np.where(area.reachable, 1.0, -1.0))
    cells = world_to_cell(np.concatenate([start_m[None], places_m]), area.origin_xy_m, area.resolution_m)
    free = np.argwhere(area.reachable)
    # The start may lie in a cell at the very edge, which the grid leaves out.
    begin = free[np.argmin(((free - cells[0]) ** 2).sum(axis=1))]
    grid_m = reached.find_costs([tuple(begin)])[0][tuple(cells[1:].T)] * area.resolution_m
    straight_m = np.linalg.norm(places_m - start_m, axis=1)
    slack_m = math.sqrt(2.0) * (spacing_m + area.resolution_m)
    travel_m = np.maximum(np.where(np.isfinite(grid_m), grid_m / GRID_DETOUR, 0.0), straight_m) - slack_m
    moves = np.floor(np.maximum(travel_m, 0.0) / FORWARD_STEP_M).astype(np.int64)
    apart = np.abs(np.arange(NUM_HEADINGS) - yaw) % NUM_HEADINGS
    return moves[:, None] + np.minimum(apart, NUM_HEADINGS - apart)[None]


def coverage_bound(
    bits: UInt64[np.ndarray, "p yaws words"], earliest: Int[np.ndarray, "p yaws"], budget: int
) -> Int[np.ndarray, " steps"]:
    """Most samples that a tour can have covered after each step, from 0 to the budget; those that no frame covers from
    the start. ``bits`` say what the frame at every place and heading covers, a bit for each sample; ``earliest`` bounds
    the actions to each from below.
    """
    order = np.argsort(earliest, axis=None, kind="stable")
    steps = earliest.reshape(-1)[order]
    views = bits.reshape(-1, bits.shape[2])
    # What no pose covers may be seen from between them: nothing bounds when.
    seen = ~np.bitwise_or.reduce(views, axis=0)
    bound = np.zeros(budget + 1, np.int64)
    first = 0
    for step in range(budget + 1):
        last = int(np.searchsorted(steps, step, side="right"))
        if last > first:
            seen |= np.bitwise_or.reduce(views[order[first:last]], axis=0)
            first = last
        bound[step] = count(seen)
    return bound
