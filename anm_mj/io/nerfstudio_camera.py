"""The camera that nerfstudio's ``transforms.json`` states."""

from __future__ import annotations

import logging
import math
from pathlib import Path
from typing import Any

from anm_mj.errors import RunFolderError
from anm_mj.types import Intrinsics

_PINHOLES = ("PINHOLE", "SIMPLE_PINHOLE", "OPENCV", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE")
"""Camera models of nerfstudio that are a pinhole but for distortion."""
_DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")

_logger = logging.getLogger(__name__)


def check_nerfstudio_camera(folder: Path, facts: dict[str, Any], model: str) -> None:
    """Warn of distortion, which is left out.

    Raises:
        RunFolderError: The camera is no pinhole, or the frames have different ones.
    """
    if model not in _PINHOLES:
        raise RunFolderError(
            f"{folder / 'transforms.json'} has the camera_model {model!r}, which is no pinhole: give undistorted "
            f"images (one of {', '.join(_PINHOLES)})."
        )
    for key in ("w", "h", "fl_x", "fl_y", "cx", "cy"):
        if key not in facts and len({frame.get(key) for frame in facts["frames"]}) > 1:
            raise RunFolderError(
                f"{folder / 'transforms.json'} gives its frames different {key}: a sequence has one camera; map the "
                "frames of each one alone."
            )
    first = facts["frames"][0]
    bent = [key for key in _DISTORTION if facts.get(key, first.get(key))]
    if bent:
        _logger.warning(
            "%s: the distortion (%s) is left out; give undistorted images where it is large.", folder, ", ".join(bent)
        )


def nerfstudio_camera(values: dict[str, Any]) -> Intrinsics:
    """The camera of a ``transforms.json``; raises ValueError where an entry is missing or no number."""
    width, height = (_number(values, key) for key in ("w", "h"))
    if not (width.is_integer() and height.is_integer()):
        raise ValueError(f"w and h are {width:g} and {height:g} pixels")
    return Intrinsics(int(width), int(height), *(_number(values, key) for key in ("fl_x", "fl_y", "cx", "cy")))


def _number(values: dict[str, Any], key: str) -> float:
    """An entry that is a number; raises ValueError otherwise."""
    value = values[key]
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{key} is {value!r}, which is no number")
    return float(value)
