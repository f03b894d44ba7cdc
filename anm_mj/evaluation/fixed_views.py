"""Fixed views of a scene: the same poses for every run in it, wherever the run went.

Places are drawn at random from the reachable area, headings from all directions, by a seed that comes from the scene.
Novel views (:mod:`anm_mj.evaluation.novel_views`) leave out what a run never observed, so that two runs are compared on
different views. Here nothing is left out: what a run did not find counts as wrong. So the means of two runs compare
their maps as wholes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from itertools import islice
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from jaxtyping import Float64, UInt8, UInt16

from anm_mj.evaluation.novel_views import candidate_poses
from anm_mj.evaluation.rerender import explored_scene, observe_at
from anm_mj.evaluation.view_quality import ViewQuality, ViewsResult, compare_view, mean_quality
from anm_mj.io.read_run import read_run
from anm_mj.io.to_json import write_json
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.robot.robot_config import DEFAULT_ROBOT
from anm_mj.robot.robot_presets import robot_path
from anm_mj.scene.folder import Scene
from anm_mj.scene.navigable import is_clear, scene_area
from anm_mj.sim.make_robot import FOOTPRINT
from anm_mj.types import Intrinsics, Pose2
from anm_mj.utils.files import cache_folder, store_in_cache

NUM_VIEWS = 200
"""Views of every scene."""
VIEW_PX = 96
"""Width and height of the views [px]."""
METHOD = 1
"""Version of the choice of views; a higher one ignores what older versions cached."""


@dataclass(frozen=True)
class FixedViews:
    """True images of a scene at its fixed views, by the camera of the default robot without errors."""

    pose: Float64[np.ndarray, "n 3"]
    """x [m], y [m] and yaw [rad] of the base."""
    rgb: UInt8[np.ndarray, "n h w 3"]
    depth_mm: UInt16[np.ndarray, "n h w"]
    """Planar depth [mm]; 0 where there is no surface within 65 m."""
    T_world_camera: Float64[np.ndarray, "n 4 4"]
    camera: Float64[np.ndarray, "4"]
    """fx, fy, cx, cy [px]."""

    @property
    def intrinsics(self) -> Intrinsics:
        """The camera."""
        fx, fy, cx, cy = self.camera.tolist()
        return Intrinsics(self.rgb.shape[2], self.rgb.shape[1], fx, fy, cx, cy)


def fixed_views(scene: Scene, num_views: int = NUM_VIEWS) -> FixedViews:
    """The fixed views of a scene, rendered once and kept in the user's cache.

    Args:
        scene: The world.
        num_views: Number of views; a smaller number gives the first ones of a larger.

    Raises:
        SceneError: There is next to no floor.
        RenderError: No GL back-end works.
    """
    path = cache_folder("fixed_views") / f"{_key(scene, num_views)}.npz"
    kept = _load(path)
    if kept is None:
        kept = _rendered(scene, num_views)
        content = BytesIO()
        np.savez_compressed(content, allow_pickle=False, **vars(kept))
        store_in_cache(path, content.getvalue())
    return kept


def evaluate_fixed_views(
    path: Path,
    scene: str | None = None,
    num_views: int = NUM_VIEWS,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> ViewsResult:
    """Compare what a run's map renders at the fixed views of its scene with the truth.

    Writes ``fixed_views.json`` (pose and quality of each view, and the means) into the run folder.

    Args:
        path: Folder of a finished run.
        scene: Present name or folder of the run's scene, if it has moved.
        num_views: Number of views.
        on_progress: Called with the views done and in all.

    Raises:
        RunFolderError: The folder is no run, a file in it is damaged, or it explored another scene.
        SceneError: There is no such scene.
        MapError: The map cannot be loaded.
        RenderError: No GL back-end works.
    """
    record = read_run(path)
    views = fixed_views(explored_scene(record, scene), num_views)
    quality = compare_with(NeuralMap.load(record.folder.map, field_is_geometry=False), views, on_progress)
    poses = [Pose2(*pose) for pose in views.pose.tolist()]
    mean = mean_quality(quality) if quality else None
    rows = [{"pose": pose, "quality": found} for pose, found in zip(poses, quality, strict=True)]
    write_json(path / "fixed_views.json", {"num_views": len(rows), "mean": mean, "views": rows})
    return ViewsResult(len(rows), mean)


def compare_with(
    neural_map: NeuralMap, views: FixedViews, on_progress: Callable[[int, int], None] = lambda done, total: None
) -> list[ViewQuality]:
    """Quality of what a map renders at each fixed view."""
    found = []
    for rgb, depth_mm, T_world_camera in zip(views.rgb, views.depth_mm, views.T_world_camera, strict=True):
        true_depth_m = np.where(depth_mm > 0, depth_mm / 1000.0, np.nan).astype(np.float32)
        found.append(compare_view(*neural_map.render(views.intrinsics, T_world_camera), rgb, true_depth_m))
        on_progress(len(found), len(views.rgb))
    return found


def _rendered(scene: Scene, num_views: int) -> FixedViews:
    """The views as the simulator renders them."""
    poses = list(islice(_poses(scene), num_views))
    seen = list(observe_at(scene, poses, VIEW_PX))
    camera = seen[0].intrinsics
    depth_mm = np.stack([np.nan_to_num(view.depth_m * 1000.0, nan=0.0, posinf=0.0) for view in seen])
    depth_mm[depth_mm > np.iinfo(np.uint16).max] = 0.0
    return FixedViews(
        np.array([(pose.x_m, pose.y_m, pose.yaw_rad) for pose in poses]),
        np.stack([view.rgb for view in seen]),
        np.rint(depth_mm).astype(np.uint16),
        np.stack([view.T_world_camera for view in seen]),
        np.array([camera.fx, camera.fy, camera.cx, camera.cy]),
    )


def _poses(scene: Scene) -> Iterator[Pose2]:
    """Poses at which the robot can stand, in an order that the scene alone decides."""
    places = scene_area(scene, FOOTPRINT).places(1)
    for pose in candidate_poses(places, int(scene.hash[:8], 16)):
        if is_clear(scene, pose, FOOTPRINT):
            yield pose


def _key(scene: Scene, num_views: int) -> str:
    """A name made from everything that the views depend on."""
    digest = hashlib.sha256(f"{METHOD}\0{scene.hash}\0{num_views}\0{VIEW_PX}\0{FOOTPRINT}\0".encode())
    digest.update(robot_path(DEFAULT_ROBOT).read_bytes())
    return digest.hexdigest()[:32]


def _load(path: Path) -> FixedViews | None:
    """The cached views; None if the file is missing or damaged."""
    try:
        with np.load(path) as data:
            return FixedViews(**data)
    except (OSError, ValueError, EOFError, TypeError, BadZipFile):
        return None
