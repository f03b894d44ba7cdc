"""Sequences whose poses are not used, or have gaps."""

import json

import numpy as np
import pytest

from anm_mj.cli.main import main
from anm_mj.io.jsonl import read_jsonl
from anm_mj.io.sequence_layouts import SequenceOptions, open_sequence
from tests.io.bags import base_of, images, odometry, seen, write_bag
from tests.io.test_sequence_layouts import write_ours
from tests.recorded.layouts import write_arkitscenes, write_icl

IGNORED = SequenceOptions(needs_poses=False, ignores_poses=True, floor_m=0.0)
TRACKED = SequenceOptions(needs_poses=False)


@pytest.fixture
def walk(tmp_path):
    """Of six frames, whose fourth line is no pose, and whose last one is missing."""
    write_ours(tmp_path / "walk")
    poses = tmp_path / "walk" / "poses.tum"
    lines = poses.read_text().splitlines()[:5]
    lines[3] = "nan " * 8
    poses.write_text("\n".join(lines) + "\n")
    return tmp_path / "walk"


def test_gaps_in_our_own_layout_are_bridged_where_poses_are_a_prior(walk):
    sequence, _ = open_sequence(walk, TRACKED)
    assert sequence.has_poses
    assert sequence.interpolated == (3, 5)
    times = [frame.time_s for frame in sequence.frames]
    assert times[3] == pytest.approx((times[2] + times[4]) / 2.0)
    assert times[5] == pytest.approx(times[4] + 1.0 / 30.0)
    places = [frame.T_world_camera[:3, 3] for frame in sequence.frames]
    np.testing.assert_allclose(places[3], (places[2] + places[4]) / 2.0, atol=1e-6)
    np.testing.assert_allclose(places[5], places[4])


def test_images_do_not_need_a_pose_that_is_not_used(walk):
    sequence, _ = open_sequence(walk, IGNORED)
    assert (len(sequence), sequence.has_poses) == (6, False)
    assert len(open_sequence(walk, SequenceOptions(max_bad=0.5))[0]) == 4


def test_a_bag_need_not_say_where_the_camera_stands_on_the_robot(tmp_path):
    said = [("/odom", one.time_s + 100.0, odometry(one.time_s + 100.0, base_of(one))) for one in seen()]
    sequence, _ = open_sequence(write_bag(tmp_path / "bag", images() + said), IGNORED)
    assert (len(sequence), sequence.has_poses) == (5, False)


@pytest.mark.parametrize(
    ("write", "poses"), [(write_icl, "livingRoom0.gt.freiburg"), (write_arkitscenes, "lowres_wide.traj")]
)
def test_poses_that_begin_late_cost_no_image_where_they_are_not_used(tmp_path, write, poses):
    write(tmp_path, seen())
    lines = (tmp_path / poses).read_text().splitlines()
    (tmp_path / poses).write_text("\n".join(lines[-2:]) + "\n")
    assert len(open_sequence(tmp_path, SequenceOptions(max_bad=1.0, floor_m=0.0, max_gap_s=0.11))[0]) < 6
    assert len(open_sequence(tmp_path, IGNORED)[0]) == 6


def test_a_run_is_mapped_again_without_the_frames_whose_pose_the_robot_did_not_know(tmp_path):
    run = tmp_path / "run"
    assert main(["explore", "flat", "--steps", "4", "--policy", "random", "--preset", "quick", "--out", str(run)]) == 0
    lines = read_jsonl(run / "frames.jsonl")
    lines[0]["localisation"] = {"state": "LOST", "usable": False}
    lines[1]["localisation"] = {"state": "TRACKING", "usable": False}
    (run / "frames.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))

    known, _ = open_sequence(run)
    assert len(known) == len(lines) - 2
    assert known.left_out[0].frames == 2
    assert len(open_sequence(run, IGNORED)[0]) == len(lines)
