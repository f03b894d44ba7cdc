"""What may be wrong with a recorded sequence, as the options of ``anm-mj map`` that put it right, and how they do."""

import itertools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Float64
from scipy.spatial.transform import Rotation

from anm_mj.errors import ConfigError, RunFolderError
from anm_mj.io.sequence import Sequence
from anm_mj.io.sequence_poses import at_times, nearest_index
from anm_mj.types import Intrinsics

CONVENTIONS = ("camera-to-world", "world-to-camera", "conjugate", "scalar-first", "scalar-first-inverse")
"""What a stated pose is: the camera in the world; the world in the camera; the camera in the world with its rotation
the other way round (the quaternion conjugated); with a quaternion that was written w x y z and read as x y z w; the
same of the world in the camera."""
OPENCV = "RDF"
"""The camera axes of this project: x right, y down, z forward."""
AXES_NAMES = {
    OPENCV: "OpenCV",
    "RUB": "OpenGL",
    "FLU": "ROS, x forward",
    "FRD": "aerospace, x forward",
    "RUF": "Unity, left-handed",
    "LDF": "mirrored",
}
"""Axes with a name of their own, the common ones first."""
_DIRECTIONS = {
    "R": (1.0, 0.0, 0.0),
    "L": (-1.0, 0.0, 0.0),
    "D": (0.0, 1.0, 0.0),
    "U": (0.0, -1.0, 0.0),
    "F": (0.0, 0.0, 1.0),
    "B": (0.0, 0.0, -1.0),
}
LEAST_FACTOR, LARGEST_FACTOR = 1e-6, 1e6
"""Between these lie the factors of positions and of depth."""
_MIRROR_WORLD = np.diag([-1.0, 1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Correction:
    """How what the files state becomes what is true; the default changes nothing."""

    convention: str = CONVENTIONS[0]
    """What a stated pose is, of ``CONVENTIONS``."""
    axes: str = OPENCV
    """Where the x, y and z axis of the stated camera point in the image: Right or Left, Up or Down, Forward or Back."""
    pose_scale: float = 1.0
    """Metres per unit of the stated positions."""
    depth_scale: float = 1.0
    """True depth per stated depth."""
    focal_scale: float = 1.0
    """True focal length per stated one."""
    ray_depth: bool = False
    """Whether the depth images hold distances along the rays instead of planar depth."""
    mirrored: bool = False
    """Whether the images are mirrored left to right."""
    time_offset_s: float = 0.0
    """The pose of an image of time t is the one stamped t + this [s]."""
    colour_offset_s: float = 0.0
    """A colour image stamped t was taken with the depth stamped t + this [s]."""
    up: str | None = None
    """The axis of the stated world that points up: z, -z, y or -y; None = as it is."""

    def __post_init__(self) -> None:
        """Raises ConfigError for a value that cannot be."""
        if self.convention not in CONVENTIONS:
            raise ConfigError(f"--poses is '{self.convention}'; choose one of {', '.join(CONVENTIONS)}.")
        if len(self.axes) != 3 or {frozenset(pair) & set(self.axes) for pair in ("RL", "DU", "FB")} != {
            frozenset(letter) for letter in self.axes
        }:
            raise ConfigError(
                f"--axes is '{self.axes}'; say where x, y and z of the camera point, as in RDF (right, down, forward: "
                "OpenCV), RUB (right, up, back: OpenGL) or FLU (forward, left, up: ROS)."
            )
        for name, value in (("--pose-scale", self.pose_scale), ("--depth-scale", self.depth_scale)):
            if not LEAST_FACTOR <= value <= LARGEST_FACTOR:
                raise ConfigError(f"{name} is {value:g}; give a positive factor.")
        for name, value in (("--time-offset", self.time_offset_s), ("--colour-offset", self.colour_offset_s)):
            if not abs(value) <= 1e10:
                raise ConfigError(f"{name} is {value:g}; give seconds.")

    def __bool__(self) -> bool:
        """Whether anything is changed."""
        return self != Correction()

    def changes(self) -> dict[str, Any]:
        """The fields that change something, by name."""
        return {name: value for name, value in vars(self).items() if value != getattr(Correction, name)}


def combined(before: Correction, found: Correction) -> Correction:
    """One correction for two: what was found in images and times that one before had put right. ``before`` changes no
    convention, no axes and no up.
    """
    factors = ("pose_scale", "depth_scale", "focal_scale")
    return replace(
        found,
        **{name: getattr(before, name) * getattr(found, name) for name in factors},
        ray_depth=before.ray_depth != found.ray_depth,
        mirrored=before.mirrored != found.mirrored,
        time_offset_s=before.time_offset_s + found.time_offset_s,
        colour_offset_s=before.colour_offset_s + found.colour_offset_s,
    )


def axes_matrix(axes: str) -> Float64[np.ndarray, "3 3"]:
    """Takes coordinates in the stated camera axes to x right, y down, z forward."""
    return np.array([_DIRECTIONS[letter] for letter in axes]).T


def all_axes() -> tuple[str, ...]:
    """The 48 ways to name three axes, those with a name first."""
    triples = ("".join(letters) for letters in itertools.product(_DIRECTIONS, repeat=3))
    others = (axes for axes in triples if axes not in AXES_NAMES and abs(np.linalg.det(axes_matrix(axes))) > 0.5)
    return (*AXES_NAMES, *others)


def is_left_handed(axes: str) -> bool:
    """Whether the axes are a mirror image of OpenCV's."""
    return bool(np.linalg.det(axes_matrix(axes)) < 0.0)


def converted(poses: Float[np.ndarray, "n 4 4"], convention: str) -> Float64[np.ndarray, "n 4 4"]:
    """Poses of cameras in the world from stated ones of a convention."""
    poses = np.asarray(poses, np.float64)
    if convention == "camera-to-world":
        return poses
    if convention == "world-to-camera":
        return inverse(poses)
    found = poses.copy()
    if convention == "conjugate":
        found[:, :3, :3] = poses[:, :3, :3].transpose(0, 2, 1)
        return found
    quaternion = Rotation.from_matrix(poses[:, :3, :3]).as_quat()[:, [1, 2, 3, 0]]
    found[:, :3, :3] = Rotation.from_quat(quaternion).as_matrix()
    return inverse(found) if convention == "scalar-first-inverse" else found


def inverse(poses: Float64[np.ndarray, "n 4 4"]) -> Float64[np.ndarray, "n 4 4"]:
    """Inverses of rigid transforms."""
    found = poses.copy()
    found[:, :3, :3] = poses[:, :3, :3].transpose(0, 2, 1)
    found[:, :3, 3] = -np.einsum("nji,nj->ni", poses[:, :3, :3], poses[:, :3, 3])
    return found


def with_axes(poses: Float64[np.ndarray, "n 4 4"], axes: str) -> Float64[np.ndarray, "n 4 4"]:
    """Poses of a camera with x right, y down, z forward, from poses of one with other axes.

    Left-handed axes come from a left-handed world; it is mirrored along x.
    """
    if axes == OPENCV:
        return poses
    turn = np.eye(4)
    turn[:3, :3] = axes_matrix(axes).T
    found = poses @ turn
    return _MIRROR_WORLD @ found if is_left_handed(axes) else found


def corrected_camera(camera: Intrinsics, correction: Correction) -> Intrinsics:
    """The camera with its true focal length."""
    scale = correction.focal_scale
    return replace(camera, fx=camera.fx * scale, fy=camera.fy * scale)


def corrected_sequence(sequence: Sequence, correction: Correction) -> Sequence:
    """The sequence with a correction applied; its up axis is the reader's affair. Poses of another time are
    interpolated between those of the frames; frames before the first pose or after the last one are left out. A colour
    image is taken from the frame whose time comes nearest. Raises RunFolderError if no frame is left.
    """
    if not correction:
        return sequence
    frames = sequence.frames
    times = np.array([frame.time_s for frame in frames])
    poses = with_axes(
        converted(np.array([frame.T_world_camera for frame in frames]), correction.convention), correction.axes
    )
    kept = np.arange(len(frames))
    if correction.time_offset_s:
        wanted = times + correction.time_offset_s
        kept = np.flatnonzero((wanted >= times.min()) & (wanted <= times.max()))
        poses = at_times(poses, times, wanted)
    colours = _colours(times, correction.colour_offset_s)
    kept = kept[colours[kept] >= 0]
    if not len(kept):
        raise RunFolderError(
            f"No frame of {sequence.path} has colour and pose with time offsets of {correction.time_offset_s:g} s "
            f"for poses and {correction.colour_offset_s:g} s for colour; give smaller ones."
        )
    poses[:, :3, 3] *= correction.pose_scale
    new = tuple(
        replace(
            frames[k],
            colour=frames[colours[k]].colour,
            T_world_camera=poses[k],
            camera=None if (own := frames[k].camera) is None else corrected_camera(own, correction),
        )
        for k in kept.tolist()
    )
    guessed = set(sequence.interpolated)
    return replace(
        sequence,
        frames=new,
        intrinsics=corrected_camera(sequence.intrinsics, correction),
        depth_scale=sequence.depth_scale * correction.depth_scale,
        ray_depth=sequence.ray_depth != correction.ray_depth,
        mirrored=sequence.mirrored != correction.mirrored,
        colour_offset_s=sequence.colour_offset_s + correction.colour_offset_s,
        interpolated=tuple(at for at, k in enumerate(kept.tolist()) if k in guessed),
    )


def _colours(times: np.ndarray, offset_s: float) -> np.ndarray:
    """Of each frame, the one whose colour image belongs to its depth; -1 where there is none."""
    if not offset_s:
        return np.arange(len(times))
    order = np.argsort(times, kind="stable")
    taken = (times[order] + offset_s).tolist()
    half = 0.5 * float(np.median(np.diff(times[order]))) if len(times) > 1 else 0.0
    nearest = [nearest_index(taken, time, half * 1.01) for time in times.tolist()]
    return np.array([-1 if at is None else order[at] for at in nearest])
