"""Bags as killed recorders, slow localisers and drivers that lie leave them."""

import struct
from dataclasses import replace

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from anm_mj.errors import RunFolderError
from anm_mj.io.sequence_layouts import SequenceOptions, open_sequence
from tests.io.bags import (
    CAMERA,
    DEPTH,
    T_BASE_CAMERA,
    base_of,
    changed,
    check,
    images,
    odometry,
    poses_by_tf,
    seen,
    tf,
    write_bag,
)

ON_THE_FLOOR = SequenceOptions(floor_m=0.0)


def without(topic, said):
    return [entry for entry in said if entry[0] != topic]


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_a_folder_without_metadata_and_a_file_alone(tmp_path, caplog, storage):
    path = write_bag(tmp_path / "bag", images() + poses_by_tf(), storage)
    (path / "metadata.yaml").unlink()
    check(open_sequence(path, ON_THE_FLOOR)[0])
    assert "has no metadata.yaml: its 1 files are read without it" in caplog.text
    (file,) = path.iterdir()
    check(open_sequence(file, ON_THE_FLOOR)[0])


def test_a_cut_mcap_is_read_up_to_the_cut(tmp_path, caplog):
    said = sorted(images() + poses_by_tf(), key=lambda entry: entry[1])
    path = write_bag(tmp_path / "bag", said, StoragePlugin.MCAP)
    (file,) = path.glob("*.mcap")
    whole = file.read_bytes()
    for share, frames in ((0.4, 2), (0.8, 4)):
        file.write_bytes(whole[: int(share * len(whole))])
        for given in (file, path):
            sequence, _ = open_sequence(given, SequenceOptions(floor_m=0.0, max_bad=0.9))
            check(sequence, steps=(0, 1, 2, 4, 5)[:frames])
    assert "ends in the middle: the" in caplog.text
    file.write_bytes(whole[:60])
    with pytest.raises(RunFolderError, match="it is cut, and no message of it is whole"):
        open_sequence(file)


def without_chunks(data):
    """The records of an MCAP file that stand in its chunks, one after the other, and no end."""
    said, at = data[:8], 8
    while at < len(data) - 8:
        kind, length = struct.unpack_from("<BQ", data, at)
        record = data[at : at + 9 + length]
        at += len(record)
        if kind == 15:
            break
        said += {1: record, 6: record[9 + 40 :]}.get(kind, b"")
    return said


def test_a_cut_mcap_without_chunks_is_read_up_to_the_cut(tmp_path, caplog):
    said = sorted(images() + poses_by_tf(), key=lambda entry: entry[1])
    (file,) = write_bag(tmp_path / "bag", said, StoragePlugin.MCAP).glob("*.mcap")
    whole = without_chunks(file.read_bytes())
    file.write_bytes(whole[: int(0.8 * len(whole))])
    sequence, _ = open_sequence(file, SequenceOptions(floor_m=0.0, max_bad=0.9))
    check(sequence, steps=(0, 1, 2))
    assert "ends in the middle: the" in caplog.text


def test_whole_chunks_before_the_cut_stay_compressed(tmp_path):
    path = write_bag(tmp_path / "bag", images() + poses_by_tf(), StoragePlugin.MCAP, CompressionMode.STORAGE)
    (file,) = path.glob("*.mcap")
    # The index at the end is gone, not the chunk.
    file.write_bytes(file.read_bytes()[:-200])
    check(open_sequence(file, ON_THE_FLOOR)[0])


def test_a_link_that_is_sent_once_holds(tmp_path):
    said = [("/tf" if topic == "/tf_static" else topic, t, message) for topic, t, message in images() + poses_by_tf()]
    check(open_sequence(write_bag(tmp_path / "tf", said), ON_THE_FLOOR)[0])
    fixed = ("/tf", 99.0, tf(99.0, "base", "optical", T_BASE_CAMERA))
    moving = [("/odom", one.time_s + 100.0, odometry(one.time_s + 100.0, base_of(one))) for one in seen()]
    check(open_sequence(write_bag(tmp_path / "odometry", [*images(), *moving, fixed]), ON_THE_FLOOR)[0])


def test_a_localiser_that_seldom_speaks_holds_and_is_named(tmp_path, caplog):
    drift = np.eye(4)
    seldom = []
    for t in (100.0, 102.5):
        drift[0, 3] = 0.01 * (t - 100.0)
        seldom.append(("/tf", t, tf(t, "map", "odom", drift.copy())))
    sequence, _ = open_sequence(write_bag(tmp_path / "bag", images() + poses_by_tf() + seldom), ON_THE_FLOOR)
    assert len(sequence) == 5
    assert "The frame 'odom' is stated 2 times from 100 to 102.5 s, seldom against 18 times" in caplog.text
    for frame, step in zip(sequence.frames, (0, 1, 2, 4, 5), strict=True):
        moved_m = frame.T_world_camera[0, 3] - seen()[step].T_world_camera[0, 3]
        assert moved_m == pytest.approx(0.01 * seen()[step].time_s, abs=1e-6)


def test_of_two_calibrations_of_one_frame_that_of_the_colour_is_taken(tmp_path, caplog):
    info = DEPTH.replace("image_raw", "camera_info")
    said = images() + poses_by_tf()
    said += [("/camera/color/camera_info", t, message) for topic, t, message in said if topic == info]
    open_sequence(write_bag(tmp_path / "same", said))
    assert "two calibrations differ" not in caplog.text
    other = write_bag(tmp_path / "other", changed(info, lambda m, _: replace(m, k=1.5 * m.k), said))
    sequence, _ = open_sequence(other)
    assert "two calibrations differ" in caplog.text
    assert "/camera/color/camera_info is taken, as depth of the colour's frame is seen by the" in caplog.text
    assert sequence.intrinsics.fx == pytest.approx(CAMERA.fx)
    named, _ = open_sequence(other, SequenceOptions(topics={"camera": info}))
    assert named.intrinsics.fx == pytest.approx(1.5 * CAMERA.fx)


def test_clocks_that_do_not_meet_are_named_with_their_times(tmp_path):
    moving = [("/tf", one.time_s + 100.0, tf(one.time_s + 1.7e9, "odom", "base", base_of(one))) for one in seen()]
    said = [*without("/tf", images() + poses_by_tf()), *moving]
    words = r"images have stamps from 100\.000 to 102\.500 s; the frame 'base' is stated from 1700000000\.000 to"
    with pytest.raises(RunFolderError, match=words + r".*their clocks differ"):
        open_sequence(write_bag(tmp_path / "bag", said))


def test_a_tenth_of_a_millimetre_is_suggested(tmp_path, caplog):
    said = changed(DEPTH, lambda m, _: replace(m, data=(m.data.view(np.uint16) * 10).view(np.uint8)))
    open_sequence(write_bag(tmp_path / "bag", said))
    assert "m above the floor: check the unit of depth (--depth-unit, as in --depth-unit 0.0001)" in caplog.text
