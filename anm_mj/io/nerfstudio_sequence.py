"""Reads sequences in the layout of nerfstudio: a ``transforms.json`` that names images and poses."""

import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct

from anm_mj.errors import RunFolderError
from anm_mj.frames import T_GL_CV
from anm_mj.geometry.lens_distortion import EQUIDISTANT, LensDistortion
from anm_mj.io.image import first_shape
from anm_mj.io.read_run import read_json
from anm_mj.io.run_shapes import Number, Pixels, Row
from anm_mj.io.sequence import FRAME_S, Frame, LeftOut, Sequence, require_count, with_cameras
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


class _TransformsFrame(Struct):
    file_path: str
    transform_matrix: tuple[Row, Row, Row, Row]
    depth_file_path: str | None = None
    time: Number = 0.0


class _Transforms(Struct):
    """``transforms.json`` of nerfstudio."""

    frames: Annotated[list[_TransformsFrame], Meta(min_length=1)]
    depth_unit_scale_factor: Number = _UNIT_M
    camera_model: str = "OPENCV"
    depth_pixels_of: tuple[Pixels, Pixels] | None = None
    """Width and height of the images that the depth of ours was picked from; absent = those of the images."""


def read_nerfstudio(folder: Path) -> Sequence:
    """The frames of a ``transforms.json`` that names depth images. Raises KeyError, TypeError, ValueError or
    RunFolderError if the file is missing or damaged, names no depth, or its camera is no pinhole.
    """
    facts = read_json(folder / "transforms.json")
    shape = convert(facts, _Transforms)
    bent = _distortion(folder, facts, shape.camera_model)
    require_count(len(facts["frames"]))
    frames, entries = [], []
    ordered = sorted(facts["frames"], key=lambda frame: in_number_order(frame["file_path"]))
    for index, entry in enumerate(ordered):
        if entry.get("depth_file_path") is None:
            continue
        matrix = np.array(entry["transform_matrix"], dtype=np.float64) @ T_GL_CV
        time_s = float(entry.get("time", index * FRAME_S))
        colour, depth = (folder / with_slashes(entry[key]) for key in ("file_path", "depth_file_path"))
        frames.append(Frame(time_s, colour, depth, matrix))
        entries.append(entry)
    if not frames:
        raise RunFolderError(f"{folder / 'transforms.json'} gives no frame a depth_file_path.")
    listed = len(facts["frames"])
    left_out = (LeftOut(listed - len(frames), listed, "transforms.json gives them no depth_file_path"),)
    keys = (*_CAMERA, "camera_angle_x")
    own = [key for key in keys if key not in facts and any(entry.get(key) is not None for entry in entries)]
    cameras = [
        _camera(folder, facts | {key: entry.get(key) for key in own} if own else facts, frames)
        for entry in (entries if own else entries[:1])
    ]
    camera, whole = with_cameras(frames, cameras) if own else (cameras[0], tuple(frames))
    unit = float(facts.get("depth_unit_scale_factor", _UNIT_M))
    # Images of ours keep the first pixel of each block.
    ours = facts.get("depth_pixels") == "first of each block"
    if ours and shape.depth_pixels_of is not None:
        camera = camera.scaled(*shape.depth_pixels_of)
    return Sequence(
        folder, camera, unit, whole, resize=True, keeps_corner_pixels=ours, distortion=bent, left_out=left_out
    )


def _distortion(folder: Path, facts: dict[str, Any], model: str) -> LensDistortion | None:
    """The distortion; cameras that are no pinhole but for that, or of different distortion, are refused."""
    if model not in _MODELS:
        raise RunFolderError(
            f"{folder / 'transforms.json'} has the camera_model {model!r}, which is no pinhole: give undistorted "
            f"images (one of {', '.join(_MODELS)})."
        )
    for key in _DISTORTION:
        if key not in facts and len({frame.get(key) for frame in facts["frames"]}) > 1:
            raise RunFolderError(
                f"{folder / 'transforms.json'} gives its frames different {key}: a sequence has one lens; map the "
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


def _camera(folder: Path, facts: dict[str, Any], frames: list[Frame]) -> Intrinsics:
    """The camera; size and centre where a field of view alone is stated, as by Blender and instant-ngp."""
    values = {key: facts.get(key) for key in _CAMERA}
    angle = facts.get("camera_angle_x")
    if angle is not None and None in values.values():
        if not (isinstance(angle, int | float) and 0.0 < angle < math.pi):
            raise ValueError(f"camera_angle_x is {angle!r}, which is no angle between 0 and pi")
        height, width = first_shape(folder, (frame.colour for frame in frames), "RGB")
        width, height = values["w"] or width, values["h"] or height
        focal = 0.5 * width / math.tan(0.5 * angle)
        assumed = {"w": width, "h": height, "fl_x": focal, "fl_y": focal, "cx": 0.5 * width, "cy": 0.5 * height}
        values = {key: assumed[key] if value is None else value for key, value in values.items()}
    numbers = []
    for key, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise ValueError(f"{key} is {value!r}, which is no number")
        numbers.append(float(value))
    if not (numbers[0].is_integer() and numbers[1].is_integer()):
        raise ValueError(f"w and h are {numbers[0]:g} and {numbers[1]:g} pixels")
    return Intrinsics(int(numbers[0]), int(numbers[1]), *numbers[2:])
