"""Reads data sets whose images and poses have times of their own: ARKitScenes, and ICL-NUIM."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from anm_mj.errors import RunFolderError
from anm_mj.io.bag_poses import Track
from anm_mj.io.sequence import FRAME_S, Frame, LeftOut, Sequence, from_pixel_centres, require_count, with_cameras
from anm_mj.io.sequence_poses import nearest_index
from anm_mj.io.sequence_text import files_in_order, number_rows, rows, with_slashes
from anm_mj.types import Intrinsics

_ICL_CAMERA = (481.2, 480.0, 319.5, 239.5)
"""fx, -fy, cx, cy [px] of ICL-NUIM, from its documentation: there, y of the camera points up."""
_ICL_SIZE = (640, 480)


def read_arkitscenes(folder: Path, *, match_s: float, max_gap_s: float, ignores_poses: bool = False) -> Sequence:
    """ARKitScenes: ``lowres_wide/``, ``lowres_depth/``, ``lowres_wide_intrinsics/``, ``confidence/`` and poses. Images,
    cameras and confidences belong to a depth image up to a difference of ``match_s``; poses are interpolated between
    two that lie no farther apart than ``max_gap_s``, or all at the origin where it ``ignores_poses``. Raises OSError,
    ValueError or RunFolderError if the poses or a camera are damaged, or no frame is whole.
    """
    lines = number_rows(folder / "lowres_wide.traj", 7)
    # Stated is where the world is in the camera.
    camera_world = Rotation.from_rotvec(lines[:, 1:4]).inv()
    poses = np.concatenate([-camera_world.apply(lines[:, 4:]), camera_world.as_quat()], axis=1)
    track = Track("lowres_wide.traj", lines[:, 0].tolist(), list(poses), gap_s=max_gap_s)
    depths, colours, stated, trusts = (
        _by_time(folder / name, suffix)
        for name, suffix in (
            ("lowres_depth", ".png"),
            ("lowres_wide", ".png"),
            ("lowres_wide_intrinsics", ".pincam"),
            ("confidence", ".png"),
        )
    )
    require_count(len(depths))
    frames, cameras, alone = [], [], 0
    for time_s, depth in depths.items():
        colour, pincam = _near(colours, time_s, match_s), _near(stated, time_s, match_s)
        pose = np.eye(4) if ignores_poses else track.at(time_s)
        if colour is None or pincam is None:
            alone += 1
        elif pose is not None:
            frames.append(Frame(time_s, colour, depth, pose, _near(trusts, time_s, match_s)))
            cameras.append(_pincam(pincam))
    left_out = (
        LeftOut(alone, len(depths), f"no colour image or camera is near their depth in time ({match_s:g} s, --match)"),
        LeftOut(len(depths) - alone - len(frames), len(depths), "no pose is known at their time (--max-gap)"),
    )
    if not frames:
        raise RunFolderError(f"{folder} holds no frame that has colour, depth, a camera and a pose.")
    camera, whole = with_cameras(frames, cameras)
    return Sequence(folder, camera, 0.001, whole, resize=True, left_out=left_out)


def read_icl(folder: Path, *, max_gap_s: float, ignores_poses: bool = False) -> Sequence:
    """ICL-NUIM as TUM's tools read it: ``associations.txt``, ``depth/``, ``rgb/`` and a file ``*.gt.freiburg``.

    Its world is left-handed, as its camera is; here, it is mirrored along x. Poses are interpolated between two that
    lie no farther apart than ``max_gap_s``, or all at the origin where it ``ignores_poses``. Raises OSError, ValueError
    or RunFolderError if a list is damaged, or no frame is whole.
    """
    lines = number_rows(files_in_order(folder, "*.gt.freiburg")[0], 8)
    track = Track("the poses", (lines[:, 0] * FRAME_S).tolist(), list(lines[:, 1:]), gap_s=max_gap_s)
    mirror, flip = np.diag([-1.0, 1.0, 1.0, 1.0]), np.diag([1.0, -1.0, 1.0, 1.0])
    listed = [line.split() for line in rows(folder / "associations.txt")]
    require_count(len(listed))
    frames = []
    for number, one, _, other in listed:
        names = (other, one) if "depth" in one else (one, other)
        colour, depth = (folder / with_slashes(name) for name in names)
        time_s = float(number) * FRAME_S
        pose = np.eye(4) if ignores_poses else track.at(time_s)
        if pose is not None:
            frames.append(Frame(time_s, colour, depth, mirror @ pose @ flip))
    left_out = LeftOut(len(listed) - len(frames), len(listed), "no pose is known at their time (--max-gap)")
    camera = from_pixel_centres(*_ICL_SIZE, _ICL_CAMERA)
    return Sequence(folder, camera, 1.0 / 5000.0, tuple(frames), resize=True, left_out=(left_out,))


def _by_time(folder: Path, suffix: str) -> dict[float, Path]:
    """Files by the time at the end of their names, in order."""
    files = files_in_order(folder, f"*{suffix}")
    return dict(sorted((float(path.stem.rpartition("_")[2]), path) for path in files))


def _near(files: Mapping[float, Path], time_s: float, match_s: float) -> Path | None:
    times = list(files)
    index = nearest_index(times, time_s, match_s)
    return None if index is None else files[times[index]]


def _pincam(path: Path) -> Intrinsics:
    numbers = number_rows(path).ravel().tolist()
    if len(numbers) != 6:
        raise ValueError(f"{path.name} holds {len(numbers)} numbers, not width height fx fy cx cy")
    return Intrinsics(int(numbers[0]), int(numbers[1]), *numbers[2:])
