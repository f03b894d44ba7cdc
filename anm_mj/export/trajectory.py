"""The trajectory of a run as TUM and KITTI files."""

from pathlib import Path

from anm_mj.io.read_run import Run
from anm_mj.io.sequence_poses import camera_line
from anm_mj.io.write import reading, writing
from anm_mj.utils.read_file import read_text


def export_tum(run: Run, out: Path) -> list[Path]:
    """``trajectory_camera.tum`` and ``trajectory_base.tum``: ``time_s x y z qx qy qz qw`` per frame of known pose."""
    camera, base = out / "trajectory_camera.tum", out / "trajectory_base.tum"
    with reading(run.folder.trajectory, remedy="copy the run again"):
        believed = read_text(run.folder.trajectory)
    with writing(camera):
        lines = (camera_line(frame.image_time_s, frame.T_world_camera) for frame in run.posed_frames)
        camera.write_text("".join(f"{line}\n" for line in lines))
        base.write_text(believed)
    return [camera, base]


def export_kitti(run: Run, out: Path) -> list[Path]:
    """``trajectory_camera.kitti.txt``: the upper three rows of ``T_world_camera``, row by row; a line is a frame of
    known pose.
    """
    path = out / "trajectory_camera.kitti.txt"
    with writing(path):
        lines = (" ".join(f"{value:.9g}" for value in frame.T_world_camera[:3].ravel()) for frame in run.posed_frames)
        path.write_text("\n".join(lines) + "\n")
    return [path]
