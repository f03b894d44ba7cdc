"""Renders views from places where the robot of a finished run never stood, by the map and by the simulator.

The places are clear of obstacles, more than half a metre away from the whole trajectory, and drawn at random from a
seed, like the directions; a view counts only if at least half of the surface in it has been observed. The candidates
are the same for every run in a scene with the same seed, and each run is measured on the first of them that are
held out from it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from jaxtyping import Float32, UInt8
from PIL import Image

from anm_mj.evaluation.depth import MAX_DEPTH_M
from anm_mj.evaluation.novel_view_poses import (
    HeldOut,
    ViewQuality,
    candidate_poses,
    compare_view,
    far_places,
    mean_quality,
)
from anm_mj.evaluation.rerender import ROBOT_PREFIX, explored_scene
from anm_mj.frames import back_project
from anm_mj.io.read_run import Run, read_run
from anm_mj.io.to_json import write_json
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.scene.folder import Scene
from anm_mj.scene.navigable import is_clear, scene_area
from anm_mj.sim.make_robot import FOOTPRINT, make_robot
from anm_mj.types import OCCUPIED, Observation, Pose2, VoxelGrid

NUM_VIEWS = 8
"""Views that are taken unless told otherwise."""
FAR_M = 0.5
"""Held-out places are farther than this from the trajectory [m]."""
MIN_OBSERVED_PERCENT = 50.0
"""Share of a view's surface that must have been observed [%]."""
MAX_TRIED = 2000
"""Poses tried at most."""
SHOWN = 4
"""Views drawn in the picture: true and rendered colour, true and rendered depth."""
SHOWN_DEPTH_M = 6.0
"""Depth that is drawn black [m]."""


@dataclass(frozen=True)
class HeldOutView:
    """One view: where it was taken, and how well the map renders it."""

    pose: Pose2
    observed_percent: float
    """Share of the true surface in view, within the sensor's range, that the run has observed [%]."""
    quality: ViewQuality


def measure_held_out(path: Path, views: int = NUM_VIEWS, seed: int = 0, scene: str | None = None) -> HeldOut:
    """Measure a run's map on held-out views.

    Writes ``heldout.json`` with the quality of each view and the means, and ``heldout.png`` with the first views, into
    the run's folder.

    Args:
        path: Folder of a finished run.
        views: How many views; fewer where there are not as many.
        seed: Places and directions derive from it.
        scene: The run's scene, where it lies now if it has moved.

    Raises:
        RunFolderError: The folder is not one of a run, a file in it is damaged, or it explored another scene.
        SceneError: There is no such scene.
        MapError: The map cannot be loaded.
    """
    record = read_run(path)
    world = explored_scene(record, scene)
    neural_map = NeuralMap.load(record.folder.map)
    found, pictures = list[HeldOutView](), []
    for pose, seen, observed in islice(held_out_views(record, world, neural_map.occupancy, seed), views):
        rgb, depth_m = neural_map.render(seen.intrinsics, seen.T_world_camera)
        found.append(HeldOutView(pose, observed, compare_view(rgb, depth_m, seen.rgb, seen.depth_m)))
        pictures.append(np.concatenate([seen.rgb, rgb, depth_picture(seen.depth_m), depth_picture(depth_m)], axis=1))
    mean = mean_quality([view.quality for view in found]) if found else None
    write_json(path / "heldout.json", {"num_views": len(found), "seed": seed, "mean": mean, "views": found})
    if pictures:
        Image.fromarray(np.concatenate(pictures[:SHOWN])).save(path / "heldout.png")
    return HeldOut(len(found), mean)


def held_out_views(record: Run, world: Scene, grid: VoxelGrid, seed: int) -> Iterator[tuple[Pose2, Observation, float]]:
    """Poses that the robot never stood near, what the simulator shows there, and how much of it was observed [%]."""
    trajectory = np.array([frame.true_pose.xy_m for frame in record.frames])
    places = scene_area(world, FOOTPRINT).places(1)
    far = {tuple(place) for place in far_places(places, trajectory, FAR_M).tolist()}
    with make_robot(world, start=record.frames[0].true_pose, image_px=record.intrinsics.width) as robot:
        # Imports mujoco, which it may do only once the robot's maker has chosen a GL back-end.
        from anm_mj.control.simulated_base import SimulatedBase

        base = SimulatedBase(robot.model, robot.data, ROBOT_PREFIX)
        tried = (pose for pose in candidate_poses(places, seed) if (pose.x_m, pose.y_m) in far)
        for pose in islice(tried, MAX_TRIED):
            if not is_clear(world, pose, FOOTPRINT):
                continue
            base.place(pose)
            seen = robot.observe()
            observed = observed_percent(grid, seen)
            if observed >= MIN_OBSERVED_PERCENT:
                yield pose, seen, observed


def observed_percent(grid: VoxelGrid, seen: Observation) -> float:
    """Share of a view's surface points within the sensor's range that lie in occupied voxels of the map [%]."""
    near = np.where(seen.depth_m <= MAX_DEPTH_M, seen.depth_m, np.nan).astype(np.float32)
    points = back_project(near, seen.intrinsics, seen.T_world_camera)
    cell = np.floor((points - grid.origin_m) / grid.resolution_m).astype(np.int64)[:, ::-1]
    inside = ((cell >= 0) & (cell < grid.state.shape)).all(axis=1)
    occupied = grid.state[tuple(cell[inside].T)] == OCCUPIED
    return 100.0 * float(occupied.sum()) / max(len(points), 1)


def depth_picture(depth_m: Float32[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """Depth in grey: white is near, black is beyond the range shown or unknown."""
    grey = 255.0 * (1.0 - np.nan_to_num(depth_m, nan=SHOWN_DEPTH_M) / SHOWN_DEPTH_M).clip(0.0, 1.0)
    return np.repeat(grey.astype(np.uint8)[:, :, None], 3, axis=2)
