"""Rays of single pixels of depth frames that are never rendered."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32

from anm_mj.frames import pose_matrix
from anm_mj.geometry.polyline import NUM_HEADINGS
from anm_mj.ground_truth.reduced_depth import MAX_DEPTH_M, kept_pixels
from anm_mj.types import TURN_STEP_RAD, Intrinsics, Pose2
from anm_mj.utils.raycast import RayCaster

_ROUNDING_RAD = 1e-6
"""An image as wide as a whole number of turns shows what is at its rim [rad]."""
_Points = Float32[np.ndarray, "n 3"]
_Yaws = Int[np.ndarray, " n"]


@dataclass(frozen=True)
class CameraExtrinsics:
    """A camera and its pose on the robot's base."""

    intrinsics: Intrinsics
    """Of the original, unreduced image."""
    T_base_camera: Float[np.ndarray, "4 4"]
    """Camera to base; camera axes x right, y down, z forward."""
    range_m: float = MAX_DEPTH_M
    """Depth beyond this does not count [m]: that of the protocol, or the sensor's range where it is shorter."""

    @classmethod
    def of_view(
        cls, intrinsics: Intrinsics, T_world_camera: Float[np.ndarray, "4 4"], pose: Pose2, range_m: float = MAX_DEPTH_M
    ) -> CameraExtrinsics:
        """Extrinsics from one observation and the intrinsics of the original, unreduced image; OpenCV's camera axes."""
        return cls(intrinsics, np.linalg.inv(pose_matrix(pose)) @ T_world_camera, min(range_m, MAX_DEPTH_M))


class PixelRays:
    """Casts rays of pixels as the protocol evaluates them: 128 x 128, whole millimetres, within the camera's range. Yaw
    number 0 is ``yaw_rad``; the others follow by the robot's turns.
    """

    def __init__(self, caster: RayCaster, camera: CameraExtrinsics, yaw_rad: float = 0.0) -> None:
        self._caster = caster
        self._camera = camera.intrinsics
        self._range_m = camera.range_m
        self._rows, self._cols = kept_pixels(camera.intrinsics.height), kept_pixels(camera.intrinsics.width)
        turns = [Pose2(0.0, 0.0, yaw_rad + k * TURN_STEP_RAD) for k in range(NUM_HEADINGS)]
        T_world_camera = np.stack([pose_matrix(pose) @ camera.T_base_camera for pose in turns]).astype(np.float32)
        self._rotation = np.ascontiguousarray(T_world_camera[:, :3, :3])
        self._offset_m = np.ascontiguousarray(T_world_camera[:, :3, 3])
        self._ahead_rad = math.atan2(float(self._rotation[0, 1, 2]), float(self._rotation[0, 0, 2]))
        most = int(self._half_width_rad() / TURN_STEP_RAD)
        self.yaws_aside = np.arange(-most, most + 1, dtype=np.int32)
        """Turns away from a target ahead that keep it in the image."""

    def _half_width_rad(self) -> float:
        """Largest angle, seen from above, between the camera's axis and a ray of its image."""
        k, rotation = self._camera, self._rotation[0].astype(np.float64)
        for x, y, z in (rotation[2], -rotation[2]):
            # An image that shows what is straight above or below shows all directions.
            if z > 0.0 and 0.0 <= k.fx * x + k.cx * z < k.width * z and 0.0 <= k.fy * y + k.cy * z < k.height * z:
                return math.pi
        u, v = (np.array([0.0, k.width]) - k.cx) / k.fx, (np.array([0.0, k.height]) - k.cy) / k.fy
        corners = rotation @ np.stack([np.tile(u, 2), np.repeat(v, 2), np.ones(4)])
        aside_rad = np.arctan2(corners[1], corners[0]) - self._ahead_rad
        return float(np.abs((aside_rad + math.pi) % math.tau - math.pi).max()) + _ROUNDING_RAD

    @property
    def eye_z_m(self) -> float:
        """Height of the camera above the floor [m]."""
        return float(self._offset_m[0, 2])

    def yaw_towards(self, delta_xy_m: Float32[np.ndarray, "n 2"]) -> Int32[np.ndarray, " n"]:
        """Index of the yaw at which the camera looks most nearly along each planar direction."""
        azimuth_rad = np.arctan2(delta_xy_m[:, 1], delta_xy_m[:, 0]) - np.float32(self._ahead_rad)
        return np.rint(azimuth_rad / np.float32(TURN_STEP_RAD)).astype(np.int32) % np.int32(NUM_HEADINGS)

    def in_image(
        self, targets_m: _Points, place_m: Float32[np.ndarray, "2"] | Float32[np.ndarray, "n 2"], yaw: _Yaws
    ) -> Bool[np.ndarray, " n"]:
        """Whether targets [m] lie within the image at a place (one, or one each) and a yaw (one each)."""
        origin = self._offset_m[yaw]
        origin[:, :2] += place_m
        x, y, z = np.einsum("nji,nj->ni", self._rotation[yaw], targets_m - origin).T
        camera = self._camera
        column, row = x * camera.fx + camera.cx * z, y * camera.fy + camera.cy * z
        inside = (column >= 0.0) & (column < camera.width * z) & (row >= 0.0) & (row < camera.height * z)
        return inside & (z > 0.0)

    def hits(self, targets_m: _Points, places_m: Float32[np.ndarray, "n 2"], yaw: _Yaws) -> _Points:
        """Depth point of the pixel nearest to each target, in the frame at a place and a yaw [m]; infinite without one.

        Targets and places of the base are in the world; targets behind the camera have no depth point.
        """
        origin = self._offset_m[yaw]
        origin[:, :2] += places_m
        in_camera = np.einsum("nji,nj->ni", self._rotation[yaw], targets_m - origin)
        ahead = np.flatnonzero(in_camera[:, 2] > 0.0)
        x, y, z = in_camera[ahead].T
        camera = self._camera
        direction = np.empty((len(ahead), 3), np.float32)
        column = _kept(x / z * camera.fx + camera.cx, self._cols, camera.width)
        row = _kept(y / z * camera.fy + camera.cy, self._rows, camera.height)
        direction[:, 0] = (column + 0.5 - camera.cx) / camera.fx
        direction[:, 1] = (row + 0.5 - camera.cy) / camera.fy
        direction[:, 2] = 1.0
        # Directions have z = 1 in the camera, so lengths are planar depths.
        direction = np.einsum("nij,nj->ni", self._rotation[yaw[ahead]], direction)
        depth_m = np.minimum(self._caster.lengths(origin[ahead], direction), np.float32(2.0 * MAX_DEPTH_M))
        depth_m = np.rint(depth_m * 1000.0) / 1000.0
        points = np.full((len(targets_m), 3), np.inf, np.float32)
        in_range = (depth_m <= self._range_m)[:, None]
        points[ahead] = np.where(in_range, origin[ahead] + depth_m[:, None] * direction, np.inf)
        return points


def _kept(coordinate_px: Float32[np.ndarray, " n"], kept: Int[np.ndarray, " k"], size_px: int) -> Int[np.ndarray, " n"]:
    """The kept column (or row) whose centre is nearest to a coordinate; the outermost one beyond the border."""
    index = np.rint((coordinate_px - 0.5) * (len(kept) / size_px))
    return kept[np.clip(index, 0, len(kept) - 1).astype(np.int64)]
