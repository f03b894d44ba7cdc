"""Puts a recorded sequence right."""

from dataclasses import replace

import numpy as np

from anm_mj.errors import RunFolderError
from anm_mj.io.sequence import Sequence
from anm_mj.io.sequence_poses import at_times, nearest_index
from anm_mj.sequence_check.correction import Correction, converted, corrected_camera, with_axes


def corrected_sequence(sequence: Sequence, correction: Correction) -> Sequence:
    """The sequence with a correction applied; its up axis is the reader's affair. Raises RunFolderError if no frame is
    left.

    Args:
        sequence: As its files state it.
        correction: What is put right. Poses of another time are interpolated between those of the frames; frames
            before the first pose or after the last one are left out. A colour image is taken from the frame whose time
            comes nearest.
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
