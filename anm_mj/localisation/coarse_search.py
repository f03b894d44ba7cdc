"""Where in the map a frame could have been taken: all places and headings, scored by the distance to occupied voxels.

The field's own basin is small (10 cm, 4 degrees), so a camera that is lost is first looked for here. The camera's
height and tilt are known; what is searched are x, y and the heading. A point scores by its distance to the nearest
occupied voxel, truncated; a point in unknown space by a constant.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float32, Int64
from scipy import ndimage
from skimage.measure import block_reduce

from anm_mj.frames import pose_matrix
from anm_mj.localisation.localisation_config import RelocalisationConfig
from anm_mj.mapping.alignment import FramePoints
from anm_mj.types import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, Pose2
from anm_mj.utils.arrays import values_at

_SAME_M, _SAME_RAD = 0.1, math.radians(6.0)
"""Heights and tilts of a camera that are nearer to each other are alike."""


@dataclass(frozen=True)
class DistanceGrid:
    """Truncated distance to the nearest occupied voxel, with a margin about the map."""

    distance_m: Float32[np.ndarray, "layers rows cols"]
    origin_m: Float[np.ndarray, "3"]
    """Centre of cell [0, 0, 0] in the world, x, y, z [m]."""
    cell_m: float
    open: Bool[np.ndarray, "rows cols"]
    """Where a camera can be: free at its height, nothing occupied below."""


def distance_grid(
    grid: OccupancyGrid,
    camera_height_m: float,
    floor_m: float,
    margin_m: float,
    config: RelocalisationConfig,
    other: DistanceGrid | None = None,
) -> DistanceGrid:
    """The distance grid of a map, for cameras at a height above z = 0 [m].

    Their stand needs free space above the world z of ``floor_m``; points reach by ``margin_m`` beyond the map [m].
    ``other`` is the grid of the same map for another height, whose distances are the same; None = there is none.
    """
    pool = max(1, round(config.cell_m / grid.resolution_m))
    pad = math.ceil(margin_m / (pool * grid.resolution_m))
    at = min(max(grid.layer_of(camera_height_m), 0), grid.state.shape[0] - 1)
    below = grid.state[grid.layers_between(floor_m, camera_height_m)]
    free = (grid.state[at] == FREE) & ~(below == OCCUPIED).any(axis=0)
    is_open = np.pad(block_reduce(free, pool, np.any), pad)
    if other is not None:
        return replace(other, open=is_open)
    edge = pool * grid.resolution_m
    occupied = block_reduce(grid.state == OCCUPIED, pool, np.any)
    unknown = block_reduce(grid.state == UNKNOWN, pool, np.all, cval=True)
    distance = np.full(occupied.shape, config.truncation_m, np.float32)
    if occupied.any():
        found = np.asarray(ndimage.distance_transform_edt(~occupied)) * edge
        np.minimum(distance, found, out=distance)
    # Next to a surface the unknown begins; what lies deeper says nothing.
    distance[unknown] = np.minimum(distance[unknown], config.unknown_m)
    distance = np.pad(distance, pad, constant_values=config.unknown_m)
    return DistanceGrid(distance, grid.origin_m + 0.5 * edge - pad * edge, edge, is_open)


def level(T_world_camera: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
    """The same height and tilt at x = y = 0 with a heading of 0, which is that of the camera's axis in the plane."""
    yaw = heading(T_world_camera)
    out = turned(-yaw) @ T_world_camera
    out[:2, 3] = 0.0
    return out


def distinct_tilts(poses: Sequence[Float[np.ndarray, "4 4"]]) -> list[Float[np.ndarray, "4 4"]]:
    """Heights and tilts of cameras, as of :func:`level`, no two alike, the most frequent first. The earliest stands for
    those that are like it, and comes before equally frequent ones.
    """
    left = np.array([level(each) for each in poses]).reshape(-1, 4, 4)
    kept, counts = list[Float[np.ndarray, "4 4"]](), list[int]()
    while len(left):
        cosine = (np.einsum("ij,nij->n", left[0, :3, :3], left[:, :3, :3]) - 1.0) / 2.0
        alike = (np.abs(left[:, 2, 3] - left[0, 2, 3]) <= _SAME_M) & (cosine >= math.cos(_SAME_RAD))
        # It is like itself, whatever a rotation that is not quite one says.
        alike[0] = True
        kept.append(left[0])
        counts.append(int(alike.sum()))
        left = left[~alike]
    return [kept[index] for index in np.argsort(np.negative(counts), kind="stable")]


def heading(T_world_camera: Float[np.ndarray, "4 4"]) -> float:
    """Heading of the camera [rad]: of its axis in the plane, or, where it looks up or down, of its picture's top."""
    ahead = T_world_camera[:2, 2]
    if math.hypot(*ahead) < math.sin(math.radians(10.0)):
        ahead = -T_world_camera[:2, 1] if T_world_camera[2, 2] < 0.0 else T_world_camera[:2, 1]
    return math.atan2(ahead[1], ahead[0])


def turned(yaw_rad: float) -> Float[np.ndarray, "4 4"]:
    """The rotation about world z."""
    return pose_matrix(Pose2(0.0, 0.0, yaw_rad))


def placed(T_level: Float[np.ndarray, "4 4"], x_m: float, y_m: float, yaw_rad: float) -> Float[np.ndarray, "4 4"]:
    """A camera of that height and tilt at a place and heading."""
    out = turned(yaw_rad) @ T_level
    out[0, 3], out[1, 3] = x_m, y_m
    return out


def search(
    points: FramePoints, T_level: Float[np.ndarray, "4 4"], grid: DistanceGrid, config: RelocalisationConfig
) -> list[tuple[float, Float[np.ndarray, "4 4"]]]:
    """The best places and headings of a frame, by mean truncated distance [m] of some of its points, best first.
    ``T_level`` has the height and tilt of the camera.
    """
    every = max(1, round(config.spacing_m / grid.cell_m))
    rows, cols = np.nonzero(grid.open)
    kept = (rows % every == 0) & (cols % every == 0)
    rows, cols = rows[kept], cols[kept]
    if not len(rows):
        return []
    coarse = points.about(config.search_points)
    yaws = np.arange(config.headings) * (math.tau / config.headings)
    score = np.stack([_scores(coarse, T_level, yaw, rows, cols, grid) for yaw in yaws.tolist()])
    xy = grid.origin_m[:2] + np.stack((cols, rows), axis=1) * grid.cell_m
    fine = points.about(config.refine_points)
    found: list[tuple[float, float, float, float]] = []
    taken: list[tuple[float, float, float]] = []
    # Twice as many as wanted: refinement changes the order.
    for best in np.argsort(score, axis=None)[: 60 * config.candidates].tolist():
        k, place = divmod(best, len(rows))
        pose = float(xy[place, 0]), float(xy[place, 1]), float(yaws[k])
        if any(_is_same(pose, other, 1.5 * config.spacing_m, 2.0 * math.tau / config.headings) for other in taken):
            continue
        taken.append(pose)
        found.append(refined(fine, T_level, pose, grid, config))
        if len(taken) >= 2 * config.candidates:
            break
    found.sort()
    return [(value, placed(T_level, x, y, yaw)) for value, x, y, yaw in found[: config.candidates]]


def refined(
    points: FramePoints,
    T_level: Float[np.ndarray, "4 4"],
    pose: tuple[float, float, float],
    grid: DistanceGrid,
    config: RelocalisationConfig,
) -> tuple[float, float, float, float]:
    """The best of a finer lattice about a place and heading: score [m], x [m], y [m], heading [rad]."""
    side = np.arange(-2, 3)
    turns = pose[2] + side * (math.tau / config.headings / 4.0)
    dy, dx = (each.ravel() * (config.spacing_m / 4.0) for each in np.meshgrid(side, side, indexing="ij"))
    aside = np.stack((dx, dy, np.zeros(len(dx))), axis=1) / grid.cell_m
    best = (math.inf, *pose)
    for yaw in turns.tolist():
        arms = points.camera_m @ (turned(yaw) @ T_level)[:3, :3].T
        at = (arms + np.array([pose[0], pose[1], T_level[2, 3]]) - grid.origin_m) / grid.cell_m
        values = _values(grid, at + aside[:, None]).mean(axis=1)
        k = int(np.argmin(values))
        if values[k] < best[0]:
            best = (float(values[k]), pose[0] + float(dx[k]), pose[1] + float(dy[k]), yaw)
    return best


def _scores(
    points: FramePoints,
    T_level: Float[np.ndarray, "4 4"],
    yaw: float,
    rows: Int64[np.ndarray, " m"],
    cols: Int64[np.ndarray, " m"],
    grid: DistanceGrid,
) -> Float32[np.ndarray, " m"]:
    """Mean distance of a frame's points at some cells with one heading [m]."""
    arms = points.camera_m @ (turned(yaw) @ T_level)[:3, :3].T
    layers, height, width = grid.distance_m.shape
    layer = np.rint((arms[:, 2] + T_level[2, 3] - grid.origin_m[2]) / grid.cell_m).astype(np.int64)
    offset = np.rint(arms[:, :2] / grid.cell_m).astype(np.int64)
    inside = (layer >= 0) & (layer < layers)
    flat = grid.distance_m.reshape(-1)
    total = np.zeros(len(rows), np.float32)
    for (dx, dy), z in zip(offset[inside].tolist(), layer[inside].tolist(), strict=True):
        # The margin about the map is as wide as the points reach.
        total += flat[(z * height + rows + dy) * width + cols + dx]
    return total / max(1, int(inside.sum()))


def _values(grid: DistanceGrid, at: Float[np.ndarray, "*n 3"]) -> Float32[np.ndarray, "*n"]:
    """Distances at places given in cells, x, y, z."""
    return values_at(grid.distance_m, np.rint(at).astype(np.int64)[..., ::-1], grid.distance_m[0, 0, 0])


def _is_same(
    one: tuple[float, float, float], other: tuple[float, float, float], distance_m: float, angle_rad: float
) -> bool:
    apart = abs(math.remainder(one[2] - other[2], math.tau))
    return math.hypot(one[0] - other[0], one[1] - other[1]) < distance_m and apart < angle_rad
