"""The growing mesh in a parallel projection, seen steeply from the south; drawn without a renderer.

Faces are split into points closer than a pixel, and a depth buffer keeps the nearest one. Only what is new is drawn for
a frame, so 500 frames of a house take a second.
"""

import math

import numpy as np
from jaxtyping import Float, Int, UInt8

from anm_mj.replay.surface import GrowingMesh

TILT_RAD = math.radians(32.0)
"""Angle between the view and the vertical."""
TO_VIEWER = np.array([0.0, -math.sin(TILT_RAD), math.cos(TILT_RAD)])
POINTS_PER_PIXEL = 1.3
"""Points along a pixel's side."""
SHADE = 0.45
"""Share of a face's brightness that depends on the light."""
LIGHT = np.array([0.35, -0.55, 0.75])
MARGIN_M = 0.4
"""Around what a picture shows [m]."""


def project(points_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
    """World points [m] in the plane of the picture: to the right and up [m]."""
    x, y, z = np.asarray(points_m, np.float64).T
    return np.stack([x, y * math.cos(TILT_RAD) + z * math.sin(TILT_RAD)], axis=1)


def square_around(points_m: Float[np.ndarray, "n 2"], side_px: int) -> tuple[Float[np.ndarray, "2"], float]:
    """Lower left corner [m] and metres per pixel of a square picture that shows points with a margin."""
    low, high = points_m.min(axis=0) - MARGIN_M, points_m.max(axis=0) + MARGIN_M
    metres_per_px = float(max(high - low)) / side_px
    return (low + high) / 2.0 - side_px * metres_per_px / 2.0, metres_per_px


class ObliqueView:
    """The square picture of a mesh as it grows."""

    def __init__(self, mesh: GrowingMesh, side_px: int, background: tuple[int, ...]) -> None:
        self._image = np.full((side_px, side_px, 3), background, np.uint8)
        self._nearest = np.full(side_px * side_px, -np.inf, np.float32)
        self._mesh, self._drawn = mesh, 0
        self._low_m, self._metres_per_px = square_around(project(mesh.vertices_m), side_px)

    def place_px(self, points_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        """World points [m] in the picture, from its lower left corner."""
        return (project(points_m) - self._low_m) / self._metres_per_px

    def at(self, frame: int) -> UInt8[np.ndarray, "rows cols 3"]:
        """The picture as of a frame, a view of an array that changes; to be asked for in order."""
        last = int(self._mesh.face_count[frame])
        # In parts, because a single frame may bring a million points.
        for first in range(self._drawn, last, 20_000):
            self._draw(self._mesh.faces[first : min(first + 20_000, last)])
        self._drawn = max(self._drawn, last)
        return self._image

    def _draw(self, faces: Int[np.ndarray, "f 3"]) -> None:
        corners = self._mesh.vertices_m[faces].astype(np.float64)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        # What looks away from the viewer is left out, so that near walls do not hide a room.
        shown = normal @ TO_VIEWER > 0.02
        corners, faces, normal = corners[shown], faces[shown], normal[shown]
        if not len(faces):
            return
        light = 1.0 - SHADE + SHADE * np.clip(normal @ (LIGHT / np.linalg.norm(LIGHT)), 0.0, 1.0)
        rgb = self._mesh.rgb[faces].mean(axis=1) * light[:, None]
        side_px = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1) / self._metres_per_px
        parts = np.clip(np.ceil(side_px * POINTS_PER_PIXEL), 1, 60).astype(np.int64)
        for count in np.unique(parts):
            those = parts == count
            self._splat(_split(corners[those], int(count)), rgb[those])

    def _splat(self, points_m: Float[np.ndarray, "f k 3"], rgb: Float[np.ndarray, "f 3"]) -> None:
        num_points = points_m.shape[1]
        flat = points_m.reshape(-1, 3)
        rows, cols = self._image.shape[:2]
        place = np.floor(self.place_px(flat)).astype(np.int64)
        col, row = place[:, 0], rows - 1 - place[:, 1]
        near = (flat @ TO_VIEWER).astype(np.float32)
        inside = np.flatnonzero((col >= 0) & (col < cols) & (row >= 0) & (row < rows))
        pixel, near, face = (row * cols + col)[inside], near[inside], inside // num_points
        # The nearest point of each pixel comes last, and stays.
        order = np.argsort(near, kind="stable")
        order = order[near[order] > self._nearest[pixel[order]]]
        self._nearest[pixel[order]] = near[order]
        self._image.reshape(-1, 3)[pixel[order]] = rgb[face[order]]


def _split(corners_m: Float[np.ndarray, "f 3 3"], count: int) -> Float[np.ndarray, "f k 3"]:
    """Points of an even lattice on each triangle, its corners included."""
    a, b = np.mgrid[: count + 1, : count + 1]
    inside = a + b <= count
    weights = np.stack([a[inside], b[inside], count - a[inside] - b[inside]], axis=1) / count
    return np.einsum("kc,fcd->fkd", weights, corners_m)
