"""Small recorded sequences of each layout, to be damaged."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from anm_mj.types import Intrinsics
from tests.io.bags import images, poses_by_tf, write_bag, write_bag_of_ros_1
from tests.io.test_sequence_layouts import CAMERA, write_nerfstudio, write_ours, write_replica, write_tum
from tests.recorded import layouts
from tests.recorded.walk import CAMERA as SQUARE
from tests.recorded.walk import walk


def _write_tum(folder: Path) -> None:
    """With its camera: images that are not of the data set's size are refused without."""
    write_tum(folder)
    camera = f"{CAMERA.fx} {CAMERA.fy} {CAMERA.cx - 0.5} {CAMERA.cy - 0.5}\n"
    (folder / "calibration.txt").write_text(camera, encoding="utf-8")


WRITERS: dict[str, Callable[[Path], None]] = {
    "tum": _write_tum,
    "nerfstudio": write_nerfstudio,
    "replica": write_replica,
    "sequence": write_ours,
}
OTHERS = {
    "7scenes": layouts.write_seven_scenes,
    "scannet": layouts.write_scannet,
    "stray": layouts.write_stray,
    "polycam": layouts.write_polycam,
    "record3d": layouts.write_record3d,
    "arkitscenes": layouts.write_arkitscenes,
    "icl": layouts.write_icl,
    "open3d": layouts.write_open3d,
}
"""Layouts of apps and data sets, by a walk of a few frames."""


def write_recordings(folder: Path) -> dict[str, Path]:
    """One sequence of each layout; its path by kind."""
    paths = {}
    for kind, write in WRITERS.items():
        paths[kind] = folder / kind / "walk"
        paths[kind].mkdir(parents=True)
        write(paths[kind])
    for kind, write_walk in OTHERS.items():
        paths[kind] = folder / kind / "walk"
        paths[kind].mkdir(parents=True)
        camera = Intrinsics(64, 48, 48.12, 48.0, 32.0, 24.0) if kind == "icl" else SQUARE
        write_walk(paths[kind], walk(camera, count=4))
    for kind, storage, compression in (
        ("bag", StoragePlugin.SQLITE3, CompressionMode.NONE),
        ("bag-file", StoragePlugin.SQLITE3, CompressionMode.FILE),
        ("bag-message", StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
        ("mcap", StoragePlugin.MCAP, CompressionMode.NONE),
        ("mcap-zstd", StoragePlugin.MCAP, CompressionMode.STORAGE),
    ):
        (folder / kind).mkdir()
        paths[kind] = write_bag(folder / kind / "walk", images() + poses_by_tf(), storage, compression)
    for kind, compression in (("bag1", "LZ4"), ("bag1-bz2", "BZ2")):
        (folder / kind).mkdir()
        form = Writer1.CompressionFormat[compression]
        paths[kind] = write_bag_of_ros_1(folder / kind / "walk.bag", form)
    return paths
