"""Reads sequences of the TUM RGB-D benchmark: lists of images and poses with their own times."""

from __future__ import annotations

from operator import itemgetter
from pathlib import Path

from anm_mj.errors import RunFolderError
from anm_mj.geometry.lens_distortion import LensDistortion
from anm_mj.io.image import read_image
from anm_mj.io.sequence import (
    MATCH_S,
    Frame,
    Sequence,
    bridged,
    from_pixel_centres,
    nearest_index,
    require_below,
    require_count,
    say_left_out,
    tum_matrix,
)
from anm_mj.utils.read_file import read_table, read_text

_UNIT_M = 1.0 / 5000.0
_CAMERAS = {
    "freiburg1": (517.3, 516.5, 318.6, 255.3),
    "freiburg2": (520.9, 521.0, 325.1, 249.7),
    "freiburg3": (535.4, 539.2, 320.1, 247.6),
}
"""fx, fy, cx, cy [px] of the data set's cameras, from its documentation."""
_DISTORTIONS = {
    "freiburg1": (0.2624, -0.9531, -0.0054, 0.0026, 1.1633),
    "freiburg2": (0.2312, -0.7849, -0.0033, -0.0001, 0.9172),
}
"""k1, k2, p1, p2, k3 of the same; the images of freiburg3 have none."""
_DEFAULT_CAMERA = (525.0, 525.0, 319.5, 239.5)


def read_tum(folder: Path, *, needs_poses: bool = True) -> Sequence:
    """The depth images that have a colour image near them in time, and a pose.

    Args:
        folder: Of the sequence.
        needs_poses: Whether frames without a pose are left out, and a folder without groundtruth.txt is refused;
            else poses are interpolated, or there are none.

    Raises:
        OSError, ValueError, IndexError, RunFolderError: A list or the first image is missing or damaged.
    """
    depth, colour = _listed(folder / "depth.txt"), _listed(folder / "rgb.txt")
    truth = folder / "groundtruth.txt"
    if needs_poses and not truth.is_file():
        raise RunFolderError(f"{folder} has no groundtruth.txt; give --track to find its poses.")
    poses = sorted(read_table(truth), key=itemgetter(0)) if truth.is_file() else []
    require_count(len(depth))
    colour_times, pose_times = [time_s for time_s, _ in colour], [float(line[0]) for line in poses]
    chosen, found = [], []
    for time_s, name in depth:
        image, pose = nearest_index(colour_times, time_s), nearest_index(pose_times, time_s)
        if image is not None and (pose is not None or not needs_poses):
            chosen.append((time_s, folder / colour[image][1], folder / name))
            found.append(None if pose is None else tum_matrix(poses[pose][1:4], poses[pose][4:]))
    matrices, missing = bridged([time_s for time_s, _, _ in chosen], found)
    frames = [Frame(time_s, image, depth, T) for (time_s, image, depth), T in zip(chosen, matrices, strict=True)]
    partners = "image or no pose is" if needs_poses else "image is"
    say_left_out(folder, len(frames), len(depth), f"no {partners} within {MATCH_S:g} s of their depth")
    key = next((key for key in _CAMERAS if key in folder.resolve().name), "")
    known = _CAMERAS.get(key, _DEFAULT_CAMERA)
    bent = LensDistortion.of("plumb_bob", _DISTORTIONS.get(key, ()), f"as published for {key}, by the folder's name")
    require_below(folder, frames[:1])
    height, width = read_image(chosen[0][1], "RGB").shape[:2] if chosen else (480, 640)
    camera = from_pixel_centres(width, height, known)
    return Sequence(
        folder,
        camera,
        _UNIT_M,
        tuple(frames),
        resize=True,
        distortion=bent,
        has_poses=needs_poses or len(missing) < len(frames),
        interpolated=missing,
    )


def _listed(path: Path) -> list[tuple[float, str]]:
    """Times and names in a list of a TUM sequence, by time."""
    lines = [line.split() for line in read_text(path).splitlines() if line and line[0] != "#"]
    return sorted(((float(words[0]), words[1]) for words in lines if words), key=itemgetter(0))
