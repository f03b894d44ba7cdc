"""The trajectory of a run as TUM and KITTI files."""

from pathlib import Path

from anm_mj.io.read_run import Run
from anm_mj.io.sequence_poses import base_line, camera_line
from anm_mj.io.write import writing


def export_tum(run: Run, out: Path) -> list[Path]:
    """``trajectory_camera.tum`` and ``trajectory_base.tum``: ``time_s x y z qx qy qz qw`` per frame of known pose."""
    camera, base = out / "trajectory_camera.tum", out / "trajectory_base.tum"
    with writing(camera):
        lines = (camera_line(frame.image_time_s, frame.T_world_camera) for frame in run.posed_frames)
        camera.write_text("".join(f"{line}\n" for line in lines))
        # The run's own file may end within a line, where the run was cut off.
        lines = (base_line(frame.time_s, frame.pose) for frame in run.posed_frames)
        base.write_text("".join(f"{line}\n" for line in lines))
    return [camera, base]


def export_kitti(run: Run, out: Path) -> list[Path]:
    """``trajectory_camera.kitti.txt``: the upper three rows of ``T_world_camera``, row by row; a line is a frame of
    known pose.
    """
    path = out / "trajectory_camera.kitti.txt"
    with writing(path):
        lines = (" ".join(f"{value:.9g}" for value in frame.T_world_camera[:3].ravel()) for frame in run.posed_frames)
        path.write_text("".join(f"{line}\n" for line in lines))
    return [path]
