import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from anm_mj.errors import RunFolderError
from anm_mj.io import bag_limits
from anm_mj.io.sequence_layouts import SequenceOptions, open_sequence
from tests.io.bags import check, images, poses_by_tf, write_bag, write_bag_of_ros_1


@pytest.mark.parametrize("kind", ["message", "file", "mcap", "lz4", "bz2"])
def test_what_unpacks_to_too_much_is_refused(tmp_path, monkeypatch, kind):
    monkeypatch.setattr(bag_limits, "MAX_PART_BYTES", 1000)
    monkeypatch.setattr(bag_limits, "MAX_RATIO", 1)
    if kind in ("lz4", "bz2"):
        path = write_bag_of_ros_1(tmp_path / "walk.bag", Writer1.CompressionFormat[kind.upper()])
    else:
        mode = {"message": "MESSAGE", "file": "FILE", "mcap": "STORAGE"}[kind]
        storage = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        path = write_bag(tmp_path / "walk", images() + poses_by_tf(), storage, CompressionMode[mode])
    with pytest.raises(RunFolderError, match="unpacks to more than 0 MiB"):
        open_sequence(path, SequenceOptions(floor_m=0.0))


@pytest.mark.parametrize("mode", ["MESSAGE", "FILE", "STORAGE"])
def test_compressed_bags_of_ros_2(tmp_path, mode):
    storage = StoragePlugin.MCAP if mode == "STORAGE" else StoragePlugin.SQLITE3
    path = write_bag(tmp_path / "walk", images() + poses_by_tf(), storage, CompressionMode[mode])
    check(open_sequence(path, SequenceOptions(floor_m=0.0))[0])
