"""One camera for frames that have cameras of their own, as phones refocus."""

import logging
from collections.abc import Sequence
from dataclasses import astuple, replace

import numpy as np

from anm_mj.io.camera_checks import check_camera
from anm_mj.io.sequence import Frame
from anm_mj.types import Intrinsics

_SAME_PX = 0.25
"""Cameras that image every direction within this distance count as one [px]."""

_logger = logging.getLogger(__name__)


def with_cameras(frames: Sequence[Frame], cameras: Sequence[Intrinsics]) -> tuple[Intrinsics, tuple[Frame, ...]]:
    """The median camera, and the frames, each with its own camera where that differs from it. There is one frame at
    least. Raises ValueError if they are of images of different sizes, or one can be that of no camera.
    """
    for camera in cameras:
        check_camera(camera)
    sizes = {(camera.width, camera.height) for camera in cameras}
    if len(sizes) > 1:
        raise ValueError(f"its frames have cameras of different sizes {sorted(sizes)}; map those of each size alone")
    numbers = np.array([astuple(camera) for camera in cameras], np.float64)
    median = np.median(numbers, axis=0)
    width, height, fx, fy = median[:4]
    reach = 0.5 * np.array([width / fx, height / fy])
    off_px = (np.abs(numbers[:, 2:4] - median[2:4]) * reach + np.abs(numbers[:, 4:] - median[4:])).max(axis=1)
    own = off_px > _SAME_PX
    if own.any():
        _logger.info(
            "%d of %d frames have cameras that differ from the median one by up to %.2g px: each is seen by its own.",
            np.count_nonzero(own),
            len(own),
            off_px.max(),
        )
    common = Intrinsics(int(width), int(height), *median[2:].tolist())
    each = zip(frames, cameras, own.tolist(), strict=True)
    return common, tuple(replace(frame, camera=camera) if differs else frame for frame, camera, differs in each)
