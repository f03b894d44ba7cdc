"""Leaves out what a camera cannot see, without changing one bit of its picture.

A software renderer spends its time on triangles, not on pixels, so two kinds of meshes are not handed to it: those
outside the field of view, and those behind what is in front. The second kind is guessed from the last pictures and
then proved with the new one: a mesh was rightly left out if the whole box about it lies behind the depth that was
drawn without it. If one was not, it is added and the picture is drawn again. So a wrong guess costs time only.
"""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float, Float32, Float64, Int

from anm_mj.scene.chunks import MIN_TRIANGLES
from anm_mj.types import Intrinsics

_BLOCK_PX = 8
"""Side of the blocks of pixels that the farthest depth is kept for [px]."""
_GUARD_PX = 8
"""A mesh is taken for hidden in the next picture if it would stay so when shifted by this much [px]."""
_STALE_M = 0.3
"""How far the camera may go before what it knows of hidden meshes is forgotten [m]."""
_DEPTH_MARGIN = 1e-4
"""A box must lie this much behind what hides it, in relation to its depth: ten times the error of a depth buffer."""


def worth_culling(model: mujoco.MjModel) -> bool:
    """True if a model has so many triangles that choosing among them takes less time than it saves."""
    meshes = model.geom_dataid[model.geom_type == mujoco.mjtGeom.mjGEOM_MESH]
    return int(model.mesh_facenum[meshes].sum()) >= MIN_TRIANGLES


class Culling:
    """Chooses which of a model's meshes a camera has to draw."""

    def __init__(self, model: mujoco.MjModel, intrinsics: Intrinsics, groups: tuple[int, ...], *, znear_m: float):
        """Measure the meshes that stand still; all others are always drawn.

        Args:
            model: its meshes and their places must stay as they are.
            intrinsics: of the camera.
            groups: geom groups that the camera draws.
            znear_m: what is nearer is clipped away [m].
        """
        still = (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH) & (model.body_weldid[model.geom_bodyid] == 0)
        self._geoms = np.flatnonzero(still & np.isin(model.geom_group, groups))
        self._corners_m = _box_corners(model, self._geoms)
        self._intrinsics = intrinsics
        self._znear_m = znear_m
        # What is seen through glass is not hidden by it.
        self._opaque = not _has_glass(model, self._geoms)
        self._hidden = np.zeros(len(self._geoms), dtype=bool)
        self._judged_at_m = np.zeros((len(self._geoms), 3))

    def begin(self, T_world_camera: Float[np.ndarray, "4 4"]) -> None:
        """Project all meshes for a new picture and guess which are needed.

        Args:
            T_world_camera: Camera to world; camera axes x right, y down, z forward.
        """
        self._position_m = T_world_camera[:3, 3]
        corners = (self._corners_m - self._position_m) @ T_world_camera[:3, :3]
        z = corners[:, :, 2]
        k = self._intrinsics
        # Half a pixel more than the picture, so that no rounding can decide.
        right, left = (k.width - k.cx + 0.5) / k.fx, (k.cx + 0.5) / k.fx
        down, up = (k.height - k.cy + 0.5) / k.fy, (k.cy + 0.5) / k.fy
        x, y = corners[:, :, 0], corners[:, :, 1]
        outside = (z < self._znear_m).all(axis=1)
        for beyond in (x > right * z, -x > left * z, y > down * z, -y > up * z):
            outside |= beyond.all(axis=1)
        self._in_view = ~outside
        self._nearest_m = z.min(axis=1)
        whole = self._nearest_m > self._znear_m
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v = k.fx * x / z + k.cx, k.fy * y / z + k.cy
        extent_px = np.stack([u.min(axis=1), v.min(axis=1), u.max(axis=1), v.max(axis=1)], axis=1)
        # A box about the camera may show up anywhere.
        extent_px[~whole] = (0.0, 0.0, k.width, k.height)
        self._extent_px = np.clip(extent_px, -1e6, 1e6)
        moved_m = np.abs(self._judged_at_m - self._position_m).max(axis=1)
        self._left_out = self._in_view & self._hidden & (moved_m < _STALE_M)

    def not_drawn(self) -> Int[np.ndarray, " n"]:
        """Ids of the geoms that need not be drawn now."""
        return self._geoms[~self._in_view | self._left_out]

    def accept(self, depth_m: Float32[np.ndarray, "h w"]) -> bool:
        """True if a picture is right although it was drawn without some meshes; else they are to be drawn after all.

        Args:
            depth_m: Planar z of the picture; NaN where nothing was hit.
        """
        if not self._opaque:
            return True
        in_view = np.flatnonzero(self._in_view)
        farthest = _FarthestDepth(depth_m)
        nearest_m = self._nearest_m[in_view] * (1.0 - _DEPTH_MARGIN)
        left_out = self._left_out[in_view]
        if left_out.any():
            members = in_view[left_out]
            missing = members[nearest_m[left_out] <= farthest.within(self._extent_px[members], margin_px=1)]
            if len(missing):
                self._left_out[missing] = False
                return False
        self._hidden[in_view] = nearest_m > farthest.within(self._extent_px[in_view], margin_px=_GUARD_PX)
        self._judged_at_m[in_view] = self._position_m
        return True


class _FarthestDepth:
    """Answers for many rectangles at once how far their farthest pixel is."""

    def __init__(self, depth_m: Float32[np.ndarray, "h w"]):
        """Build tables of maxima over blocks of 2^i by 2^j cells (a sparse table)."""
        height, width = depth_m.shape
        rows, cols = -(-height // _BLOCK_PX), -(-width // _BLOCK_PX)
        padded = np.full((rows * _BLOCK_PX, cols * _BLOCK_PX), -np.inf, dtype=np.float32)
        padded[:height, :width] = np.where(np.isnan(depth_m), np.float32(np.inf), depth_m)
        cells = padded.reshape(rows, _BLOCK_PX, cols * _BLOCK_PX).max(axis=1)
        cells = cells.reshape(rows, cols, _BLOCK_PX).max(axis=2)
        self._shape = (rows, cols)
        self._tables = np.array([_doubled(level, axis=1) for level in _doubled(cells, axis=0)])

    def within(self, extent_px: Float64[np.ndarray, "n 4"], margin_px: int) -> Float32[np.ndarray, " n"]:
        """The farthest depth within u_min, v_min, u_max, v_max and a margin [m]; -inf outside the picture."""
        rows, cols = self._shape
        first_col = np.floor((extent_px[:, 0] - margin_px) / _BLOCK_PX).astype(np.int64)
        first_row = np.floor((extent_px[:, 1] - margin_px) / _BLOCK_PX).astype(np.int64)
        last_col = np.floor((extent_px[:, 2] + margin_px) / _BLOCK_PX).astype(np.int64)
        last_row = np.floor((extent_px[:, 3] + margin_px) / _BLOCK_PX).astype(np.int64)
        empty = (last_col < 0) | (last_row < 0) | (first_col >= cols) | (first_row >= rows)
        first_col, last_col = np.clip(first_col, 0, cols - 1), np.clip(last_col, 0, cols - 1)
        first_row, last_row = np.clip(first_row, 0, rows - 1), np.clip(last_row, 0, rows - 1)
        i, j = _log2(last_row - first_row + 1), _log2(last_col - first_col + 1)
        second_row, second_col = last_row + 1 - (1 << i), last_col + 1 - (1 << j)
        found = np.maximum(
            np.maximum(self._tables[i, j, first_row, first_col], self._tables[i, j, first_row, second_col]),
            np.maximum(self._tables[i, j, second_row, first_col], self._tables[i, j, second_row, second_col]),
        )
        return np.where(empty, np.float32(-np.inf), found)


def _doubled(cells: Float32[np.ndarray, "r c"], axis: int) -> list[Float32[np.ndarray, "r c"]]:
    """Maxima over 1, 2, 4, ... cells along an axis, beginning at each; garbage where they would stick out."""
    levels = [cells]
    while 2 ** len(levels) <= cells.shape[axis]:
        last = levels[-1]
        levels.append(np.maximum(last, np.roll(last, -(2 ** (len(levels) - 1)), axis=axis)))
    return levels


def _log2(counts: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Largest i with 2^i <= count."""
    return np.frexp(counts.astype(np.float64))[1].astype(np.int64) - 1


def _box_corners(model: mujoco.MjModel, geoms: Int[np.ndarray, " n"]) -> Float64[np.ndarray, "n 8 3"]:
    """Corners in the world of the boxes about geoms that stand still [m]."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    signs = np.array(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0])).reshape(3, 8).T
    boxes = model.geom_aabb[geoms]
    # A little larger, because GL places vertices in single precision.
    local = boxes[:, None, :3] + signs * (boxes[:, None, 3:] + 1e-4)
    return np.einsum("nij,nkj->nki", data.geom_xmat[geoms].reshape(-1, 3, 3), local) + data.geom_xpos[geoms][:, None]


def _has_glass(model: mujoco.MjModel, geoms: Int[np.ndarray, " n"]) -> bool:
    """True if any of the geoms, or a texture of the model, may be seen through."""
    materials = model.geom_matid[geoms]
    opacity = np.where(materials >= 0, model.mat_rgba[materials, 3] if model.nmat else 1.0, model.geom_rgba[geoms, 3])
    return bool((opacity < 1.0).any() or (model.tex_nchannel == 4).any())
