"""Ground truth with its observable part, computed once per scene, robot and camera.

The user's cache folder keeps the observable part under a name made from everything that it depends on.
"""

import hashlib
import logging
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float32

from anm_mj.ground_truth import observable
from anm_mj.ground_truth.ground_truth import NUM_SAMPLES, GroundTruth
from anm_mj.ground_truth.observable import ReachableArea, observable_samples
from anm_mj.ground_truth.pixel_rays import CameraExtrinsics
from anm_mj.ground_truth.reduced_depth import MAX_DEPTH_M
from anm_mj.scene.folder import Scene
from anm_mj.scene.navigable import scene_area
from anm_mj.types import Footprint, Pose2
from anm_mj.utils.files import cache_folder, store_in_cache
from anm_mj.utils.progress import Progress, unheard
from anm_mj.utils.raycast import RayCaster, embree_installed
from anm_mj.utils.read_file import read_npy

_logger = logging.getLogger(__name__)

METHOD = 2
"""Version of the search; a higher one ignores what older versions cached."""


def cached_ground_truth(
    scene: Scene,
    footprint: Footprint,
    camera: CameraExtrinsics,
    start: Pose2,
    on_progress: Progress = unheard,
    num_samples: int = NUM_SAMPLES,
) -> GroundTruth:
    """The samples for completion, and which of them are observable from where the robot can get from ``start``.

    The samples of a scene do not depend on a run's seed, so runs differ by their frames alone. Without Embree the
    observable part stays unknown, and a warning says so. ``on_progress`` is called with done and total rounds of the
    search, unless the answer is cached. Raises SceneError if the scene has no surface, or next to no floor.
    """
    truth = GroundTruth.sample(*scene.triangles(), num_samples)
    if not embree_installed():
        _logger.warning(
            "The observable surface is not computed, because embreex is not installed; "
            "install it with pip install embreex."
        )
        return truth
    area = reachable_area(scene, footprint, start)
    path = cache_folder("observable") / f"{cache_key(scene, truth.samples, area, camera)}.npy"
    kept = _load(path, len(truth.samples))
    if kept is None:
        kept = observable_samples(truth.samples, RayCaster(*scene.triangles()), area, camera, on_progress)
        content = BytesIO()
        np.save(content, np.packbits(kept))
        store_in_cache(path, content.getvalue())
    return replace(truth, observable=kept)


def reachable_area(scene: Scene, footprint: Footprint, start: Pose2) -> ReachableArea:
    """The area that a robot can reach from a start. Raises SceneError if there is next to no floor."""
    area = scene_area(scene, footprint)
    places = [area.places(k) for k in range(1, int(area.component.max()) + 1)]
    # A start beside an obstacle may lie in a blocked cell; the nearest component counts.
    nearest_m = [float(np.linalg.norm(xy - start.xy_m, axis=1).min()) for xy in places]
    reachable = area.component == 1 + int(np.argmin(nearest_m))
    return ReachableArea(reachable, area.grid.origin_xy_m, area.grid.resolution_m)


def cache_key(scene: Scene, samples: Float32[np.ndarray, "n 3"], area: ReachableArea, camera: CameraExtrinsics) -> str:
    """A name made from everything that the observable part depends on."""
    digest = hashlib.sha256(f"{METHOD}\0{scene.hash}\0{observable.NUM_ROUNDS}\0{camera.intrinsics}\0".encode())
    digest.update(samples.tobytes())
    digest.update(np.packbits(area.reachable).tobytes())
    # The same camera read off two poses differs in the last digits.
    digest.update((np.round(camera.T_base_camera, 6) + 0.0).tobytes())
    if camera.range_m < MAX_DEPTH_M:
        digest.update(f"{camera.range_m}".encode())
    return digest.hexdigest()[:32]


def _load(path: Path, num_samples: int) -> Bool[np.ndarray, " n"] | None:
    try:
        kept = read_npy(path)
    except (OSError, ValueError):
        return None
    fits = kept.dtype == np.uint8 and kept.shape == ((num_samples + 7) // 8,)
    return np.unpackbits(kept)[:num_samples].astype(bool) if fits else None
