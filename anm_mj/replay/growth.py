"""When each part of the final mesh was first seen, so that a replay can let the mesh grow.

The mesh is that of the finished map. A vertex appears with the first frame whose depth has a surface within a tolerance
of it. So nothing has to be stored during the run, and a run of an older version grows as well.
"""

import numpy as np
from jaxtyping import Float, Float32, Int
from scipy.spatial import KDTree

from anm_mj.io.read_run import Run
from anm_mj.types import Intrinsics
from anm_mj.utils.progress import Progress, unheard

TOLERANCE_M, TOLERANCE_SHARE = 0.06, 0.02
"""A vertex is seen where depth differs from its own by less than this [m], plus this share of it."""


def first_seen(
    run: Run, vertices_m: Float[np.ndarray, "v 3"], on_progress: Progress = unheard
) -> Int[np.ndarray, " v"]:
    """Index of the frame that first saw each vertex; a vertex that none saw takes that of its nearest neighbour.

    In a continued run, what none of its frames saw was there from the start. Depth and believed poses of the run are
    read. Raises RunFolderError if a depth image is missing or damaged.
    """
    points = np.asarray(vertices_m, np.float32)
    first = np.full(len(points), -1)
    waiting = np.arange(len(points))
    for index, frame in enumerate(run.frames):
        if len(waiting):
            depth_m = run.depth_mm(frame).astype(np.float32) / 1000.0
            seen = _seen(points[waiting], depth_m, run.intrinsics, frame.T_world_camera)
            first[waiting[seen]] = index
            waiting = waiting[~seen]
        on_progress(index + 1, len(run.frames))
    if len(waiting) and run.manifest.get("continued_from"):
        first[waiting] = 0
    elif len(waiting):
        found = first >= 0
        first[waiting] = first[found][KDTree(points[found]).query(points[waiting])[1]] if found.any() else 0
    return first


def _seen(
    points_m: Float32[np.ndarray, "n 3"],
    depth_m: Float32[np.ndarray, "rows cols"],
    intrinsics: Intrinsics,
    T_world_camera: Float[np.ndarray, "4 4"],
) -> np.ndarray:
    """Which points a frame has a surface at."""
    rotation, origin = T_world_camera[:3, :3].astype(np.float32), T_world_camera[:3, 3].astype(np.float32)
    x, y, z = ((points_m - origin) @ rotation).T
    safe_z = np.where(z > 0.05, z, np.float32(1.0))
    rows, cols = depth_m.shape
    col = np.floor((intrinsics.fx * x / safe_z + intrinsics.cx) * (cols / intrinsics.width)).astype(np.int64)
    row = np.floor((intrinsics.fy * y / safe_z + intrinsics.cy) * (rows / intrinsics.height)).astype(np.int64)
    inside = (z > 0.05) & (col >= 0) & (col < cols) & (row >= 0) & (row < rows)
    seen = np.zeros(len(points_m), bool)
    measured = depth_m[row[inside], col[inside]]
    seen[inside] = (measured > 0.0) & (np.abs(measured - z[inside]) < TOLERANCE_M + TOLERANCE_SHARE * z[inside])
    return seen
