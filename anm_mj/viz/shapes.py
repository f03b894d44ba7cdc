"""Objects of the live view for meshcat; in the world frame [m] unless stated otherwise."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float
from meshcat.geometry import (
    LineBasicMaterial,
    LineSegments,
    Mesh,
    MeshBasicMaterial,
    MeshLambertMaterial,
    Object,
    PointsGeometry,
    TriangularMeshGeometry,
)

from anm_mj.types import Intrinsics, Region, VoronoiGraph

CEILING_CUT_M = 2.0
"""Views and replays omit faces above this height, for a look into the rooms from above [m]."""
GRAPH_HEIGHT_M, TRAJECTORY_HEIGHT_M, PATH_HEIGHT_M = 0.03, 0.04, 0.05
"""Heights of the bands above the floor, all different against flickering [m]."""
GRAPH_WIDTH_M, TRAJECTORY_WIDTH_M, PATH_WIDTH_M = 0.025, 0.045, 0.05
FRONT = 0
"""three.js: render front faces only, so that near walls do not hide a room."""
CHASSIS_HEIGHT_M, MAST_RADIUS_M = 0.15, 0.02
"""Size of the drawn robot, whose radius is that of its footprint [m]."""
FRUSTUM_DEPTH_M = 0.6


def neural_surface(mesh: trimesh.Trimesh) -> Object:
    """The coloured mesh of the neural map below the ceiling cut."""
    vertices = np.asarray(mesh.vertices, dtype=np.float32)
    faces = np.asarray(mesh.faces)
    kept = faces[(vertices[faces, 2] < CEILING_CUT_M).all(axis=1)]
    colours = np.asarray(mesh.visual.vertex_colors, dtype=np.float32)[:, :3] / 255.0  # type: ignore[union-attr]
    return Mesh(TriangularMeshGeometry(vertices, kept, colours), _lit(vertexColors=True, side=FRONT))


def ribbon(xy_m: Float[np.ndarray, "n 2"], height_m: float, width_m: float, colour: int) -> Object:
    """A flat band along a polyline."""
    return bands(np.stack([xy_m[:-1], xy_m[1:]], axis=1), height_m, width_m, colour)


def graph_bands(graph: VoronoiGraph, colour: int) -> Object:
    """The edges of the Voronoi graph as flat bands."""
    return bands(graph.vertex_xy_m[graph.edges], GRAPH_HEIGHT_M, GRAPH_WIDTH_M, colour)


def bands(ends_xy_m: Float[np.ndarray, "m 2 2"], height_m: float, width_m: float, colour: int) -> Object:
    """Flat bands between pairs of points; browsers ignore the width of lines."""
    starts, ends = ends_xy_m[:, 0], ends_xy_m[:, 1]
    length = np.linalg.norm(ends - starts, axis=1, keepdims=True)
    along = (ends - starts) / np.where(length > 0.0, length, 1.0) * width_m / 2.0
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1)
    # Half a width longer at both ends, to close gaps at bends.
    starts, ends = starts - along, ends + along
    corners = np.stack([starts - aside, starts + aside, ends + aside, ends - aside], axis=1)
    vertices = np.full((4 * len(corners), 3), height_m, dtype=np.float32)
    vertices[:, :2] = corners.reshape(-1, 2)
    first = 4 * np.arange(len(corners))[:, None]
    faces = np.concatenate([first + np.array([0, 3, 1]), first + np.array([1, 3, 2])])
    # A basic material ignores light, so its colour is constant.
    plain: Any = MeshBasicMaterial(color=colour)
    return Mesh(TriangularMeshGeometry(vertices, faces), plain)


def region_marks(regions: Sequence[Region], colour: int) -> Object:
    """A ball per region of interest, its size by the number of members, with a peg along its normal."""
    most = max((region.num_members for region in regions), default=1)
    parts = []
    for region in regions:
        ball = trimesh.creation.icosphere(subdivisions=1, radius=region_radius_m(region.num_members, most))
        parts.append(ball.apply_translation(region.centre_m))
        peg = np.stack([region.centre_m, region.centre_m + 0.3 * region.normal])
        parts.append(trimesh.creation.cylinder(radius=0.012, segment=peg, sections=6))
    return _solid(parts, colour)


def region_radius_m(num_members: int, most: int) -> float:
    """Radius of a region's ball [m], from its number of members and that of the largest region."""
    return 0.06 + 0.08 * (num_members / most) ** 0.5


def chassis_height_m(camera_height_m: float) -> float:
    """Height of the drawn base [m]: below the camera."""
    return min(CHASSIS_HEIGHT_M, 0.8 * camera_height_m)


def robot_body(radius_m: float, camera_height_m: float, colour: int) -> Object:
    """A round base with a mast, in base axes."""
    top_m = chassis_height_m(camera_height_m)
    chassis = trimesh.creation.cylinder(radius_m, top_m, sections=32)
    chassis.apply_translation([0.0, 0.0, top_m / 2.0 + 0.02])
    mast = trimesh.creation.cylinder(MAST_RADIUS_M, segment=[[0.0, 0.0, top_m], [0.0, 0.0, camera_height_m]])
    head = trimesh.creation.box([0.06, 0.12, 0.06]).apply_translation([0.0, 0.0, camera_height_m])
    return _solid([chassis, mast, head], colour)


def frustum_corners(intrinsics: Intrinsics) -> Float[np.ndarray, "4 3"]:
    """Far corners of the drawn frustum in camera axes [m]: top left, top right, bottom right, bottom left."""
    u = (np.array([0.0, intrinsics.width, intrinsics.width, 0.0]) - intrinsics.cx) / intrinsics.fx
    v = (np.array([0.0, 0.0, intrinsics.height, intrinsics.height]) - intrinsics.cy) / intrinsics.fy
    return FRUSTUM_DEPTH_M * np.stack([u, v, np.ones(4)], axis=1)


def camera_frustum(intrinsics: Intrinsics, colour: int) -> Object:
    """The view frustum in camera axes (x right, y down, z forward)."""
    corners = frustum_corners(intrinsics)
    spokes = np.stack([np.zeros((4, 3)), corners], axis=1)
    frame = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
    ends = np.concatenate([spokes, frame]).reshape(-1, 3).astype(np.float32)
    thin: Any = LineBasicMaterial(color=colour)
    return LineSegments(PointsGeometry(ends.T), thin)


def target_mark(colour: int) -> Object:
    """An upright pin on the floor at the origin."""
    pin = trimesh.creation.cone(radius=0.08, height=0.5, sections=16)
    pin.apply_transform(np.diag([1.0, -1.0, -1.0, 1.0])).apply_translation([0.0, 0.0, 0.5])
    return _solid([pin], colour)


def _solid(parts: Sequence[trimesh.Trimesh], colour: int) -> Object:
    whole = trimesh.util.append_faces([part.vertices for part in parts], [part.faces for part in parts])
    return Mesh(TriangularMeshGeometry(*whole), _lit(color=colour))


def _lit(**properties: Any) -> Any:
    # Without a type: meshcat's annotations know one material only.
    return MeshLambertMaterial(**properties)
