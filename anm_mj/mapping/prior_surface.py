"""The surface that the map of a prior run knew, and where new frames contradict it.

The occupancy grid of the prior run stays as a reference. A voxel of its surface that new frames look through is gone;
a voxel that it had seen free and that new frames hit is new. Surface on the border of two voxels falls into either, so
a voxel counts only where none of its 26 neighbours explains it.

Replayed pixels of the prior run would teach the field what is no more. So those are dropped that end on surface that
is gone, or that looked through a place that is taken now.
"""

import itertools

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int8, Int64
from scipy.spatial import KDTree

from anm_mj.geometry.connected_components import connected_components
from anm_mj.mapping.keyframes import DEPTH_UNIT_M, NO_DEPTH, Keyframes, KeyframeStore
from anm_mj.mapping.occupancy_kernels import BLOCK
from anm_mj.mapping.rays import rays_of_pixels
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, SurfaceChange
from anm_mj.utils.arrays import values_at

LINK_VOXELS = 2.5
"""Voxels nearer to each other than this many edges belong to one change."""
MIN_VOXELS = 8
"""Smaller changes are not told: an edge seen from another side leaves as many voxels."""
_COARSE_VOXELS = 2
"""Rays are held against cubes of this many voxels along each edge."""
_AROUND = np.array(list(itertools.product((-1, 0, 1), repeat=3)))

Voxels = Int64[np.ndarray, "_ 3"]
"""Layer, row and column of some voxels of the prior grid."""


class PriorSurface:
    """The grid of a prior run, and which keyframes of the store are its own."""

    def __init__(self, grid: OccupancyGrid, corner: Int64[np.ndarray, "3"], keyframes: Keyframes) -> None:
        """Remember a prior run. ``grid`` is as they left it, ``corner`` the index x, y, z of its cell [0, 0, 0],
        ``keyframes`` are those that are replayed.
        """
        self._state = grid.state.copy()
        self._corner = corner.copy()
        self._voxel_m = grid.resolution_m
        self._num_keyframes = len(keyframes)
        """The oldest so many of the store are of the prior run."""
        self._end_voxel = self._ends(keyframes)
        self._read_version = grid.version
        self._known_gone = np.zeros(grid.state.shape, bool)
        self._known_new = np.zeros(grid.state.shape, bool)

    def changes(
        self,
        state: Int8[np.ndarray, "layers rows cols"],
        by_depth: Int8[np.ndarray, "layers rows cols"],
        corner: Int64[np.ndarray, "3"],
    ) -> tuple[SurfaceChange, ...]:
        """What has changed, by now: pieces of surface that are gone or new, largest first. ``state`` is the grid of
        now, which has grown from the prior run and has its first voxel at ``corner``; where depth alone, ``by_depth``,
        says otherwise, nothing is certain.
        """
        state = np.where(by_depth == state, state, np.int8(UNKNOWN))
        everywhere = slice(None), slice(None)
        found = [
            SurfaceChange(kind, (voxels[:, ::-1] + self._corner) * self._voxel_m, self._voxel_m)
            for kind, where in zip(("gone", "new"), self._changed(self._window(state, corner), everywhere), strict=True)
            for voxels in _pieces(where)
        ]
        return tuple(sorted(found, key=lambda change: -len(change.xyz_m)))

    def forget_contradicted(self, store: KeyframeStore, grid: OccupancyGrid, corner: Int64[np.ndarray, "3"]) -> None:
        """Drop the pixels of the prior run that are contradicted by what has changed since the last call. The prior
        run's keyframes stand before all others in ``store``; ``grid`` is as of now, ``corner`` that of it.
        """
        prior = store.keyframes(self._num_keyframes)
        if len(prior.pixels) != len(self._end_voxel):
            # A store that is full gives up pixels of every keyframe.
            self._end_voxel = self._ends(prior)
        dropped = self._contradicted(grid, corner, prior)
        if dropped is not None:
            kept = prior.without(dropped)
            store.replace(self._num_keyframes, kept)
            self._num_keyframes = len(kept)
            self._end_voxel = self._end_voxel[~dropped]

    def _contradicted(
        self, grid: OccupancyGrid, corner: Int64[np.ndarray, "3"], keyframes: Keyframes
    ) -> Bool[np.ndarray, " p"] | None:
        """Which pixels of the prior run are contradicted by what has changed since the last call; None for none."""
        state, window = grid.state, self._changed_window(grid, corner)
        if window is None:
            return None
        gone, new = self._changed(self._window(state, corner), window)
        gone = gone[~self._known_gone[tuple(gone.T)]]
        new = new[~self._known_new[tuple(new.T)]]
        if not len(gone) and not len(new):
            return None
        self._known_gone[tuple(gone.T)] = True
        self._known_new[tuple(new.T)] = True
        dropped = np.zeros(len(keyframes.pixels), bool)
        if len(gone):
            near = np.zeros(self._state.shape, bool)
            near[tuple(_neighbours(gone, self._state.shape).T)] = True
            near &= self._window(state, corner) != OCCUPIED
            dropped |= near.reshape(-1)[self._end_voxel] & (self._end_voxel >= 0)
        if len(new):
            cubes = np.unique((new[:, ::-1] + self._corner) // _COARSE_VOXELS, axis=0)
            centres_m = (_COARSE_VOXELS * cubes + (_COARSE_VOXELS - 1) / 2) * self._voxel_m
            dropped |= _looked_through(keyframes, centres_m, _COARSE_VOXELS * self._voxel_m)
        return dropped if dropped.any() else None

    def _window(
        self, state: Int8[np.ndarray, "layers rows cols"], corner: Int64[np.ndarray, "3"]
    ) -> Int8[np.ndarray, "l r c"]:
        """The part of a grid that the prior run covered."""
        start = (self._corner - corner)[::-1]
        return state[tuple(slice(a, a + n) for a, n in zip(start, self._state.shape, strict=True))]

    def _changed_window(self, grid: OccupancyGrid, corner: Int64[np.ndarray, "3"]) -> tuple[slice, slice] | None:
        """Rows and columns of the prior grid in which any state has changed since the last call; None for none."""
        assert grid.column_version is not None  # The occupancy grid keeps track.
        changed = np.argwhere(grid.column_version > self._read_version)
        self._read_version = grid.version
        if not len(changed):
            return None
        start = (self._corner - corner)[1::-1]
        # A neighbour in the next block may have explained a voxel until now.
        low = np.clip(changed.min(axis=0) * BLOCK - start - 1, 0, self._state.shape[1:])
        high = np.clip((changed.max(axis=0) + 1) * BLOCK - start + 1, 0, self._state.shape[1:])
        return slice(low[0], high[0]), slice(low[1], high[1])

    def _changed(self, now: Int8[np.ndarray, "layers rows cols"], window: tuple[slice, slice]) -> tuple[Voxels, Voxels]:
        """The voxels in some rows and columns that are gone, and those that are new."""
        was, origin = self._state, np.array([0, window[0].start or 0, window[1].start or 0])
        before, after = was[:, *window], now[:, *window]
        gone = np.argwhere((before == OCCUPIED) & (after == FREE)) + origin
        new = np.argwhere((before == FREE) & (after == OCCUPIED)) + origin
        return gone[~_beside(gone, now)], new[~_beside(new, was)]

    def _ends(self, keyframes: Keyframes) -> Int64[np.ndarray, " p"]:
        """Flat index of the voxel that each pixel shows; -1 for one that shows none."""
        found = np.full(len(keyframes.pixels), -1, np.int64)
        if not self._state.size:
            return found
        begin = 0
        # One by one: all rays at once would take some hundred bytes each.
        for camera, count in zip(keyframes.cameras, keyframes.num_pixels.tolist(), strict=True):
            pixels = keyframes.pixels[begin : begin + count]
            depth_m = pixels["depth"] * np.float32(DEPTH_UNIT_M)
            rays = rays_of_pixels(
                pixels["index"].astype(np.int64), pixels["rgb"], depth_m, np.broadcast_to(camera, (count, len(camera)))
            )
            points_m = rays.origin_m + rays.direction * depth_m[:, None]
            cells = (np.rint(points_m / self._voxel_m).astype(np.int64) - self._corner)[:, ::-1]
            inside = ((cells >= 0) & (cells < self._state.shape)).all(axis=1) & (pixels["depth"] != NO_DEPTH)
            where = np.flatnonzero(inside)
            found[begin + where] = np.ravel_multi_index(tuple(cells[where].T), self._state.shape)
            begin += count
        return found


def _pieces(voxels: Voxels) -> list[Voxels]:
    """Voxels in connected pieces that are large enough."""
    if not len(voxels):
        return []
    links = KDTree(voxels).query_pairs(LINK_VOXELS, output_type="ndarray")
    piece = connected_components(links, len(voxels))
    return [voxels[piece == k] for k in np.flatnonzero(np.bincount(piece) >= MIN_VOXELS)]


def _neighbours(voxels: Voxels, shape: tuple[int, ...]) -> Voxels:
    """Voxels and their neighbours, as far as a grid has them; some several times."""
    around = (voxels[:, None] + _AROUND).reshape(-1, 3)
    return around[((around >= 0) & (around < shape)).all(axis=1)]


def _beside(voxels: Voxels, state: Int8[np.ndarray, "layers rows cols"]) -> Bool[np.ndarray, " n"]:
    """Which voxels have an occupied one among their neighbours."""
    found = np.zeros(len(voxels), bool)
    for shift in _AROUND:
        found |= values_at(state, voxels + shift, UNKNOWN) == OCCUPIED
    return found


def _looked_through(keyframes: Keyframes, centres_m: Float[np.ndarray, "n 3"], edge_m: float) -> Bool[np.ndarray, " p"]:
    """Which pixels of keyframes show something behind any of some cubes, or nothing."""
    found = np.zeros(len(keyframes.pixels), bool)
    begin = 0
    for camera, count in zip(keyframes.cameras, keyframes.num_pixels.tolist(), strict=True):
        pixels = keyframes.pixels[begin : begin + count]
        depth_m = np.where(pixels["depth"] == NO_DEPTH, np.inf, pixels["depth"] * DEPTH_UNIT_M)
        row, col = np.divmod(pixels["index"].astype(np.int64), int(camera[0]))
        behind_m = _behind(camera, centres_m, edge_m, (int(row.max(initial=0)) + 1, int(camera[0])))
        found[begin : begin + count] = depth_m > behind_m[row, col]
        begin += count
    return found


def _behind(
    camera: Float32[np.ndarray, "17"], centres_m: Float[np.ndarray, "n 3"], edge_m: float, shape: tuple[int, int]
) -> Float32[np.ndarray, "h w"]:
    """For each pixel of a camera, from which planar depth on the nearest of some cubes lies before it [m]."""
    _, fx, fy, cx, cy = camera[:5].astype(float)
    T_world_camera = camera[5:].reshape(3, 4).astype(float)
    x, y, z = ((centres_m - T_world_camera[:, 3]) @ T_world_camera[:, :3]).T
    image = np.full(shape, np.inf, np.float32)
    seen = z > edge_m
    half_px = 0.5 * edge_m * max(fx, fy) / z[seen]
    u, v = fx * x[seen] / z[seen] + cx, fy * y[seen] / z[seen] + cy
    rectangles: Int[np.ndarray, "n 4"] = np.stack(
        [np.floor(v - half_px), np.ceil(v + half_px), np.floor(u - half_px), np.ceil(u + half_px)], axis=1
    ).astype(np.int64)
    rectangles = np.clip(rectangles, 0, np.array([shape[0], shape[0], shape[1], shape[1]]))
    visible = (rectangles[:, 1] > rectangles[:, 0]) & (rectangles[:, 3] > rectangles[:, 2])
    for (top, bottom, left, right), limit_m in zip(
        rectangles[visible].tolist(), (z[seen][visible] + edge_m).tolist(), strict=True
    ):
        part = image[top:bottom, left:right]
        np.minimum(part, np.float32(limit_m), out=part)
    return image
