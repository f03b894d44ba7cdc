"""Frustum and occlusion culling with bit-identical images.

A software renderer spends its time on triangles, not on pixels, so it gets neither meshes outside the field of view nor
occluded ones. Earlier images predict occlusion, and the depth of the new image verifies it: a skipped mesh is occluded
if its whole bounding box lies behind the depth without the mesh. If one is not, it is added and the image is rendered
again, so a wrong prediction only costs time.
"""

import mujoco
import numpy as np
from jaxtyping import Float, Float32, Float64, Int

from anm_mj.scene.chunks import MIN_TRIANGLES
from anm_mj.sim.camera import VISIBLE_GROUPS
from anm_mj.types import Intrinsics

_BLOCK_PX = 8
"""Side of the pixel blocks of the table of farthest depths [px]."""
_GUARD_PX = 8
"""Prediction: a mesh stays occluded in the next image if a shift by this much would not reveal it [px]."""
_STALE_M = 0.3
"""Camera motion after which a prediction of occlusion expires [m]."""
_DEPTH_MARGIN = 1e-4
"""Least distance of a box behind its occluder, relative to its depth: ten times the error of a depth buffer."""


def is_worth_culling(model: mujoco.MjModel) -> bool:
    """True if a model has enough triangles for culling to save time."""
    meshes = model.geom_dataid[model.geom_type == mujoco.mjtGeom.mjGEOM_MESH]
    return int(model.mesh_facenum[meshes].sum()) >= MIN_TRIANGLES


class Culling:
    """Selects the meshes that a camera must render."""

    def __init__(self, model: mujoco.MjModel, intrinsics: Intrinsics, *, znear_m: float):
        """Compute bounding boxes of the static meshes, which must not change; all other geoms are always rendered.
        ``znear_m`` is the distance of the near plane [m].
        """
        still = (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH) & (model.body_weldid[model.geom_bodyid] == 0)
        self._geoms = np.flatnonzero(still & np.isin(model.geom_group, VISIBLE_GROUPS))
        self._corners_m = _box_corners(model, self._geoms)
        self._intrinsics = intrinsics
        self._znear_m = znear_m
        # Glass occludes nothing.
        self._opaque = not _has_glass(model, self._geoms)
        self._hidden = np.zeros(len(self._geoms), dtype=bool)
        self._judged_at_m = np.zeros((len(self._geoms), 3))

    def start_image(self, T_world_camera: Float[np.ndarray, "4 4"]) -> None:
        """Project all meshes into a new image and predict the occluded ones; camera axes x right, y down, z forward."""
        self._position_m = T_world_camera[:3, 3]
        corners = (self._corners_m - self._position_m) @ T_world_camera[:3, :3]
        z = corners[:, :, 2]
        k = self._intrinsics
        # Half a pixel more than the image, against rounding errors.
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
        # A box that contains the camera may appear anywhere.
        extent_px[~whole] = (0.0, 0.0, k.width, k.height)
        self._extent_px = np.clip(extent_px, -1e6, 1e6)
        moved_m = np.abs(self._judged_at_m - self._position_m).max(axis=1)
        self._skipped = self._in_view & self._hidden & (moved_m < _STALE_M)

    def skipped_geoms(self) -> Int[np.ndarray, " n"]:
        """Ids of the geoms to skip in this image."""
        return self._geoms[~self._in_view | self._skipped]

    def accept(self, depth_m: Float32[np.ndarray, "h w"]) -> bool:
        """Verify an image by its planar depth [m], NaN without a hit. False if some skipped meshes may be visible,
        which ``skipped_geoms`` then omits.
        """
        if not self._opaque:
            return True
        in_view = np.flatnonzero(self._in_view)
        farthest = _FarthestDepth(depth_m)
        nearest_m = self._nearest_m[in_view] * (1.0 - _DEPTH_MARGIN)
        skipped = self._skipped[in_view]
        if skipped.any():
            members = in_view[skipped]
            missing = members[nearest_m[skipped] <= farthest.within(self._extent_px[members], margin_px=1)]
            if len(missing):
                self._skipped[missing] = False
                return False
        self._hidden[in_view] = nearest_m > farthest.within(self._extent_px[in_view], margin_px=_GUARD_PX)
        self._judged_at_m[in_view] = self._position_m
        return True


class _FarthestDepth:
    """Farthest depth within many image rectangles at once."""

    def __init__(self, depth_m: Float32[np.ndarray, "h w"]):
        """Build a sparse table: maxima over blocks of 2^i by 2^j cells."""
        height, width = depth_m.shape
        rows, cols = -(-height // _BLOCK_PX), -(-width // _BLOCK_PX)
        padded = np.full((rows * _BLOCK_PX, cols * _BLOCK_PX), -np.inf, dtype=np.float32)
        padded[:height, :width] = np.where(np.isnan(depth_m), np.float32(np.inf), depth_m)
        cells = padded.reshape(rows, _BLOCK_PX, cols * _BLOCK_PX).max(axis=1)
        cells = cells.reshape(rows, cols, _BLOCK_PX).max(axis=2)
        self._size = np.array([cols, rows])
        self._tables = np.array([_doubled(level, axis=1) for level in _doubled(cells, axis=0)])

    def within(self, extent_px: Float64[np.ndarray, "n 4"], margin_px: int) -> Float32[np.ndarray, " n"]:
        """The farthest depth within u_min, v_min, u_max, v_max and a margin [m]; -inf outside the image."""
        first = np.floor((extent_px[:, :2] - margin_px) / _BLOCK_PX).astype(np.int64)
        last = np.floor((extent_px[:, 2:] + margin_px) / _BLOCK_PX).astype(np.int64)
        empty = ((last < 0) | (first >= self._size)).any(axis=1)
        first, last = np.clip(first, 0, self._size - 1), np.clip(last, 0, self._size - 1)
        level = _log2(last - first + 1)
        (col, row), (j, i), (col2, row2) = first.T, level.T, (last + 1 - (1 << level)).T
        corners = (self._tables[i, j, y, x] for y in (row, row2) for x in (col, col2))
        return np.where(empty, np.float32(-np.inf), np.maximum.reduce(list(corners)))


def _doubled(cells: Float32[np.ndarray, "r c"], axis: int) -> list[Float32[np.ndarray, "r c"]]:
    """Maxima over 1, 2, 4, ... cells along an axis from each cell on; undefined beyond the border."""
    levels = [cells]
    while 2 ** len(levels) <= cells.shape[axis]:
        last = levels[-1]
        levels.append(np.maximum(last, np.roll(last, -(2 ** (len(levels) - 1)), axis=axis)))
    return levels


def _log2(counts: Int[np.ndarray, "n 2"]) -> Int[np.ndarray, "n 2"]:
    return np.frexp(counts.astype(np.float64))[1].astype(np.int64) - 1


def _box_corners(model: mujoco.MjModel, geoms: Int[np.ndarray, " n"]) -> Float64[np.ndarray, "n 8 3"]:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    signs = np.array(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0])).reshape(3, 8).T
    boxes = model.geom_aabb[geoms]
    # Slightly enlarged: GL transforms vertices in single precision.
    local = boxes[:, None, :3] + signs * (boxes[:, None, 3:] + 1e-4)
    return np.einsum("nij,nkj->nki", data.geom_xmat[geoms].reshape(-1, 3, 3), local) + data.geom_xpos[geoms][:, None]


def _has_glass(model: mujoco.MjModel, geoms: Int[np.ndarray, " n"]) -> bool:
    materials = model.geom_matid[geoms]
    opacity = np.where(materials >= 0, model.mat_rgba[materials, 3] if model.nmat else 1.0, model.geom_rgba[geoms, 3])
    return bool((opacity < 1.0).any() or (model.tex_nchannel == 4).any())
