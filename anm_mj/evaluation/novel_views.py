"""Novel-view evaluation: renders a finished run's map at poses that its robot never took.

Poses are clear of obstacles, more than half a metre from the whole trajectory, and drawn at random from a seed. A view
counts only if the run observed at least half of its surface. All runs in a scene draw from the same candidates under
the same seed; each run is evaluated on the first ones that are novel to it.
"""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, UInt8
from PIL import Image
from scipy.spatial import KDTree

from anm_mj.evaluation.rerender import explored_scene, observe_at
from anm_mj.evaluation.view_quality import ViewsResult, compare_views, write_views
from anm_mj.frames import back_project
from anm_mj.ground_truth.reduced_depth import MAX_DEPTH_M
from anm_mj.io.explored_file import read_explored
from anm_mj.io.folder_hold import held
from anm_mj.io.read_run import Run, read_run
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.write import writing
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.scene.folder import Scene
from anm_mj.scene.navigable import is_clear, scene_area
from anm_mj.types import DEFAULT_FOOTPRINT, OCCUPIED, UNKNOWN, Observation, OccupancyGrid, Pose2
from anm_mj.utils.arrays import values_at
from anm_mj.utils.files import atomic_write
from anm_mj.utils.progress import Progress, unheard

NUM_VIEWS = 8
"""Default number of views."""
FAR_M = 0.5
"""Novel places are farther than this from the trajectory [m]."""
LEAST_OBSERVED = 50.0
"""Least observed share of a view's surface [%]."""
MAX_TRIED = 2000
"""Most candidate poses tried."""
SHOWN = 4
"""Views in the picture: true and rendered colour, true and rendered depth."""
SHOWN_DEPTH_M = 6.0
"""Depth drawn black [m]."""


def evaluate_novel_views(
    path: Path, views: int = NUM_VIEWS, seed: int = 0, scene: str | None = None, on_progress: Progress = unheard
) -> ViewsResult:
    """Evaluate a run's map on novel views.

    Writes ``novel_views.json`` (quality of each view and the means) and ``novel_views.png`` (the first views) into the
    run folder. There are fewer where the scene has not as many. ``seed`` is that of places and directions, ``scene``
    the present name or folder of the run's scene, if it has moved. Raises RunFolderError if the folder is no run,
    is being written or cannot be written, a file in it is damaged, or it explored another scene, SceneError if there is
    no such scene, and MapError if the map cannot be loaded.
    """
    path = RunFolder.open(path).path
    with held(path):
        record = read_run(path)
        world = explored_scene(record, scene)
        # What was observed is a matter of depth alone, or the quality of a map would decide on which views it is
        # evaluated.
        neural_map = NeuralMap.load(record.folder.map, geometry="occupancy")
        grid = neural_map.occupancy_grid()
        observed = (
            view for view in _novel_views(record, world, seed) if _observed_percent(grid, view) >= LEAST_OBSERVED
        )
        rows, pictures = list[dict[str, Any]](), []
        for view, rgb, depth_m, quality in compare_views(neural_map, islice(observed, views), views, on_progress):
            rows.append({"pose": view.pose, "observed_percent": _observed_percent(grid, view), "quality": quality})
            pictures.append(
                np.concatenate([view.rgb, rgb, _depth_picture(view.depth_m), _depth_picture(depth_m)], axis=1)
            )
        result = write_views(record.folder.novel_views, rows, seed=seed)
        if pictures:
            file = record.folder.novel_views_picture
            with writing(file), atomic_write(file) as partial:
                Image.fromarray(np.concatenate(pictures[:SHOWN])).save(partial, "PNG")
        return result


def candidate_poses(places_m: Float[np.ndarray, "n 2"], seed: int) -> list[Pose2]:
    """A pose at each place [m], in random order and in random directions; the same for the same seed."""
    rng = np.random.default_rng(seed)
    yaw_rad = rng.uniform(-np.pi, np.pi, len(places_m))
    return [
        Pose2(float(places_m[i, 0]), float(places_m[i, 1]), float(yaw_rad[i])) for i in rng.permutation(len(places_m))
    ]


def _novel_views(record: Run, world: Scene, seed: int) -> Iterator[Observation]:
    """The simulator's views at novel poses that are clear of obstacles."""
    trajectory = np.array([frame.true_pose.xy_m for frame in record.frames])
    if record.manifest.get("continued_from") and record.folder.explored.is_file():
        # The map also holds what the run before it saw.
        trajectory = np.concatenate([trajectory, read_explored(record.folder.explored).prior.poses[:, :2]])
    places = scene_area(world, DEFAULT_FOOTPRINT).places(1)
    is_novel = KDTree(trajectory).query(places)[0] > FAR_M
    novel = set(map(tuple, places[is_novel].tolist()))
    tried = (pose for pose in candidate_poses(places, seed) if (pose.x_m, pose.y_m) in novel)
    clear = (pose for pose in islice(tried, MAX_TRIED) if is_clear(world, pose, DEFAULT_FOOTPRINT))
    return observe_at(world, clear, record.intrinsics.width, record)


def _observed_percent(grid: OccupancyGrid, seen: Observation) -> float:
    """Share of a view's surface points within the sensor's range that lie in occupied voxels of the map [%]."""
    near = np.where(seen.depth_m <= MAX_DEPTH_M, seen.depth_m, np.nan).astype(np.float32)
    points = back_project(near, seen.intrinsics, seen.T_world_camera)
    cell = np.floor((points - grid.origin_m) / grid.resolution_m).astype(np.int64)[:, ::-1]
    occupied = values_at(grid.state, cell, UNKNOWN) == OCCUPIED
    return 100.0 * float(occupied.sum()) / max(len(points), 1)


def _depth_picture(depth_m: Float32[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """Depth in grey: near is white; black is unknown or beyond ``SHOWN_DEPTH_M``."""
    grey = 255.0 * (1.0 - np.nan_to_num(depth_m, nan=SHOWN_DEPTH_M) / SHOWN_DEPTH_M).clip(0.0, 1.0)
    return np.repeat(grey.astype(np.uint8)[:, :, None], 3, axis=2)
