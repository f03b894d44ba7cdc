"""Reads sequences of the TUM RGB-D benchmark: lists of images and poses with their own times."""

import logging
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from anm_mj.errors import RunFolderError
from anm_mj.geometry.lens_distortion import LensDistortion
from anm_mj.io.bag_poses import GAP_S, Track
from anm_mj.io.image import first_shape
from anm_mj.io.sequence import Frame, LeftOut, Sequence, from_pixel_centres, require_count
from anm_mj.io.sequence_poses import MATCH_S, bridged, nearest_index, tum_matrix
from anm_mj.io.sequence_text import number_rows, pose_rows, rows, seconds, with_slashes

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

_logger = logging.getLogger(__name__)


def read_tum(folder: Path, *, needs_poses: bool = True, match_s: float = MATCH_S, max_gap_s: float = GAP_S) -> Sequence:
    """The depth images that have a colour image near them in time, and a pose: the options are those of
    :class:`~anm_mj.io.sequence.SequenceOptions`. A folder without groundtruth.txt is refused where it ``needs_poses``.
    Raises OSError, ValueError, IndexError or RunFolderError if a list is missing or damaged, or no image can be read.
    """
    depth, colour = _listed(folder / "depth.txt"), _listed(folder / "rgb.txt")
    truth = folder / "groundtruth.txt"
    if needs_poses and not truth.is_file():
        raise RunFolderError(f"{folder} has no groundtruth.txt; give --track to find its poses.")
    poses = pose_rows(truth) if truth.is_file() else []
    require_count(len(depth))
    colour_times = [time_s for time_s, _ in colour]
    track = Track(truth.name, [float(line[0]) for line in poses], [line[1:] for line in poses], gap_s=max_gap_s)
    chosen, found, alone = [], [], 0
    for time_s, name in depth:
        image, pose = nearest_index(colour_times, time_s, match_s), _pose(track, time_s)
        alone += image is None
        if image is not None and (pose is not None or not needs_poses):
            chosen.append((time_s, folder / colour[image][1], folder / name))
            found.append(pose)
    left_out = (
        # Images of the faster one of two rates are not missed.
        LeftOut(
            alone,
            len(depth),
            f"no colour image is near their depth in time ({match_s:g} s, --match){_ranges(depth, colour)}",
            bad=max(0, alone - max(0, len(depth) - len(colour))),
        ),
        LeftOut(
            len(depth) - alone - len(chosen),
            len(depth) - alone,
            f"no pose is near their depth in time ({MATCH_S:g} s, {max_gap_s:g} s between two poses, --max-gap)"
            f"{_ranges(depth, poses)}",
        ),
    )
    matrices, missing = bridged([time_s for time_s, _, _ in chosen], found)
    frames = [Frame(time_s, image, depth, T) for (time_s, image, depth), T in zip(chosen, matrices, strict=True)]
    key = next((key for key in _CAMERAS if key in folder.resolve().name), "")
    stated = _stated_camera(folder)
    known = stated or _CAMERAS.get(key, _DEFAULT_CAMERA)
    bent = LensDistortion.of(
        "plumb_bob", () if stated else _DISTORTIONS.get(key, ()), f"as published for {key}, by the folder's name"
    )
    height, width = first_shape(folder, (image for _, image, _ in chosen), "RGB") if chosen else (480, 640)
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
        assumes_camera=not (key or stated),
        left_out=left_out,
    )


def _ranges(depth: list[tuple[float, str]], others: list[Any]) -> str:
    """The times of two ordered lists that do not overlap, in words; else nothing."""
    if not depth or not others:
        return ""
    first, last, begin, end = depth[0][0], depth[-1][0], float(others[0][0]), float(others[-1][0])
    if begin <= last and first <= end:
        return ""
    return f": depth is of {first:.3f} to {last:.3f} s, the others of {begin:.3f} to {end:.3f} s; their clocks differ"


def _pose(track: Track, time_s: float) -> Float[np.ndarray, "4 4"] | None:
    """The pose between those before and after a time, else the nearest one within ``MATCH_S``."""
    between = track.at(time_s)
    nearest = None if between is not None else nearest_index(track.times_s, time_s)
    return between if nearest is None else tum_matrix(track.poses[nearest][:3], track.poses[nearest][3:])


def _listed(path: Path) -> list[tuple[float, str]]:
    """Times and names in a list of a TUM sequence, by time."""
    lines = [line.replace(",", " ", 1).split(maxsplit=1) for line in rows(path)]
    if lines and not lines[0][0][:1].isdigit():
        del lines[0]
    times = seconds([float(words[0]) for words in lines])
    return sorted(zip(times, (with_slashes(words[1]) for words in lines), strict=True), key=itemgetter(0))


def _stated_camera(folder: Path) -> tuple[float, ...] | None:
    """fx, fy, cx, cy [px] of ETH3D's ``calibration.txt``, from the centre of the first pixel."""
    path = folder / "calibration.txt"
    if not path.is_file():
        return None
    numbers = number_rows(path).ravel().tolist()
    if len(numbers) != 4:
        raise ValueError(f"{path.name} holds {len(numbers)} numbers, not fx fy cx cy")
    return tuple(numbers)
