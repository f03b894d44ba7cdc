"""Reads sequences in the layout of nerfstudio: a ``transforms.json`` that names images and poses."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct

from anm_mj.errors import RunFolderError
from anm_mj.frames import T_GL_CV
from anm_mj.geometry.lens_distortion import EQUIDISTANT, LensDistortion
from anm_mj.io.read_run import read_json
from anm_mj.io.run_shapes import Number
from anm_mj.io.sequence import FRAME_S, Frame, Sequence, require_count
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
    bent = _distortion(folder, facts, shape.camera_model)
    require_count(len(facts["frames"]))
    frames = []
    for index, entry in enumerate(sorted(facts["frames"], key=lambda one: one["file_path"])):
        if entry.get("depth_file_path") is None:
            raise RunFolderError(f"{folder / 'transforms.json'} gives {entry['file_path']} no depth_file_path.")
        matrix = np.array(entry["transform_matrix"], dtype=np.float64) @ T_GL_CV
        time_s = float(entry.get("time", index * FRAME_S))
        frames.append(Frame(time_s, folder / entry["file_path"], folder / entry["depth_file_path"], matrix))
    first = facts["frames"][0]
    camera = _camera({key: facts.get(key, first.get(key)) for key in _CAMERA})
    unit = float(facts.get("depth_unit_scale_factor", _UNIT_M))
    # Images of ours keep the first pixel of each block.
    ours = facts.get("depth_pixels") == "first of each block"
    return Sequence(folder, camera, unit, tuple(frames), resize=True, keeps_corner_pixels=ours, distortion=bent)


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
