"""Reads sequences in the layout of nerfstudio: a ``transforms.json`` that names images and poses."""

from __future__ import annotations

import logging
import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct

from anm_mj.errors import RunFolderError
from anm_mj.frames import T_GL_CV
from anm_mj.geometry.lens_distortion import EQUIDISTANT, LensDistortion
from anm_mj.io.image import read_image
from anm_mj.io.read_run import read_json
from anm_mj.io.run_shapes import Number
from anm_mj.io.sequence import FRAME_S, Frame, LeftOut, Sequence, require_below, require_count
from anm_mj.io.sequence_text import in_number_order, with_slashes
from anm_mj.types import Intrinsics
from anm_mj.utils.read_file import convert

_POLYNOMIAL, _FISHEYE = ("k1", "k2", "p1", "p2", "k3"), ("k1", "k2", "k3", "k4")
_MODELS = {
    **dict.fromkeys(
        ("PINHOLE", "SIMPLE_PINHOLE", "OPENCV", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE"), ("plumb_bob", _POLYNOMIAL)
    ),
    "OPENCV_FISHEYE": (EQUIDISTANT, _FISHEYE),
}
"""Camera models of nerfstudio that are a pinhole but for distortion: the distortion's model, and its coefficients."""
_CAMERA = ("w", "h", "fl_x", "fl_y", "cx", "cy")
_DISTORTION = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
_UNIT_M = 0.001
_SAME_CAMERA = 0.01
"""Cameras of frames that differ by a smaller share of the image's width count as one, their median."""

_logger = logging.getLogger(__name__)


class _TransformsFrame(Struct):
    file_path: str
    transform_matrix: list[tuple[Number, Number, Number, Number]]
    depth_file_path: str | None = None
    time: Number = 0.0
    w: int | None = None
    h: int | None = None
    fl_x: Number | None = None
    fl_y: Number | None = None
    cx: Number | None = None
    cy: Number | None = None


class _Transforms(Struct):
    """``transforms.json`` of nerfstudio."""

    frames: Annotated[list[_TransformsFrame], Meta(min_length=1)]
    depth_unit_scale_factor: Number = _UNIT_M
    camera_model: str = "OPENCV"


def read_nerfstudio(folder: Path) -> Sequence:
    """The frames of a ``transforms.json`` that names depth images.

    Raises:
        KeyError, TypeError, ValueError, RunFolderError: The file is missing or damaged, names no depth, or its camera
            is no pinhole.
    """
    facts = read_json(folder / "transforms.json")
    shape = convert(facts, _Transforms)
    facts = _one_camera(folder, facts)
    bent = _distortion(folder, facts, shape.camera_model)
    require_count(len(facts["frames"]))
    frames = []
    for index, entry in enumerate(_ordered(facts["frames"])):
        if entry.get("depth_file_path") is None:
            continue
        matrix = np.array(entry["transform_matrix"], dtype=np.float64) @ T_GL_CV
        time_s = float(entry.get("time", index * FRAME_S))
        colour, depth = (folder / with_slashes(entry[key]) for key in ("file_path", "depth_file_path"))
        frames.append(Frame(time_s, colour, depth, matrix))
    if not frames:
        raise RunFolderError(f"{folder / 'transforms.json'} gives no frame a depth_file_path.")
    listed = len(facts["frames"])
    left_out = (LeftOut(listed - len(frames), listed, "transforms.json gives them no depth_file_path"),)
    first = facts["frames"][0]
    stated = {key: facts.get(key, first.get(key)) for key in _CAMERA}
    angle = facts.get("camera_angle_x", first.get("camera_angle_x"))
    if angle is not None:
        require_below(folder, frames[:1])
        stated = _by_angle(stated, angle, frames[0])
    camera = _camera(stated)
    unit = float(facts.get("depth_unit_scale_factor", _UNIT_M))
    # Images of ours keep the first pixel of each block.
    ours = facts.get("depth_pixels") == "first of each block"
    return Sequence(
        folder,
        camera,
        unit,
        tuple(frames),
        resize=True,
        keeps_corner_pixels=ours,
        distortion=bent,
        left_out=left_out,
    )


def _ordered(frames: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return sorted(frames, key=lambda frame: in_number_order(frame["file_path"]))


def _one_camera(folder: Path, facts: dict[str, Any]) -> dict[str, Any]:
    """The facts with the median of cameras that hardly differ from frame to frame, as phones refocus."""
    medians: dict[str, float] = {}
    spread = 0.0
    for key in ("fl_x", "fl_y", "cx", "cy"):
        values = [frame.get(key) for frame in facts["frames"]]
        if key in facts or None in values or len(set(values)) == 1:
            continue
        medians[key] = float(np.median(values))
        spread = max(spread, max(values) - min(values))
    width = facts.get("w", facts["frames"][0].get("w")) or 0
    if not medians or spread > _SAME_CAMERA * width:
        return facts
    _logger.warning("%s: the cameras of its frames differ by up to %.3g px; the median counts for all.", folder, spread)
    return {**facts, **medians}


def _by_angle(stated: dict[str, Any], angle: float, first: Frame) -> dict[str, Any]:
    """What a field of view says where the camera is not stated: Blender and instant-ngp write that alone."""
    if not (isinstance(angle, int | float) and 0.0 < angle < math.pi):
        raise ValueError(f"camera_angle_x is {angle!r}, which is no angle between 0 and pi")
    height, width = read_image(first.colour, "RGB").shape[:2] if isinstance(first.colour, Path) else (0, 0)
    width, height = stated["w"] or width, stated["h"] or height
    focal = 0.5 * width / math.tan(0.5 * angle)
    assumed = {"w": width, "h": height, "fl_x": focal, "fl_y": focal, "cx": 0.5 * width, "cy": 0.5 * height}
    return {key: assumed[key] if value is None else value for key, value in stated.items()}


def _distortion(folder: Path, facts: dict[str, Any], model: str) -> LensDistortion | None:
    """The distortion; cameras that are no pinhole but for that, or differ from frame to frame, are refused."""
    if model not in _MODELS:
        raise RunFolderError(
            f"{folder / 'transforms.json'} has the camera_model {model!r}, which is no pinhole: give undistorted "
            f"images (one of {', '.join(_MODELS)})."
        )
    for key in (*_CAMERA, *_DISTORTION):
        if key not in facts and len({frame.get(key) for frame in facts["frames"]}) > 1:
            raise RunFolderError(
                f"{folder / 'transforms.json'} gives its frames different {key}: a sequence has one camera; map the "
                "frames of each one alone."
            )
    first = facts["frames"][0]
    stated = {key: value for key in _DISTORTION if (value := facts.get(key, first.get(key)))}
    name, keys = _MODELS[model]
    unknown = sorted(stated.keys() - set(keys))
    if unknown:
        raise RunFolderError(
            f"{folder / 'transforms.json'} states {', '.join(unknown)}, which the camera_model {model!r} has not here; "
            "give undistorted images."
        )
    return LensDistortion.of(name, [stated.get(key, 0.0) for key in keys])


def _camera(values: dict[str, Any]) -> Intrinsics:
    for key, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise ValueError(f"{key} is {value!r}, which is no number")
    width, height, *numbers = (float(value) for value in values.values())
    if not (width.is_integer() and height.is_integer()):
        raise ValueError(f"w and h are {width:g} and {height:g} pixels")
    return Intrinsics(int(width), int(height), *numbers)
