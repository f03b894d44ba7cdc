import json
import math

import numpy as np
import pytest
from PIL import Image

from anm_mj.errors import RunFolderError
from anm_mj.io.own_sequence import SequenceWriter, read_sequence
from anm_mj.io.sequence_poses import base_pose
from anm_mj.types import Intrinsics, Pose2
from tests.box_room import observe

CAMERA = Intrinsics.from_fov(16, 12, math.radians(60.0))


@pytest.fixture
def written(tmp_path):
    seen = [observe(step, Pose2(0.1 * step, -0.2, 0.3 + 0.4 * step), CAMERA) for step in range(3)]
    seen[1].depth_m[2, 3] = np.nan
    writer = SequenceWriter(tmp_path / "walk")
    for observation in seen:
        writer.write(observation)
    return tmp_path / "walk", seen


def test_what_is_written_is_read_back(written):
    path, seen = written
    recorded = read_sequence(path)
    assert len(recorded) == 3
    for before, after in zip(seen, recorded.observations(), strict=True):
        assert (after.step, after.time_s, after.intrinsics) == (before.step, before.time_s, CAMERA)
        np.testing.assert_array_equal(after.rgb, before.rgb)
        np.testing.assert_allclose(after.depth_m, before.depth_m, atol=0.00051, equal_nan=True)
        np.testing.assert_allclose(after.T_world_camera, before.T_world_camera, atol=1e-7)
        assert (after.pose.x_m, after.pose.y_m) == pytest.approx((before.pose.x_m, before.pose.y_m), abs=1e-7)
        assert after.pose.yaw_rad == pytest.approx(before.pose.yaw_rad, abs=1e-7)


def test_a_comment_may_stand_behind_a_pose(written):
    path, _ = written
    before = read_sequence(path).frames
    poses = path / "poses.tum"
    poses.write_text(poses.read_text().replace("\n", "  # by hand\n"))
    after = read_sequence(path).frames
    assert len(after) == 3
    for one, other in zip(before, after, strict=True):
        np.testing.assert_array_equal(one.T_world_camera, other.T_world_camera)


def test_depth_formats(written):
    path, seen = written
    np.save(path / "depth" / "000000.npy", seen[0].depth_m)
    camera = json.loads((path / "camera.json").read_text()) | {"depth_unit_m": 0.0002}
    (path / "camera.json").write_text(json.dumps(camera))
    first, second, _ = read_sequence(path).observations()
    np.testing.assert_array_equal(first.depth_m, seen[0].depth_m)
    np.testing.assert_allclose(second.depth_m, seen[1].depth_m / 5, atol=0.0002, equal_nan=True)


def test_heading_of_a_downward_camera():
    # x right, y down (backwards on the floor), z to the floor.
    down = np.array([[0.0, -1.0, 0.0, 1.0], [-1.0, 0.0, 0.0, 2.0], [0.0, 0.0, -1.0, 1.2], [0.0, 0.0, 0.0, 1.0]])
    pose = base_pose(down)
    assert (pose.x_m, pose.y_m, pose.yaw_rad) == pytest.approx((1.0, 2.0, 0.0))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("camera.json", "{", "is not a recorded sequence"),
        ("camera.json", '{"width": 3}', "is not a recorded sequence"),
        ("poses.tum", "0 1 2 3\n", "eight numbers"),
        ("poses.tum", "0 1 2 3 0 0 0 x\n", "is not a recorded sequence"),
        ("rgb/000001.png", "no picture", "000001.png cannot be read"),
        ("depth/000002.png", "no picture", "000002.png cannot be read"),
    ],
)
def test_damaged_sequence(written, name, content, message):
    path, _ = written
    (path / name).write_text(content)
    with pytest.raises(RunFolderError, match=message):
        list(read_sequence(path).observations())


def test_image_size_mismatch(written):
    path, _ = written
    Image.new("RGB", (4, 4)).save(path / "rgb" / "000000.png")
    with pytest.raises(RunFolderError, match=r"Frame 0 .* colour of \(4, 4\)"):
        next(read_sequence(path).observations())


def test_non_empty_folder(tmp_path):
    (tmp_path / "thesis.tex").write_text("important")
    with pytest.raises(RunFolderError, match="not empty"):
        SequenceWriter(tmp_path)
