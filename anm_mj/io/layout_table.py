"""The kinds of folders that recorded sequences come in, but for bags."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from anm_mj.errors import RunFolderError
from anm_mj.io.matrix_sequence import read_open3d, read_scannet, read_seven_scenes
from anm_mj.io.nerfstudio_sequence import read_nerfstudio
from anm_mj.io.own_sequence import read_sequence
from anm_mj.io.phone_sequence import read_polycam, read_record3d, read_stray
from anm_mj.io.read_run import read_run
from anm_mj.io.replica_sequence import read_replica
from anm_mj.io.sequence import Frame, LeftOut, Sequence
from anm_mj.io.timed_sequence import read_arkitscenes, read_icl
from anm_mj.io.tum_sequence import read_tum


def _run(folder: Path, *, ignores_poses: bool) -> Sequence:
    run = read_run(folder)
    with_images = [frame for frame in run.frames if run.folder.image(frame.step).is_file()]
    if not with_images:
        raise RunFolderError(f"{folder} keeps no colour images, so it cannot be mapped again.")
    # The pose of a robot that was lost may even be of another world.
    kept = [frame for frame in with_images if ignores_poses or (frame.is_mapped and not frame.is_lost)]
    lost = LeftOut(len(with_images) - len(kept), len(with_images), "the robot did not know their pose", bad=0)
    frames = tuple(
        Frame(frame.image_time_s, run.folder.image(frame.step), run.folder.depth(frame.step), frame.T_world_camera)
        for frame in kept
    )
    return Sequence(folder, run.intrinsics, 0.001, frames, resize=True, keeps_corner_pixels=True, left_out=(lost,))


@dataclass(frozen=True)
class Layout:
    """How a kind of sequence is recognised and read."""

    sign: str
    """A file that only this layout has; alternatives between bars, asterisks for any letters."""
    read: Callable[..., Sequence]
    """From its folder, and ``options`` by name."""
    unposed: str | None = None
    """A file that it has even without poses; None = it always has them."""
    ours: bool = False
    """Whether the floor is at z = 0 by definition."""
    up: str = "z"
    """Axis of its world that points up."""
    needs: tuple[str, ...] = ()
    """What else has to be there; alternatives between bars."""
    options: tuple[str, ...] = ()
    """Fields of :class:`~anm_mj.io.sequence.SequenceOptions` that decide which of its frames are read: how images and
    poses of different times belong together, and whether poses are needed."""

    @property
    def unposed_sign(self) -> str:
        """How it is recognised where poses are not needed."""
        return self.unposed or self.sign


def is_there(folder: Path, names: str) -> bool:
    """Whether a folder has a file of one of the names."""
    return any(next(folder.glob(name), None) is not None for name in names.split("|"))


LAYOUTS = {
    "run": Layout("frames.jsonl", _run, ours=True, options=("ignores_poses",)),
    "anm-mj": Layout("poses.tum", read_sequence, "camera.json", ours=True, options=("needs_poses", "ignores_poses")),
    "tum": Layout(
        "groundtruth.txt",
        read_tum,
        "depth.txt",
        needs=("rgb.txt", "depth.txt"),
        options=("needs_poses", "match_s", "max_gap_s"),
    ),
    "nerfstudio": Layout("transforms.json", read_nerfstudio),
    "replica": Layout("traj.txt", read_replica),
    "7scenes": Layout("frame-*.pose.txt", read_seven_scenes, needs=("frame-*.color.png", "frame-*.depth.png")),
    "scannet": Layout("intrinsic/intrinsic_depth.txt", read_scannet, needs=("color", "depth", "pose")),
    "stray": Layout("odometry.csv", read_stray, up="y", needs=("camera_matrix.csv", "depth", "rgb|rgb.mp4")),
    "polycam": Layout("keyframes/cameras", read_polycam, up="y", needs=("keyframes/images", "keyframes/depth")),
    "record3d": Layout(
        "metadata.json|EXR_RGBD/metadata.json",
        read_record3d,
        up="y",
        needs=("rgb|EXR_RGBD/rgb", "depth|EXR_RGBD/depth"),
    ),
    "arkitscenes": Layout(
        "lowres_wide.traj",
        read_arkitscenes,
        needs=("lowres_wide", "lowres_depth", "lowres_wide_intrinsics"),
        options=("match_s", "max_gap_s", "ignores_poses"),
    ),
    "icl": Layout(
        "*.gt.freiburg",
        read_icl,
        up="y",
        needs=("associations.txt", "rgb", "depth"),
        options=("max_gap_s", "ignores_poses"),
    ),
    "open3d": Layout("trajectory.log|scene/trajectory.log", read_open3d, up="-y", needs=("color|image|rgb", "depth")),
}
