"""Bags are written by the package rosbags as drivers publish, and read back as the frames that they were made from."""

import math
import sqlite3
from dataclasses import replace

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin

from anm_mj.cli.main import main
from anm_mj.errors import RunFolderError
from anm_mj.io.rosbag import is_rectified
from anm_mj.io.sequence_floor import find_floor_m
from anm_mj.io.sequence_layouts import SequenceOptions, open_sequence
from anm_mj.types import Intrinsics
from tests.io.bags import (
    CAMERA,
    COLOUR,
    DEPTH,
    T_BASE_CAMERA,
    base_of,
    camera_pose,
    changed,
    check,
    header,
    images,
    make,
    odometry,
    poses_by_tf,
    seen,
    tf,
    write_bag,
    write_bag_of_ros_1,
)


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_images_calibration_and_frames(tmp_path, storage):
    path = write_bag(tmp_path / "bag", images() + poses_by_tf(), storage)
    sequence, layout = open_sequence(path, SequenceOptions(floor_m=0.0))
    assert layout == "rosbag"
    check(sequence)
    if storage is StoragePlugin.MCAP:
        (file,) = path.glob("*.mcap")
        check(open_sequence(file, SequenceOptions(floor_m=0.0))[0])


def test_the_floor_is_found(tmp_path):
    path = write_bag(tmp_path / "bag", images() + poses_by_tf())
    assert find_floor_m(open_sequence(path)[0]) == pytest.approx(0.0, abs=0.02)


def test_odometry_and_the_place_of_the_camera_on_the_robot(tmp_path):
    said = images() + [("/odom", one.time_s + 100.0, odometry(one.time_s + 100.0, base_of(one))) for one in seen()]
    fixed = ("/tf_static", 99.0, tf(99.0, "base", "optical", T_BASE_CAMERA))
    check(open_sequence(write_bag(tmp_path / "bag", [*said, fixed]), SequenceOptions(floor_m=0.0))[0])
    with pytest.raises(RunFolderError, match="record /tf_static"):
        open_sequence(write_bag(tmp_path / "lost", said))


def test_poses_of_the_camera_itself_and_topics_that_are_named(tmp_path):
    said = images() + [
        ("/vio", one.time_s + 100.0, camera_pose(one.time_s + 100.0, one.T_world_camera)) for one in seen()
    ]
    said += [("/slam", one.time_s + 100.0, camera_pose(one.time_s + 100.0, np.eye(4))) for one in seen()]
    path = write_bag(tmp_path / "bag", said)
    with pytest.raises(RunFolderError, match="--topic pose=/slam"):
        open_sequence(path)
    check(open_sequence(path, SequenceOptions(floor_m=0.0, topics={"pose": "/vio"}))[0])
    with pytest.raises(RunFolderError, match="no topic '/gps' for pose; pose could be /slam, /vio"):
        open_sequence(path, SequenceOptions(topics={"pose": "/gps"}))
    with pytest.raises(RunFolderError, match="There is no role 'color'"):
        open_sequence(path, SequenceOptions(topics={"color": "/vio"}))


@pytest.mark.parametrize("compression", [None, Writer1.CompressionFormat.LZ4, Writer1.CompressionFormat.BZ2])
def test_a_bag_of_ros_1(tmp_path, compression):
    write_bag_of_ros_1(tmp_path / "walk.bag", compression)
    check(open_sequence(tmp_path / "walk.bag", SequenceOptions(floor_m=0.0))[0], steps=range(6))


def test_what_a_bag_lacks_is_one_sentence(tmp_path, capsys):
    told = {
        "colour": ([entry for entry in images() if entry[0] != COLOUR], "no topic for colour; its topics are"),
        "camera": ([e for e in images() if "info" not in e[0]] + poses_by_tf(), "no topic for camera"),
        "pose": (images(), "no topic for pose"),
        "two": (images() + images(colour="/rear/image_raw")[1:], "several topics for colour"),
    }
    for name, (said, words) in told.items():
        assert main(["map", str(write_bag(tmp_path / name, said)), "--out", str(tmp_path / "run")]) == 2
        assert words in " ".join(capsys.readouterr().err.split())
    (tmp_path / "damaged.mcap").write_bytes(b"\x89MCAP0\r\n nothing")
    assert main(["map", str(tmp_path / "damaged.mcap"), "--out", str(tmp_path / "run")]) == 2
    assert "damaged.mcap cannot be read as a recording" in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "run").exists()


INFO = DEPTH.replace("image_raw", "camera_info")


def moved_by(message, x=0.0, w=None):
    """A pose in tf with another place and quaternion."""
    (one,) = message.transforms
    xyz = make("geometry_msgs/msg/Vector3", x=x, y=0.0, z=0.0)
    rotation = one.transform.rotation if w is None else make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=w)
    return replace(
        message, transforms=[replace(one, transform=replace(one.transform, translation=xyz, rotation=rotation))]
    )


REGION = make("sensor_msgs/msg/RegionOfInterest", x_offset=9, y_offset=9, height=20, width=20, do_rectify=False)


@pytest.mark.parametrize(
    ("topic", "change", "words"),
    [
        (INFO, lambda m, k: replace(m, k=m.k * (1.0 + k)), "changes in the course of the bag"),
        (INFO, lambda m, k: replace(m, roi=REGION), "a region of 20 x 20 pixels of 64 x 48"),
        (INFO, lambda m, k: replace(m, width=640, height=100), "64 x 48 pixels, which is none of a camera"),
        (COLOUR, lambda m, k: replace(m, encoding="mono8"), "64 pixels of 'mono8' have 64: the encoding is"),
        (COLOUR, lambda m, k: replace(m, encoding="odd") if k else m, "'odd' is no colour"),
        (DEPTH, lambda m, k: replace(m, encoding="odd") if k else m, "'odd' is no depth"),
        (DEPTH, lambda m, k: replace(m, width=0, height=0, step=0), "it has 0 x 0 pixels"),
        (DEPTH, lambda m, k: replace(m, header=header(100.0 + 0.1 * k, f"f{k}")), r"of several frames \('f0', 'f1'"),
    ],
)  # fmt: skip
def test_messages_that_do_not_fit_each_other_are_refused(tmp_path, topic, change, words):
    path = write_bag(tmp_path / "bag", changed(topic, change))
    with pytest.raises(RunFolderError, match=words):
        list(open_sequence(path, SequenceOptions(floor_m=0.0))[0].observations())


@pytest.mark.parametrize(("lacks", "named"), [("no calibration", {}), ("zeros", {}), ("zeros", {"camera": INFO})])
def test_a_camera_that_the_user_gives_stands_for_the_calibration(tmp_path, lacks, named):
    said = changed(INFO, lambda m, k: replace(m, k=np.zeros(9)))
    path = write_bag(tmp_path / "bag", [one for one in said if lacks == "zeros" or one[0] != INFO])
    camera = (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    check(open_sequence(path, SequenceOptions(floor_m=0.0, camera=camera, topics=named))[0])


def test_a_camera_that_the_user_gives_stands_for_a_damaged_calibration(tmp_path, caplog):
    path = write_bag(tmp_path / "bag", images() + poses_by_tf())
    with sqlite3.connect(next(path.glob("*.db3"))) as base:
        of_calibration = "topic_id = (SELECT id FROM topics WHERE name = ?)"
        base.execute(f"UPDATE messages SET data = substr(data, 1, 20) WHERE {of_calibration}", [INFO])
    camera = (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    check(open_sequence(path, SequenceOptions(floor_m=0.0, camera=camera))[0])
    assert "cannot be used (" in caplog.text


@pytest.mark.parametrize("has_calibration", [True, False])
def test_a_camera_topic_that_is_named_is_not_passed_over_for_the_camera_that_the_user_gives(tmp_path, has_calibration):
    said = images() + poses_by_tf()
    path = write_bag(tmp_path / "bag", [one for one in said if has_calibration or one[0] != INFO])
    camera = (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    with pytest.raises(RunFolderError, match="/none"):
        open_sequence(path, SequenceOptions(floor_m=0.0, camera=camera, topics={"camera": "/none"}))


def test_a_camera_that_the_user_gives_keeps_size_and_distortion_of_the_calibration(tmp_path):
    def stated(width, height):
        said = changed(INFO, lambda m, k: replace(m, d=np.full(5, 0.1), width=width, height=height))
        path = write_bag(tmp_path / f"{width}", said)
        return open_sequence(path, SequenceOptions(floor_m=0.0, camera=(50.0, 51.0, 60.0, 45.0)))[0]

    large = stated(128, 96)
    assert large.intrinsics == Intrinsics(128, 96, 50.0, 51.0, 60.0, 45.0)
    assert large.distortion.coefficients == (0.1,) * 5
    # A calibration of another aspect knows less about the size than the images.
    assert stated(640, 100).intrinsics == Intrinsics(64, 48, 50.0, 51.0, 60.0, 45.0)


@pytest.mark.parametrize("depth", ["/cam/depth/image_rect", "/cam/depth/image_raw"])
def test_rectified_images_are_of_another_camera_than_raw_ones(tmp_path, depth, caplog):
    def info(message, _):
        p = np.array([540.0, 0.0, 31.0, 0.0, 0.0, 550.0, 23.0, 0.0, 0.0, 0.0, 1.0, 0.0])
        return replace(message, k=np.array([600.0, 0.0, 30.0, 0.0, 610.0, 22.0, 0.0, 0.0, 1.0]), p=p)

    beside = depth.rpartition("/")[0] + "/camera_info"
    said = [({DEPTH: depth, INFO: beside}.get(topic, topic), t, m) for topic, t, m in changed(INFO, info)]
    said += [("/camera/color/camera_info", t, m) for topic, t, m in changed(beside, info, said) if topic == beside]
    other = changed(beside, lambda m, _: replace(m, p=1.5 * m.p), said)
    camera = open_sequence(write_bag(tmp_path / "bag", other), SequenceOptions(floor_m=0.0))[0].intrinsics
    if "rect" in depth:
        assert (camera.fx, camera.fy, camera.cx, camera.cy) == (540.0, 550.0, 31.5, 23.5)
    else:
        assert (camera.fx, camera.fy, camera.cx, camera.cy) == (600.0, 610.0, 30.5, 22.5)
    assert ("two calibrations differ" in caplog.text) == ("rect" in depth)
    assert is_rectified(f"{depth}/compressedDepth") == ("rect" in depth)


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ([("/tf", 100.0, tf(100.0, "map", "base", np.eye(4)))], "'base' stands in several: 'odom', 'map'"),
        ([("/tf", 100.0, tf(100.0, "optical", "odom", np.eye(4)))], "the frames go round in a circle"),
    ],
)
def test_frames_that_are_no_tree_are_refused(tmp_path, said, words):
    with pytest.raises(RunFolderError, match=words):
        open_sequence(write_bag(tmp_path / "bag", images() + poses_by_tf() + said))


def test_an_odometry_of_no_frame_or_of_several_is_refused(tmp_path):
    fixed = ("/tf_static", 99.0, tf(99.0, "base", "optical", T_BASE_CAMERA))
    for name, frame_of, words in (
        ("none", lambda step: "", "does not say of which frame"),
        ("several", lambda step: "base" if step else "optical", "tells of several: 'base', 'optical'"),
    ):
        told = [
            replace(odometry(one.time_s + 100.0, base_of(one)), child_frame_id=frame_of(one.step)) for one in seen()
        ]
        said = [("/odom", 100.0 + 0.1 * step, message) for step, message in enumerate(told)]
        with pytest.raises(RunFolderError, match=words):
            open_sequence(write_bag(tmp_path / name, [*images(), fixed, *said]))


@pytest.mark.parametrize("wrong", [{"w": 0.0}, {"w": 2.0}, {"w": math.nan}, {"x": math.nan}, {"x": 1e30}])
def test_poses_that_are_none_are_left_out(tmp_path, caplog, wrong):
    # The seventh lies half a tenth of a second before a frame.
    said = changed("/tf", lambda m, k: moved_by(m, **wrong) if k == 6 else m)
    check(open_sequence(write_bag(tmp_path / "bag", said), SequenceOptions(floor_m=0.0))[0])
    assert "1 of 18 poses of the frame 'base' are left out" in caplog.text


def test_frames_that_are_left_out_are_counted(tmp_path, caplog):
    early = [one for one in poses_by_tf() if one[1] < 100.25]
    twice = [(name, t + 50.0, message) for name, t, message in images() if name == DEPTH]
    options = SequenceOptions(floor_m=0.0, max_bad=1.0)
    path = write_bag(tmp_path / "bag", images() + early + twice)
    sequence, _ = open_sequence(path, options)
    for words in (
        "6 of 12 frames are left out, because their depth has the time of another one",
        "1 of 6 frames are left out, because no colour is within 0.02 s",
        f"{5 - len(sequence)} of 5 frames are left out, because no pose of the camera is known",
    ):
        assert words in caplog.text
    with pytest.raises(
        RunFolderError,
        match=r"more than 20 % \(--max-bad\), .*the frame 'base' is stated from 99\.950 to",
    ):
        open_sequence(path)


def test_images_that_were_recorded_at_one_time_are_told_apart(tmp_path):
    path = write_bag(tmp_path / "bag", images() + poses_by_tf())
    (file,) = path.glob("*.db3")
    with sqlite3.connect(file) as base:
        base.execute("UPDATE messages SET timestamp = 7")
    base.close()
    check(open_sequence(path, SequenceOptions(floor_m=0.0))[0])


def test_images_with_one_stamp_for_all_are_taken_at_the_times_of_their_recording(tmp_path, caplog):
    said = images() + poses_by_tf()
    for topic in (COLOUR, DEPTH):
        said = changed(topic, lambda m, k: replace(m, header=header(0.0, "optical")), said)
    path = write_bag(tmp_path / "bag", said)
    frames = list(open_sequence(path, SequenceOptions(floor_m=0.0))[0].observations())
    for found, step in zip(frames, (0, 1, 2, 4, 5), strict=True):
        made = seen()[step]
        np.testing.assert_allclose(found.T_world_camera, made.T_world_camera, atol=1e-6)
        np.testing.assert_allclose(found.depth_m, made.depth_m, atol=0.0006)
        np.testing.assert_array_equal(found.rgb, made.rgb[..., ::-1] + np.uint8(step))
        assert found.time_s == pytest.approx(made.time_s + 100.003, abs=1e-6)
    assert "have the stamp of another one: all are taken at the times of their recording" in caplog.text
    (file,) = path.glob("*.db3")
    with sqlite3.connect(file) as base:
        base.execute("UPDATE messages SET timestamp = 7")
    base.close()
    with pytest.raises(RunFolderError, match=r"5 of 6 depth images .* have the time of another one, .*; record them"):
        open_sequence(path)


def test_distortion_is_taken_out_and_depth_of_another_camera_is_said(tmp_path, caplog):
    bent = changed(INFO, lambda m, k: replace(m, d=np.full(5, 0.1)))
    said = changed(COLOUR, lambda m, k: replace(m, header=replace(m.header, frame_id="other")), bent)
    sequence, _ = open_sequence(write_bag(tmp_path / "bag", said))
    assert sequence.distortion.coefficients == (0.1,) * 5
    assert sequence.distortion.source == "by /camera/aligned_depth_to_color/camera_info"
    assert "depth is of the frame 'optical' and colour of 'other'" in caplog.text


def test_a_model_of_distortion_that_is_unknown_is_refused(tmp_path):
    said = changed(INFO, lambda m, k: replace(m, d=np.full(4, 0.1), distortion_model="division"))
    with pytest.raises(RunFolderError, match="the distortion model 'division' is none of plumb_bob"):
        open_sequence(write_bag(tmp_path / "bag", said))


def test_a_bag_without_poses_can_be_tracked(tmp_path):
    path = write_bag(tmp_path / "bag", images())
    with pytest.raises(RunFolderError, match="no topic for pose"):
        open_sequence(path)
    sequence, _ = open_sequence(path, SequenceOptions(needs_poses=False))
    assert not sequence.has_poses
    assert len(sequence) == 5


def test_a_unit_that_lifts_the_cameras_is_said(tmp_path, caplog):
    path = write_bag(tmp_path / "bag", images() + poses_by_tf())
    open_sequence(path)
    assert "above the floor" not in caplog.text
    open_sequence(path, SequenceOptions(depth_unit_m=1.0))
    assert "m above the floor: check the unit of depth" in caplog.text
