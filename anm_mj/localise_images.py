"""Finds the poses of recorded images in the map of a finished run, which stays as it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from anm_mj.config import RunConfig
from anm_mj.errors import RunFolderError
from anm_mj.evaluation.trajectory_error import TrajectoryError, trajectory_error, warn_of_assumed_times
from anm_mj.io.bag_poses import Track
from anm_mj.io.read_run import Run, read_run
from anm_mj.io.run_folder import empty_folder
from anm_mj.io.run_records import FrameRecord
from anm_mj.io.sequence import Sequence
from anm_mj.io.sequence_poses import base_pose, camera_line
from anm_mj.io.to_json import write_json
from anm_mj.io.write import writing
from anm_mj.localisation.coarse_search import distinct_tilts
from anm_mj.localisation.field_localiser import FieldLocaliser
from anm_mj.localisation.localisation_config import LocalisationConfig
from anm_mj.localisation.localiser import PoseEstimate, TrackingState
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.utils.files import write_text

POSES, TABLE = "poses.tum", "poses.json"
"""Files of the folder that is written."""
_MOST_TILTS = 8
"""So many heights and tilts of the map's own camera are tried at most."""
_REASONS = {
    True: "looked for in the whole map: no place fits well, or several do, the image measures too little, or too few "
    "images follow",
    False: "tracked from the images before: the map does not show this there, or does not tell the pose well enough",
}
"""Why an image was not found, by whether it was looked for in the whole map."""


@dataclass(frozen=True)
class ImagePose:
    """What is known of where an image was taken."""

    step: int
    time_s: float
    T_world_camera: Float[np.ndarray, "4 4"] | None
    """Camera to the world of the map; None where it was not found."""
    searched: bool
    """Whether it was looked for in the whole map; else it was tracked from the image before or after."""
    deviation_m: float | None = None
    """Largest standard deviation of the position [m]."""
    deviation_rad: float | None = None
    """Largest standard deviation of the rotation [rad]."""
    known: float | None = None
    """Share of the image's points at surface that the map knows, in [0, 1]."""
    inliers: float | None = None
    """Share of those that fit, in [0, 1]."""

    @classmethod
    def of(cls, estimate: PoseEstimate, *, searched: bool = False) -> ImagePose:
        """The pose of a frame, where the map, or the images before, told it well enough."""
        seen, quality = estimate.observation, estimate.quality
        if not estimate.usable or estimate.guessed:
            return cls(seen.step, seen.time_s, None, searched)
        deviations = estimate.position_deviation_m, estimate.rotation_deviation_rad
        fit = quality.known, quality.inliers
        return cls(seen.step, seen.time_s, seen.T_world_camera, searched, *deviations, *fit)


def localise_images(
    path: Path,
    images: Sequence,
    config: RunConfig,
    *,
    single: bool = False,
    on_image: Callable[[int, int], bool | None] = lambda done, total: None,
    poses: list[ImagePose] | None = None,
) -> list[ImagePose]:
    """The poses of images, whose own are not used, in the map of the run in a folder.

    The first is looked for in the whole map, the others are tracked from image to image; what comes before the first
    that was found is tracked backwards from it. If they are ``single``, as they do not follow one another, each is
    looked for on its own. Of the configuration ``localisation``, ``seed`` and ``device`` count; ``on_image`` is called
    with images done and in all, and ends the search where it returns True. ``poses`` is the list to fill: after an
    error it holds what was found before. Raises RunFolderError if the folder is no run, or too many images are missing
    or damaged, and MapError if its map cannot be read, or its engine cannot localise.
    """
    run = read_run(path)
    neural_map = NeuralMap.load(run.folder.map, device=config.device)
    tilts = _tilts(run)

    def localiser(settings: LocalisationConfig, lost: bool = True) -> FieldLocaliser:
        return FieldLocaliser(
            neural_map,
            settings,
            seed=config.seed,
            planar=False,
            odometry=False,
            base_pose=base_pose,
            lost=lost,
            tilts=tilts,
        )

    settings = config.localisation
    # No more images will confirm a place than there are.
    most = 1 if single else max(1, len(images))
    finding = replace(settings.relocalisation, frames=min(settings.relocalisation.frames, most))
    settings = replace(settings, relocalisation=finding)
    tracker = localiser(settings)
    poses = [] if poses is None else poses
    # Places in the list of what was not found since the last that was. Their images are read again.
    waiting: list[int] = []
    for seen in images.observations():
        if single:
            tracker = localiser(settings)
        searched = tracker.state is TrackingState.LOST
        estimate = tracker.localise(seen)
        poses.append(ImagePose.of(estimate, searched=searched))
        if estimate.relocalised:
            back = localiser(settings, lost=False)
            back.localise(estimate.observation)
            for place in reversed(waiting):
                before = ImagePose.of(back.localise(images.observation(poses[place].step)))
                # Before the first one that does not fit, the images may show anything.
                if before.T_world_camera is None:
                    break
                poses[place] = before
                if on_image(len(poses), len(images)):
                    return poses
        if poses[-1].T_world_camera is not None or single:
            waiting.clear()
        else:
            waiting.append(len(poses) - 1)
        if on_image(len(poses), len(images)):
            break
    return poses


def why_not_found(poses: list[ImagePose]) -> dict[str, list[int]]:
    """The steps of the images that were not found, by the reason, in words."""
    lost = [pose for pose in poses if pose.T_world_camera is None]
    by_reason = {text: [pose.step for pose in lost if pose.searched == searched] for searched, text in _REASONS.items()}
    return {reason: steps for reason, steps in by_reason.items() if steps}


def pose_error(poses: list[ImagePose], reference: Track) -> TrajectoryError | None:
    """Errors of found poses by a reference in the world of the map; None where it knows fewer than three of them."""
    warn_of_assumed_times([pose.time_s for pose in poses], reference)
    records = []
    for pose in poses:
        true = reference.at(pose.time_s)
        if pose.T_world_camera is not None and true is not None:
            places = base_pose(pose.T_world_camera), pose.T_world_camera, base_pose(true), true
            records.append(FrameRecord(pose.step, pose.time_s, *places))
    return trajectory_error(records) if len(records) >= 3 else None


def write_poses(out: Path, path: Path, images: Path, poses: list[ImagePose], error: TrajectoryError | None) -> None:
    """Write the poses of images, in order, as TUM file, and all that is known of them as JSON, into the new folder
    ``out``. ``path`` is the folder of the run, ``images`` that of the images, ``error`` None where nobody knows it.
    Raises RunFolderError if the folder is not empty, or cannot be written.
    """
    empty_folder(out)
    found = [(pose.time_s, T) for pose in poses if (T := pose.T_world_camera) is not None]
    facts: dict[str, Any] = {"run": str(path), "images": str(images), "frames": len(poses), "found": len(found)}
    shares = ("lost_percent", "unmapped_percent")
    facts |= {} if error is None else {key: value for key, value in asdict(error).items() if key not in shares}
    with writing(out):
        write_text(out / POSES, "".join(camera_line(time_s, T) + "\n" for time_s, T in found))
        write_json(out / TABLE, {**facts, "poses": [asdict(pose) for pose in poses]})


def require_new(out: Path) -> None:
    """Raises RunFolderError where there is something already."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise RunFolderError(f"{out} exists and is not empty; choose another folder.")


def _tilts(run: Run) -> list[Float[np.ndarray, "4 4"]]:
    """Heights and tilts that the map's own camera had most often, no two alike. Raises RunFolderError if no frame tells
    one.
    """
    kept = distinct_tilts([frame.T_world_camera for frame in run.posed_frames])
    if not kept:
        raise RunFolderError(
            f"{run.folder.path} holds no frame whose pose was known; give the folder of a finished run."
        )
    return kept[:_MOST_TILTS]
