"""The error of a tracked camera against poses that somebody else measured, in a world and at times of their own."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from anm_mj.errors import RunFolderError
from anm_mj.evaluation.trajectory_error import (
    alignment,
    is_exact,
    read_reference,
    reference_error,
    trajectory_error,
    warn_of_assumed_times,
)
from anm_mj.frames import move_pose, pose_matrix
from anm_mj.io.run_records import FrameRecord
from anm_mj.io.sequence_poses import base_pose, camera_line
from anm_mj.types import Pose2


def pose(t):
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0.1 * t, 0.3 * t, -0.2 * t]).as_matrix()
    T[:3, 3] = [0.5 * t, 0.2 * np.sin(t), 1.0]
    return T


ELSEWHERE = np.eye(4)
ELSEWHERE[:3, :3] = Rotation.from_rotvec([0.4, -1.0, 0.7]).as_matrix()
ELSEWHERE[:3, 3] = [7.0, -3.0, 2.0]


@pytest.fixture
def reference(tmp_path):
    """Every 10 ms, from 0 to 3 s, in another world."""
    path = tmp_path / "reference.tum"
    times = 0.005 + 0.01 * np.arange(300)
    path.write_text("# time x y z qx qy qz qw\n" + "".join(f"{camera_line(t, ELSEWHERE @ pose(t))}\n" for t in times))
    return read_reference(path)


def error_of(records, reference):
    found = reference_error(records, reference)
    assert found is not None
    return found


def frames(error=None, lost=(), last_s=3.0):
    records = []
    for step, t in enumerate(np.arange(0.1, last_s, 0.1).tolist()):
        T = pose(t)
        if error is not None:
            T = T.copy()
            T[:3, 3] += error(t)
        records.append(FrameRecord(step, t, base_pose(T), T, base_pose(T), T, step in lost, step not in lost))
    return records


def test_the_same_trajectory_in_another_world_has_no_error(reference):
    found = error_of(frames(), reference)
    assert found.position_rmse_cm < 0.01  # Interpolated over 10 ms.
    assert found.ate_rmse_cm < 0.01
    assert found.final_position_error_cm < 0.01
    assert found.lost_percent == 0.0


def test_a_reference_that_begins_late_is_not_held_before(reference):
    reference.times_s, reference.poses = reference.times_s[45:], reference.poses[45:]
    found = error_of(frames(), reference)
    assert found.position_rmse_cm < 0.01
    assert found.final_position_error_cm < 0.01
    # Times are written in microseconds.
    assert reference.at(reference.times_s[0] - 1e-6) is not None
    assert reference.at(reference.times_s[-1] + 1e-6) is not None
    assert reference.at(reference.times_s[0] - 0.1) is None


def test_errors_are_measured_from_the_first_pose_and_after_alignment(reference):
    # From the second frame on everything lies 10 cm to the side.
    found = error_of(frames(lambda t: np.array([0.0, 0.1 * (t > 0.15), 0.0])), reference)
    count = len(frames())
    assert found.position_rmse_cm == pytest.approx(10.0 * np.sqrt((count - 1) / count), rel=1e-3)
    assert found.ate_rmse_cm < 2.0
    assert found.final_position_error_cm == pytest.approx(10.0, rel=1e-3)


def test_drift_over_a_metre_is_not_that_of_a_way_on_which_the_robot_was_lost():
    """It follows its way exactly, is lost on a circle of 13 m, and goes on from where it began, turned by 6 degrees."""
    true, believed, records = Pose2(0.0, 0.0, 0.0), Pose2(0.0, 0.0, 0.0), []
    for step in range(400):
        is_lost = 100 <= step < 300
        true = move_pose(true, 0.065, math.tau / 200 * is_lost)
        believed = move_pose(believed, 0.065, (math.tau / 200 + 0.0005) * is_lost)
        poses = believed, pose_matrix(believed), true, pose_matrix(true)
        records.append(FrameRecord(step, 0.2 * step, *poses, is_lost=is_lost))
    found = trajectory_error(records)
    assert found.rpe_cm_per_m == pytest.approx(0.0, abs=1e-6)
    assert found.rpe_deg_per_m == pytest.approx(0.0, abs=1e-6)
    assert found.rpe_deg_per_quarter_turn is None
    assert found.final_heading_error_deg == pytest.approx(math.degrees(0.1))


def test_nine_turns_by_ten_degrees_are_a_quarter_turn():
    records = []
    for step in range(73):
        true, believed = np.eye(4), np.eye(4)
        true[:3, :3], believed[:3, :3] = (
            Rotation.from_euler("z", step * deg, degrees=True).as_matrix() for deg in (10.0, 10.1)
        )
        records.append(FrameRecord(step, 0.1 * step, base_pose(believed), believed, base_pose(true), true))
    assert trajectory_error(records).rpe_deg_per_quarter_turn == pytest.approx(0.9, rel=1e-6)


@pytest.mark.parametrize("length_m", [0.0, 0.2, 1.3])
def test_what_positions_leave_open_is_not_turned(length_m):
    """A robot that turns about its camera's axis, or drives straight on, with errors of millimetres."""
    rng = np.random.default_rng(0)
    for yaw in np.linspace(0.0, 6.0, 20):
        along = np.linspace(0.0, length_m, 40)[:, None]
        true = np.array([2.0, -1.0, 1.25]) + along * [np.cos(yaw), np.sin(yaw), 0.0]
        true[:, :2] += rng.normal(0.0, 0.001, (40, 2))
        believed = true.copy()
        believed[:, :2] += rng.normal(0.0, 0.004, (40, 2))
        T = alignment(believed, true)
        assert np.linalg.norm(Rotation.from_matrix(T[:3, :3]).as_rotvec()) < 0.1
        np.testing.assert_allclose(T @ [*believed.mean(axis=0), 1.0], [*true.mean(axis=0), 1.0])


def test_a_trajectory_that_spreads_is_turned_by_what_it_says():
    true = np.stack([pose(t)[:3, 3] for t in np.arange(0.1, 3.0, 0.1)])
    turned = true @ ELSEWHERE[:3, :3].T + ELSEWHERE[:3, 3]
    np.testing.assert_allclose(alignment(true, turned), ELSEWHERE, atol=1e-9)


def test_lost_frames_count_in_their_share_alone(reference):
    wrong = frames(lambda t: np.array([5.0 * (0.95 < t < 1.25), 0.0, 0.0]), lost=(9, 10, 11))
    found = error_of(wrong, reference)
    assert found.position_rmse_cm < 0.01
    assert found.lost_percent == pytest.approx(100.0 * 3 / len(wrong))
    assert found.unmapped_percent == found.lost_percent


def test_exact_poses_have_errors_of_nothing_and_lost_frames_count_all_the_same():
    lost = frames(lost=range(10, 29))
    assert is_exact(frames())
    assert not is_exact(lost)
    found = trajectory_error(lost)
    assert found.lost_percent == pytest.approx(100.0 * 19 / 29)
    assert found.position_rmse_cm == 0.0


def test_a_reference_that_is_the_trajectory_itself_has_no_error(tmp_path):
    path = tmp_path / "still.tum"
    path.write_text("".join(camera_line(0.1 * k, np.eye(4)) + "\n" for k in range(5)))
    still = [FrameRecord(k, 0.1 * k, *2 * (base_pose(np.eye(4)), np.eye(4))) for k in range(5)]
    assert error_of(still, read_reference(path)).position_rmse_cm == 0.0


def test_loops_count_where_the_reference_has_no_pose_too(reference):
    beyond = frames(last_s=4.0)
    closing = [*beyond[:-1], replace(beyond[-1], closes_loop=True)]
    assert error_of(closing, reference).loops_closed == 1


def test_a_reference_of_other_times_says_nothing(reference, tmp_path):
    assert reference_error(frames(last_s=0.25), reference) is None
    late = [FrameRecord(f.step, f.time_s + 100.0, f.pose, f.T_world_camera, f.pose, f.T_world_camera) for f in frames()]
    assert reference_error(late, reference) is None


@pytest.mark.parametrize("text", ["1 2 3\n", "a b c d e f g h\n", "0 0 0 0 0 0 0 nan\n"])
def test_what_is_no_trajectory_is_one_sentence(tmp_path, text):
    (tmp_path / "poses.tum").write_text(text)
    with pytest.raises(RunFolderError, match="cannot be read as poses in TUM format"):
        read_reference(tmp_path / "poses.tum")
    with pytest.raises(RunFolderError, match="cannot be read"):
        read_reference(tmp_path / "none.tum")


@pytest.mark.parametrize(("step_s", "told"), [(0.1, False), (0.0731, True)])
def test_a_reference_of_other_times_than_those_that_frames_are_given_is_named(step_s, told, tmp_path, caplog):
    path = tmp_path / "poses.tum"
    path.write_text("".join(camera_line(step_s * k, np.eye(4)) + "\n" for k in range(4)))
    warn_of_assumed_times([k / 30.0 for k in range(4)], read_reference(path))
    assert ("whole multiples of 1/30 s" in caplog.text) == told
    caplog.clear()
    warn_of_assumed_times([0.0, 0.04, 0.07], read_reference(path))
    assert not caplog.text


def test_a_reference_is_read_as_the_poses_of_a_sequence_are(tmp_path, caplog):
    """With commas, in nanoseconds, a line of nan among them, one pose a second."""
    path = tmp_path / "groundtruth.txt"
    start_s = 1_700_000_000
    lines = [camera_line(start_s + t, pose(float(t))).split() for t in range(4)]
    lines.insert(2, [str(start_s + 1.5), *["nan"] * 7])
    path.write_text("".join(f"{round(float(line[0]) * 1e9)},{','.join(line[1:])}\n" for line in lines))
    records = [replace(record, time_s=record.time_s + start_s) for record in frames()]
    assert reference_error(records, read_reference(path)) is None
    assert error_of(records, read_reference(path, max_gap_s=2.0)).ate_rmse_cm < 2.0
    assert "1 of 5 lines are no poses" in caplog.text
