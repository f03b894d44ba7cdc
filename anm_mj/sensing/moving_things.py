"""What moves around the robot: places and velocities of the things that moved pixels show.

The camera looks over what is low and near. Such a thing is remembered for longer, until its place is seen empty, as
somewhere about that place: within what it can have covered at its fastest, up to a bound.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from anm_mj.frames import transform_points
from anm_mj.types import Observation

REMEMBERED_S = 2.0
"""A thing that is seen no more is expected about for so long [s]."""
HIDDEN_S, SPREAD_M = 20.0, 0.3
"""A low thing that is out of view is expected for so long [s], within so much of its place [m]."""
FASTEST_MPS, STANDING_MPS = 2.0, 0.2
_CELL_M = 0.15
"""Points in neighbouring cells of this edge belong to one thing [m]."""
_LOW_M, _HIGH_M = 0.05, 2.2
"""Heights that count [m]."""
_LOW_SIGHTS = 3
"""A thing is low that looks so in so many frames in a row."""
_NEAR_M = 0.5
"""What the camera looks over at this distance is low [m]."""
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
    low_sights: int = 0
    """Frames in a row in which the camera would have looked over what it saw of it, were it near."""
    fastest_mps: float = 0.0
    """Its largest speed so far."""

    @property
    def is_low(self) -> bool:
        """Whether the camera looks over it where it is near: one frame may show no more of a person than the feet."""
        return self.low_sights >= _LOW_SIGHTS

    @property
    def stands(self) -> bool:
        """Whether it moves no more, or sways only."""
        return math.hypot(*self.velocity_mps) < STANDING_MPS

    def after(self, time_s: float) -> tuple[float, float]:
        """Where it is expected at a time [m]: it goes on for a second at most."""
        ahead_s = min(max(time_s - self.seen_s, 0.0), 1.0)
        return self.x_m + self.velocity_mps[0] * ahead_s, self.y_m + self.velocity_mps[1] * ahead_s

    def spread_m(self, time_s: float) -> float:
        """How far from where it is expected it may be at a time, given that it has not been seen since [m]."""
        return min(self.fastest_mps * max(time_s - self.seen_s, 0.0), SPREAD_M) if self.is_low else 0.0


class MovingThings:
    """Follows them from frame to frame."""

    def __init__(self) -> None:
        self.things: list[MovingThing] = []
        """Those that were seen lately."""

    def update(self, observation: Observation) -> None:
        """Take in a frame whose moved pixels are told apart."""
        now_s = observation.time_s - observation.image_age_s
        known = [thing for thing in self.things if _is_remembered(thing, observation, now_s)]
        self.things = []
        sight_m = _sight_height_m(observation)
        for x_m, y_m, radius_m, top_m in _clusters(observation) if observation.moved_m is not None else []:
            velocity, fastest, low_sights, before = (0.0, 0.0), 0.0, 0, _nearest(known, x_m, y_m, now_s)
            if before is not None:
                known.remove(before)
                passed_s = max(now_s - before.seen_s, 1e-3)
                found = (x_m - before.x_m) / passed_s, (y_m - before.y_m) / passed_s
                vx, vy = (0.5 * (new + old) for new, old in zip(found, before.velocity_mps, strict=True))
                share = min(1.0, FASTEST_MPS / max(math.hypot(vx, vy), 1e-9))
                velocity = vx * share, vy * share
                fastest, low_sights = max(before.fastest_mps, math.hypot(*velocity)), before.low_sights
            low_sights = low_sights + 1 if top_m < sight_m else 0
            self.things.append(MovingThing(x_m, y_m, velocity, radius_m, now_s, low_sights, fastest))
        self.things += known


def _is_remembered(thing: MovingThing, observation: Observation, now_s: float) -> bool:
    """Whether a thing may still be about: for longer where it is low, until the camera sees past its place."""
    unseen_s = now_s - thing.seen_s
    if unseen_s <= REMEMBERED_S or not thing.is_low:
        return unseen_s <= REMEMBERED_S
    camera, T_camera_world = observation.intrinsics, np.linalg.inv(observation.T_world_camera)
    x, y, z = transform_points(T_camera_world, np.array([[*thing.after(now_s), _LOW_M]]))[0].tolist()
    u, v = (camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy) if z > 0.0 else (-1.0, -1.0)
    in_view = 0.0 <= u < camera.width and 0.0 <= v < camera.height
    # What was not measured says nothing, and what is nearer hides the place.
    is_seen = in_view and bool(observation.depth_m[int(v), int(u)] > z)
    return unseen_s <= HIDDEN_S and not is_seen


def _sight_height_m(observation: Observation) -> float:
    """Lowest height that the camera sees at a short distance [m]."""
    camera, T_world_camera = observation.intrinsics, observation.T_world_camera
    right, ahead, up = T_world_camera[:3, :3] @ [0.0, (camera.height - camera.cy) / camera.fy, 1.0]
    return float(T_world_camera[2, 3] + up / max(math.hypot(right, ahead), 1e-6) * _NEAR_M)


def _nearest(known: list[MovingThing], x_m: float, y_m: float, now_s: float) -> MovingThing | None:
    """The known thing that may have come to a place; None for none."""
    best, best_m = None, math.inf
    for thing in known:
        away_m = math.dist(thing.after(now_s), (x_m, y_m))
        if away_m < min(best_m, 0.4 + 0.5 * FASTEST_MPS * min(now_s - thing.seen_s, REMEMBERED_S)):
            best, best_m = thing, away_m
    return best


def _clusters(observation: Observation) -> list[tuple[float, float, float, float]]:
    """Place, radius and top [m] of each thing that moved pixels show."""
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
    xyz_m: Float[np.ndarray, "n 3"] = xyz_m[(xyz_m[:, 2] > _LOW_M) & (xyz_m[:, 2] < _HIGH_M)]
    xy_m = xyz_m[:, :2]
    if len(xy_m) < _LEAST_POINTS:
        return []
    cells = np.floor(xy_m / _CELL_M).astype(np.int64)
    cells -= cells.min(axis=0)
    taken = np.zeros(cells.max(axis=0) + 1, bool)
    taken[cells[:, 0], cells[:, 1]] = True
    label = np.empty(taken.shape, np.int32)
    ndimage.label(taken, np.ones((3, 3)), output=label)
    of_point = label[cells[:, 0], cells[:, 1]]
    found = []
    for number in np.flatnonzero(np.bincount(of_point) >= _LEAST_POINTS).tolist():
        points = xy_m[of_point == number]
        x_m, y_m = points.mean(axis=0).tolist()
        radius_m = float(np.quantile(np.hypot(points[:, 0] - x_m, points[:, 1] - y_m), 0.95))
        top_m = float(xyz_m[of_point == number, 2].max())
        found.append((x_m, y_m, min(max(radius_m, _SMALLEST_M), _LARGEST_M), top_m))
    return found
