"""What moves around the robot: places and velocities of the things that moved pixels show."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from anm_mj.frames import transform_points
from anm_mj.types import Observation

REMEMBERED_S = 2.0
"""A thing that is seen no more is expected about for so long [s]."""
FASTEST_MPS, STANDING_MPS = 2.0, 0.2
_CELL_M = 0.15
"""Points in neighbouring cells of this edge belong to one thing [m]."""
_LOW_M, _HIGH_M = 0.1, 2.2
"""Heights that count [m]."""
_LEAST_POINTS, _FOCAL_PX = 4, 64.0
"""Fewer pixels are no thing, of an image thinned to this focal length."""
_SMALLEST_M, _LARGEST_M = 0.2, 0.5
"""Radius of a thing: what is seen of it, within these [m]."""


@dataclass(frozen=True)
class MovingThing:
    """One of them."""

    x_m: float
    """World x when it was seen last [m]."""
    y_m: float
    velocity_mps: tuple[float, float]
    radius_m: float
    seen_s: float
    """When it was seen last [s]."""

    @property
    def stands(self) -> bool:
        """Whether it moves no more, or sways only."""
        return math.hypot(*self.velocity_mps) < STANDING_MPS

    def after(self, time_s: float) -> tuple[float, float]:
        """Where it is expected at a time [m]: it goes on for a second at most."""
        ahead_s = min(max(time_s - self.seen_s, 0.0), 1.0)
        return self.x_m + self.velocity_mps[0] * ahead_s, self.y_m + self.velocity_mps[1] * ahead_s


class MovingThings:
    """Follows them from frame to frame."""

    def __init__(self) -> None:
        self.things: list[MovingThing] = []
        """Those that were seen lately."""

    def update(self, observation: Observation) -> None:
        """Take in a frame whose moved pixels are told apart."""
        now_s = observation.time_s - observation.image_age_s
        known = [thing for thing in self.things if now_s - thing.seen_s <= REMEMBERED_S]
        self.things = []
        for x_m, y_m, radius_m in _clusters(observation) if observation.moved_m is not None else []:
            velocity, before = (0.0, 0.0), _nearest(known, x_m, y_m, now_s)
            if before is not None:
                known.remove(before)
                passed_s = max(now_s - before.seen_s, 1e-3)
                found = (x_m - before.x_m) / passed_s, (y_m - before.y_m) / passed_s
                vx, vy = (0.5 * (new + old) for new, old in zip(found, before.velocity_mps, strict=True))
                share = min(1.0, FASTEST_MPS / max(math.hypot(vx, vy), 1e-9))
                velocity = vx * share, vy * share
            self.things.append(MovingThing(x_m, y_m, velocity, radius_m, now_s))
        self.things += known


def _nearest(known: list[MovingThing], x_m: float, y_m: float, now_s: float) -> MovingThing | None:
    """The known thing that may have come to a place; None for none."""
    best, best_m = None, math.inf
    for thing in known:
        away_m = math.dist(thing.after(now_s), (x_m, y_m))
        if away_m < min(best_m, 0.4 + 0.5 * FASTEST_MPS * (now_s - thing.seen_s)):
            best, best_m = thing, away_m
    return best


def _clusters(observation: Observation) -> list[tuple[float, float, float]]:
    """Place and radius [m] of each thing that moved pixels show."""
    assert observation.moved_m is not None
    camera = observation.intrinsics
    thin = max(1, round(camera.fx / _FOCAL_PX))
    row, col = np.nonzero(np.isfinite(observation.moved_m[::thin, ::thin]))
    if len(row) < _LEAST_POINTS:
        return []
    row, col = row * thin, col * thin
    depth_m = observation.moved_m[row, col].astype(float)
    rays = (col + 0.5 - camera.cx) / camera.fx, (row + 0.5 - camera.cy) / camera.fy, np.ones(len(row))
    xyz_m = transform_points(observation.T_world_camera, np.stack(rays, axis=1) * depth_m[:, None])
    xy_m: Float[np.ndarray, "n 2"] = xyz_m[(xyz_m[:, 2] > _LOW_M) & (xyz_m[:, 2] < _HIGH_M), :2]
    if len(xy_m) < _LEAST_POINTS:
        return []
    cells = np.floor(xy_m / _CELL_M).astype(np.int64)
    cells -= cells.min(axis=0)
    taken = np.zeros(cells.max(axis=0) + 1, bool)
    taken[cells[:, 0], cells[:, 1]] = True
    label, _ = ndimage.label(taken, np.ones((3, 3)))  # pyright: ignore[reportGeneralTypeIssues]
    of_point = label[cells[:, 0], cells[:, 1]]
    found = []
    for number in np.flatnonzero(np.bincount(of_point) >= _LEAST_POINTS).tolist():
        points = xy_m[of_point == number]
        x_m, y_m = points.mean(axis=0).tolist()
        radius_m = float(np.quantile(np.hypot(points[:, 0] - x_m, points[:, 1] - y_m), 0.95))
        found.append((x_m, y_m, min(max(radius_m, _SMALLEST_M), _LARGEST_M)))
    return found
