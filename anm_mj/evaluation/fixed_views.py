"""Fixed views of a scene: the same poses for every run in it, wherever the run went.

Places are drawn at random from the reachable area, headings from all directions, by a seed that comes from the scene.
Novel views (:mod:`anm_mj.evaluation.novel_views`) leave out what a run never observed, so that two runs are compared on
different views. Here nothing is left out: what a run did not find counts as wrong. So the means of two runs compare
their maps as wholes.
"""

import hashlib
from io import BytesIO
from itertools import islice
from pathlib import Path

import numpy as np

from anm_mj.evaluation.novel_views import candidate_poses
from anm_mj.evaluation.rerender import explored_scene, observe_at
from anm_mj.evaluation.view_quality import ViewsResult, compare_views, write_views
from anm_mj.io.folder_hold import held
from anm_mj.io.read_run import read_run
from anm_mj.io.run_folder import RunFolder
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.robot.robot_config import DEFAULT_ROBOT
from anm_mj.robot.robot_presets import robot_path
from anm_mj.scene.folder import Scene
from anm_mj.scene.navigable import is_clear, scene_area
from anm_mj.sim.make_robot import make_robot
from anm_mj.types import DEFAULT_FOOTPRINT, Intrinsics, Observation, Pose2
from anm_mj.utils.files import cache_folder, store_in_cache
from anm_mj.utils.progress import Progress, unheard
from anm_mj.utils.read_file import read_npz

NUM_VIEWS = 200
"""Views of every scene."""
VIEW_PX = 96
"""Width and height of the views [px]."""
METHOD = 2
"""Version of the choice of views and of how they are drawn; a higher one ignores what older versions cached."""
_ARRAYS = ("pose", "rgb", "depth_mm", "T_world_camera", "camera")
"""Of a cached file: x [m], y [m], yaw [rad] of the base; colours; planar depth [mm], 0 = none; poses of the camera; fx,
fy, cx, cy [px]."""


def fixed_views(scene: Scene, num_views: int = NUM_VIEWS) -> list[Observation]:
    """The fixed views of a scene by the camera of the default robot without errors, kept in the user's cache.

    Planar depth is rounded to millimetres, and NaN where there is no surface within 65 m. A smaller number gives the
    first ones of a larger. Raises SceneError if there is next to no floor, and RenderError if no GL back-end works.
    """
    path = cache_folder("fixed_views") / f"{_key(scene, num_views)}.npz"
    arrays = _load(path)
    if arrays is None:
        arrays = _rendered(scene, num_views)
        content = BytesIO()
        np.savez_compressed(content, allow_pickle=False, **arrays)
        store_in_cache(path, content.getvalue())
    pose, rgb, depth_mm, T_world_camera, camera = (arrays[name] for name in _ARRAYS)
    intrinsics = Intrinsics(rgb.shape[2], rgb.shape[1], *camera.tolist())
    depth_m = np.where(depth_mm > 0, depth_mm / 1000.0, np.nan).astype(np.float32)
    return [
        Observation(k, 0.0, rgb[k], depth_m[k], intrinsics, T_world_camera[k], Pose2(*pose[k].tolist()))
        for k in range(len(pose))
    ]


def evaluate_fixed_views(path: Path, scene: str | None = None, on_progress: Progress = unheard) -> ViewsResult:
    """Compare what a run's map renders at the fixed views of its scene with the truth.

    Writes ``fixed_views.json`` (pose and quality of each view, and the means) into the run folder. ``scene`` is the
    present name or folder of the run's scene, if it has moved. Raises RunFolderError if the folder is no run or is
    being written, a file in it is damaged, or it explored another scene, SceneError if there is no such scene, MapError
    if the map cannot be loaded, and RenderError if no GL back-end works.
    """
    path = RunFolder.open(path).path
    with held(path):
        record = read_run(path)
        views = fixed_views(explored_scene(record, scene))
        neural_map = NeuralMap.load(record.folder.map, geometry="occupancy")
        compared = compare_views(neural_map, views, len(views), on_progress)
        return write_views(
            record.folder.fixed_views, [{"pose": view.pose, "quality": quality} for view, _, _, quality in compared]
        )


def _rendered(scene: Scene, num_views: int) -> dict[str, np.ndarray]:
    """The views as the simulator renders them, and as the cache holds them."""
    places = scene_area(scene, DEFAULT_FOOTPRINT).places(1)
    candidates = candidate_poses(places, int(scene.hash[:8], 16))
    poses = list(islice((pose for pose in candidates if is_clear(scene, pose, DEFAULT_FOOTPRINT)), num_views))
    seen = list(observe_at(scene, poses, VIEW_PX))
    camera = seen[0].intrinsics
    depth_mm = np.stack([np.nan_to_num(view.depth_m * 1000.0, nan=0.0, posinf=0.0) for view in seen])
    depth_mm[depth_mm > np.iinfo(np.uint16).max] = 0.0
    arrays = (
        np.array([(pose.x_m, pose.y_m, pose.yaw_rad) for pose in poses]),
        np.stack([view.rgb for view in seen]),
        np.rint(depth_mm).astype(np.uint16),
        np.stack([view.T_world_camera for view in seen]),
        np.array([camera.fx, camera.fy, camera.cx, camera.cy]),
    )
    return dict(zip(_ARRAYS, arrays, strict=True))


def _key(scene: Scene, num_views: int) -> str:
    """A name made from everything that the views depend on."""
    # The cameras draw other colours.
    with make_robot(scene, must_fit=False, image_px=VIEW_PX) as robot:
        camera = robot.camera_kind
    said = f"{METHOD}\0{scene.hash}\0{num_views}\0{VIEW_PX}\0{DEFAULT_FOOTPRINT}\0{camera}\0"
    digest = hashlib.sha256(said.encode())
    digest.update(robot_path(DEFAULT_ROBOT).read_bytes())
    return digest.hexdigest()[:32]


def _load(path: Path) -> dict[str, np.ndarray] | None:
    """The cached views; None if the file is missing or damaged."""
    try:
        arrays = read_npz(path)
        return {name: arrays[name] for name in _ARRAYS}
    except (OSError, ValueError, KeyError):
        return None
