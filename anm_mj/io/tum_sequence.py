"""Reads sequences of the TUM RGB-D benchmark: lists of images and poses with their own times."""

from __future__ import annotations

from operator import itemgetter
from pathlib import Path

from anm_mj.io.image import read_image
from anm_mj.io.sequence import (
    MATCH_S,
    Frame,
    Sequence,
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
"""fx, fy, cx, cy [px] of the data set's cameras, from its documentation; distortion is left out."""
_DEFAULT_CAMERA = (525.0, 525.0, 319.5, 239.5)


def read_tum(folder: Path) -> Sequence:
    """The depth images that have a colour image and a pose near them in time.

    Raises:
        OSError, ValueError, IndexError, RunFolderError: A list or the first image is missing or damaged.
    """
    depth, colour = _listed(folder / "depth.txt"), _listed(folder / "rgb.txt")
    poses = sorted(read_table(folder / "groundtruth.txt"), key=itemgetter(0))
    require_count(len(depth))
    colour_times, pose_times = [time_s for time_s, _ in colour], [float(line[0]) for line in poses]
    frames = []
    for time_s, name in depth:
        image, pose = nearest_index(colour_times, time_s), nearest_index(pose_times, time_s)
        if image is not None and pose is not None:
            matrix = tum_matrix(poses[pose][1:4], poses[pose][4:])
            frames.append(Frame(time_s, folder / colour[image][1], folder / name, matrix))
    say_left_out(folder, len(frames), len(depth), f"no image or no pose is within {MATCH_S:g} s of their depth")
    known = next((camera for key, camera in _CAMERAS.items() if key in folder.resolve().name), _DEFAULT_CAMERA)
    require_below(folder, frames[:1])
    height, width = read_image(frames[0].colour, "RGB").shape[:2] if frames else (480, 640)
    return Sequence(folder, from_pixel_centres(width, height, known), _UNIT_M, tuple(frames), resize=True)


def _listed(path: Path) -> list[tuple[float, str]]:
    """Times and names in a list of a TUM sequence, by time."""
    lines = [line.split() for line in read_text(path).splitlines() if line and line[0] != "#"]
    return sorted(((float(words[0]), words[1]) for words in lines if words), key=itemgetter(0))
