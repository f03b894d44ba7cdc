"""The kinds of folders that recorded sequences come in, but for bags."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from anm_mj.errors import RunFolderError
from anm_mj.io.matrix_sequence import read_scannet, read_seven_scenes
from anm_mj.io.nerfstudio_sequence import read_nerfstudio
from anm_mj.io.own_sequence import read_sequence
from anm_mj.io.read_run import read_run
from anm_mj.io.replica_sequence import read_replica
from anm_mj.io.sequence import Frame, Sequence
from anm_mj.io.tum_sequence import read_tum


def _run(folder: Path) -> Sequence:
    run = read_run(folder)
    kept = [frame for frame in run.frames if run.folder.image(frame.step).is_file()]
    if not kept:
        raise RunFolderError(f"{folder} keeps no colour images, so it cannot be mapped again.")
    frames = tuple(
        Frame(frame.time_s, run.folder.image(frame.step), run.folder.depth(frame.step), frame.T_world_camera)
        for frame in kept
    )
    return Sequence(folder, run.intrinsics, 0.001, frames, resize=True, keeps_corner_pixels=True)


@dataclass(frozen=True)
class Times:
    """How images and poses of different times belong together."""

    needs_poses: bool
    """Whether frames without a pose are left out; else they are interpolated, or there are none at all."""
    match_s: float
    """Colour and depth belong together up to this difference [s]."""
    max_gap_s: float
    """Poses are interpolated between two that lie no farther apart [s]."""


@dataclass(frozen=True)
class Layout:
    """How a kind of sequence is recognised and read."""

    sign: str
    """A file that only this layout has."""
    read: Callable[[Path, Times], Sequence]
    """From its folder."""
    unposed: str | None = None
    """A file that it has even without poses; None = it always has them."""
    ours: bool = False
    """Whether the floor is at z = 0 by definition."""

    @property
    def signs(self) -> tuple[str, str]:
        """How it is recognised, with and without poses."""
        return self.sign, self.unposed_sign

    @property
    def unposed_sign(self) -> str:
        """How it is recognised where poses are not needed."""
        return self.unposed or self.sign


LAYOUTS = {
    "run": Layout("frames.jsonl", lambda folder, _: _run(folder), ours=True),
    "anm-mj": Layout(
        "poses.tum",
        lambda folder, times: read_sequence(folder, needs_poses=times.needs_poses),
        "camera.json",
        ours=True,
    ),
    "tum": Layout("groundtruth.txt", lambda folder, times: read_tum(folder, **asdict(times)), "depth.txt"),
    "nerfstudio": Layout("transforms.json", lambda folder, _: read_nerfstudio(folder)),
    "replica": Layout("traj.txt", lambda folder, _: read_replica(folder)),
    "7scenes": Layout("frame-000000.pose.txt", lambda folder, _: read_seven_scenes(folder)),
    "scannet": Layout("intrinsic/intrinsic_depth.txt", lambda folder, _: read_scannet(folder)),
}
