"""Floor that a depth camera should have measured, and did not: stairs that lead down, a pit, a stairwell.

A camera that loses pixels does not say why. Where nothing lies below a hole within its range, or what does is too dark,
the floor is as unmeasured as floor that nobody looked at. So looks are counted: towards places where the camera would
have measured a floor, how often did it measure something, and how often nothing? Things that stand before the floor are
measured instead of it, and at their edges pixels are lost, too: that is no hole.
"""

import math

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32, Int64
from scipy import ndimage

from anm_mj.sensing.pixel_state import FAR_SHARE
from anm_mj.types import Intrinsics
from anm_mj.utils.arrays import Window, clamp, dilate, embed, relative_to

SQUARE_M = 0.05
"""Edge of the squares in which looks are counted [m]."""
LOOKS = 10
"""So many views that measured nothing make a square one without a floor, if fewer measured something."""
FLOOR_LOOKS = 4
"""A view that measured the floor itself counts as so many: what is dark hides it from one side for long."""
FLOOR_M = 0.1
"""A floor lies no farther from z = 0 than this [m]."""
NEAREST_M, FARTHEST_M = 0.6, 3.0
"""Every depth camera measures between these depths [m]."""
LEAST_SLOPE = math.tan(math.radians(20.0))
"""And a floor that it looks down on by at least this rise per horizontal metre."""
WIDTH = 3
"""What is missing is at least so many squares wide: at edges of things a camera loses single pixels."""
MOST_LOST = 0.5
"""A view that lost a larger share of its pixels tells of the camera, not of the floor."""
_FOCAL_PX = 64.0
"""Images are thinned to about this focal length [px]."""
_BLOCK = 128
"""The grid grows by so many squares."""
_NOTHING = np.zeros((0, 2))


class MissingFloor:
    """Counts, per square of the floor, of the views that measured something towards it and of those that did not."""

    def __init__(self, square_m: float = SQUARE_M) -> None:
        """Start without any look; ``square_m`` is the edge of a square [m]."""
        self.square_m = square_m
        self._corner: Int[np.ndarray, "2"] = np.zeros(2, np.int64)
        """Row and column of the first square, counted from the world's origin."""
        self._lost: Int32[np.ndarray, "rows cols"] = np.zeros((0, 0), np.int32)
        self._told: Int32[np.ndarray, "rows cols"] = np.zeros((0, 0), np.int32)
        self._is_missing: Bool[np.ndarray, "rows cols"] = np.zeros((0, 0), bool)

    def look(
        self,
        depth_m: Float32[np.ndarray, "h w"],
        intrinsics: Intrinsics,
        T_world_camera: Float[np.ndarray, "4 4"],
        range_m: float,
    ) -> Float[np.ndarray, "n 2"]:
        """Count a view. Returns the centres of the squares without a floor about where it looked [m].

        ``depth_m`` is planar [m]: NaN where nothing was measured, +inf where the camera looked farther than its range,
        ``range_m``. In the world z is up, and the floor at z = 0.
        """
        lost = np.count_nonzero(np.isnan(depth_m)) / depth_m.size
        # A camera that says what is beyond its range shows missing floor by what it sees through it.
        if not 0.0 < lost < MOST_LOST:
            return _NOTHING
        places_m, is_lost, is_floor = _looked_at(depth_m, intrinsics, T_world_camera, range_m)
        if not len(places_m):
            return _NOTHING
        squares = np.floor(places_m[:, ::-1] / self.square_m).astype(np.int64)
        low, high = squares.min(axis=0), squares.max(axis=0) + 1
        self._grow(low, high)
        window = clamp(low - self._corner, high - self._corner, self._lost.shape)
        for count, part, weight in (
            (self._lost, is_lost, 1),
            (self._told, ~is_lost, 1),
            (self._told, is_floor, FLOOR_LOOKS - 1),
        ):
            # Several pixels of a view in one square are one look.
            once = np.zeros(tuple(high - low), np.int32)
            once[tuple((squares[part] - low).T)] = weight
            count[window] += once
        return self._decide(window)

    def places_xy_m(self) -> Float[np.ndarray, "n 2"]:
        """Centres of all squares without a floor [m]."""
        return self._centres(np.argwhere(self._is_missing))

    def _decide(self, looked: Window) -> Float[np.ndarray, "n 2"]:
        """Judge again around a window of squares whose counts changed; the centres of those without a floor [m]."""
        # A square may be part of what is wide enough by squares so far away.
        inner, outer = (dilate(looked, width, self._lost.shape) for width in (WIDTH - 1, 2 * WIDTH - 2))
        lost, told = self._lost[outer], self._told[outer]
        in_vain = (lost >= LOOKS) & (lost > told)
        if not (in_vain.any() or self._is_missing[inner].any()):
            return _NOTHING
        missing = ndimage.binary_opening(in_vain, np.ones((WIDTH, WIDTH)))[relative_to(inner, outer)]
        self._is_missing[inner] = missing
        return self._centres(np.argwhere(missing) + [s.start for s in inner])

    def _centres(self, row_col: Int[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        return ((row_col + self._corner + 0.5) * self.square_m)[:, ::-1]

    def voxels(self, squares_xy_m: Float[np.ndarray, "n 2"], voxel_m: float) -> Int64[np.ndarray, "m 3"]:
        """The voxels from right below the floor to z = 0 in squares of it, given by their centres, by x, y and z index;
        voxels of the edge ``voxel_m`` have their centres at multiples of it.
        """
        if not len(squares_xy_m):
            return np.zeros((0, 3), np.int64)
        # A square may lie on the border of two voxels.
        parts = math.floor(self.square_m / voxel_m) + 1
        offset_m = ((np.arange(parts) + 0.5) / parts - 0.5) * self.square_m
        within = np.stack(np.meshgrid(offset_m, offset_m), axis=-1).reshape(-1, 2)
        columns = np.rint((squares_xy_m[:, None] + within) / voxel_m).astype(np.int64).reshape(-1, 2)
        columns = np.unique(columns, axis=0)
        z = np.arange(-round(FLOOR_M / voxel_m), 1)
        return np.column_stack([np.repeat(columns, len(z), axis=0), np.tile(z, len(columns))])

    def _grow(self, low: Int[np.ndarray, "2"], high: Int[np.ndarray, "2"]) -> None:
        """Make the grid hold squares from ``low`` up to, not including, ``high``."""
        low, high = low // _BLOCK * _BLOCK, -(-high // _BLOCK) * _BLOCK
        if self._lost.size:
            low = np.minimum(low, self._corner)
            high = np.maximum(high, self._corner + self._lost.shape)
        shape = int(high[0] - low[0]), int(high[1] - low[1])
        if shape == self._lost.shape:
            return
        start = self._corner - low if self._lost.size else np.zeros(2, np.int64)
        self._lost, self._told, self._is_missing = (
            embed(old, shape, start, 0) for old in (self._lost, self._told, self._is_missing)
        )
        self._corner = low


def _looked_at(
    depth_m: Float32[np.ndarray, "h w"],
    intrinsics: Intrinsics,
    T_world_camera: Float[np.ndarray, "4 4"],
    range_m: float,
) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Where on the floor pixels look [m], which of these are lost, and which show it."""
    k, T = intrinsics, T_world_camera
    stride = max(1, round(k.fx / _FOCAL_PX))
    depth_m = depth_m[::stride, ::stride]
    u = ((np.arange(depth_m.shape[1]) * stride + 0.5 - k.cx) / k.fx)[None, :]
    v = ((np.arange(depth_m.shape[0]) * stride + 0.5 - k.cy) / k.fy)[:, None]
    x, y, z = (T[axis, 0] * u + T[axis, 1] * v + T[axis, 2] for axis in range(3))
    down, away, height_m = -z, np.sqrt(x * x + y * y), T[2, 3]
    farthest_m = min(FARTHEST_M, FAR_SHARE * range_m)
    shown = (down >= LEAST_SLOPE * away) & (height_m > down * NEAREST_M) & (height_m < down * farthest_m)
    to_floor_m = height_m / down[shown]
    places_m = np.stack([T[0, 3] + x[shown] * to_floor_m, T[1, 3] + y[shown] * to_floor_m], axis=1)
    shown_m = depth_m[shown]
    # Comparisons with NaN are false.
    return places_m, np.isnan(shown_m), np.abs(height_m - down[shown] * shown_m) < FLOOR_M
