"""One bad frame costs one frame, and many of them the sequence."""

import json
import math

import numpy as np
import pytest
from PIL import Image

from anm_mj.errors import RunFolderError
from anm_mj.io import sequence_floor
from anm_mj.io.sequence_layouts import SequenceOptions, open_sequence
from tests.io.test_sequence_layouts import (
    PINHOLE,
    lifted,
    seen,
    to_wall_m,
    write_images,
    write_nerfstudio,
    write_ours,
    write_tum,
)


def cut(path):
    path.write_bytes(path.read_bytes()[:200])


def empty(path):
    path.write_bytes(b"")


def other_size(path):
    Image.fromarray(np.zeros((48, 48), np.uint16)).save(path)


@pytest.mark.parametrize("damage", [cut, empty, other_size, lambda path: path.unlink()])
def test_a_damaged_or_missing_image_costs_one_frame(tmp_path, caplog, damage):
    write_ours(tmp_path / "walk")
    damage(tmp_path / "walk" / "depth" / "000002.png")
    sequence, _ = open_sequence(tmp_path / "walk")
    observations = list(sequence.observations())
    assert [one.step for one in observations] == [0, 1, 3, 4, 5]
    assert max(to_wall_m(one).max() for one in observations) < 0.03
    assert "1 of 6 frames are left out, because their images cannot be used: 2. The first:" in caplog.text
    strict, _ = open_sequence(tmp_path / "walk", SequenceOptions(max_bad=0.1))
    with pytest.raises(RunFolderError, match=r"1 of 6 frames of .* \(2\), more than 10 % \(--max-bad\)"):
        list(strict.observations())


def test_a_share_is_between_zero_and_one(tmp_path):
    write_ours(tmp_path / "walk")
    with pytest.raises(RunFolderError, match="--max-bad is 20; give a share"):
        open_sequence(tmp_path / "walk", SequenceOptions(max_bad=20.0))


def test_a_line_of_nan_in_our_own_layout_costs_one_frame(tmp_path, caplog):
    write_ours(tmp_path / "walk")
    poses = tmp_path / "walk" / "poses.tum"
    lines = poses.read_text().splitlines()
    lines[3] = lines[3].split()[0] + " nan" * 7
    poses.write_text("\n".join(lines) + "\n")
    assert len(open_sequence(tmp_path / "walk")[0]) == 5
    assert "1 of 6 frames are left out, because their pose is none (nan, zeros or no rotation): 3" in caplog.text


def test_clocks_that_do_not_meet_are_named_with_their_times(tmp_path):
    write_tum(tmp_path)
    truth = tmp_path / "groundtruth.txt"
    lines = [line.split() for line in truth.read_text().splitlines()[1:]]
    truth.write_text("".join(f"{float(line[0]) + 1.7e9:.6f} {' '.join(line[1:])}\n" for line in lines))
    words = r"depth is of 0\.\d+ to \d\.\d+ s, the others of 1[67]\d+\.\d+ to 17\d+\.\d+ s; their clocks differ"
    with pytest.raises(RunFolderError, match=words):
        open_sequence(tmp_path, SequenceOptions(camera=PINHOLE))


def test_the_times_that_belong_together_can_be_given(tmp_path, caplog):
    write_tum(tmp_path)
    open_sequence(tmp_path, SequenceOptions(camera=PINHOLE))
    assert "no colour image is near their depth in time (0.02 s, --match)" in caplog.text
    caplog.clear()
    open_sequence(tmp_path, SequenceOptions(camera=PINHOLE, match_s=60.0))
    assert "no colour image" not in caplog.text
    truth = tmp_path / "groundtruth.txt"
    lines = truth.read_text().splitlines()
    truth.write_text("\n".join(lines[:3] + lines[4:]) + "\n")
    assert len(open_sequence(tmp_path, SequenceOptions(camera=PINHOLE, max_bad=0.5))[0]) == 4
    assert len(open_sequence(tmp_path, SequenceOptions(camera=PINHOLE, max_gap_s=60.0))[0]) == 5
    with pytest.raises(RunFolderError, match="--match is 0; give a time above 0"):
        open_sequence(tmp_path, SequenceOptions(match_s=0.0))


def test_the_largest_number_of_16_bits_is_no_depth(tmp_path):
    write_ours(tmp_path / "walk")
    path = tmp_path / "walk" / "depth" / "000000.png"
    stated = np.array(Image.open(path))
    stated[:5] = 65535
    Image.fromarray(stated).save(path)
    first = next(open_sequence(tmp_path / "walk")[0].observations())
    assert np.isnan(first.depth_m[:5]).all()
    assert np.isfinite(first.depth_m[5:]).any()


def write_tum_again(folder):
    write_tum(folder)
    return folder / "rgb" / "0.png"


def write_seven_scenes(folder):
    write_images(folder, "frame-{:06d}.color.png", "frame-{:06d}.depth.png", 0.001)
    for k, one in enumerate(seen()):
        np.savetxt(folder / f"frame-{k:06d}.pose.txt", lifted(one.T_world_camera))
    return folder / "frame-000000.depth.png"


def write_an_angle_alone(folder):
    write_nerfstudio(folder)
    facts = json.loads((folder / "transforms.json").read_text())
    angle = 2.0 * math.atan(0.5 * facts["w"] / facts["fl_x"])
    kept = {"frames": facts["frames"], "camera_angle_x": angle}
    (folder / "transforms.json").write_text(json.dumps(kept))
    return folder / "images" / "000.png"


def loop(path):
    path.unlink()
    path.symlink_to(path.name)


@pytest.mark.parametrize("damage", [empty, loop])
@pytest.mark.parametrize("write", [write_tum_again, write_seven_scenes, write_an_angle_alone])
def test_a_first_image_that_cannot_be_read_costs_one_frame(tmp_path, write, damage):
    first = write(tmp_path)
    whole = list(open_sequence(tmp_path, SequenceOptions(camera=PINHOLE))[0].observations())
    damage(first)
    sequence, _ = open_sequence(tmp_path, SequenceOptions(camera=PINHOLE))
    observations = list(sequence.observations())
    assert [one.time_s for one in observations] == [one.time_s for one in whole[1:]]
    assert observations[0].intrinsics == whole[0].intrinsics
    assert max(to_wall_m(one).max() for one in observations) < 0.03
    for path in first.parent.glob(f"*{''.join(first.suffixes)}"):
        path.unlink()
        path.write_bytes(b"")
    with pytest.raises(RunFolderError, match="cannot be read"):
        list(open_sequence(tmp_path, SequenceOptions(camera=PINHOLE, max_bad=1.0))[0].observations())


def test_without_poses_the_floor_is_that_of_the_first_image_that_can_be_read(tmp_path, caplog):
    write_ours(tmp_path / "walk")
    cut(tmp_path / "walk" / "depth" / "000000.png")
    sequence, _ = open_sequence(tmp_path / "walk", SequenceOptions(needs_poses=False, ignores_poses=True))
    assert next(sequence.observations()).T_world_camera[2, 3] == pytest.approx(1.25, abs=0.02)
    assert "shows nothing below the camera" not in caplog.text


def test_the_floor_is_found_though_none_of_the_images_that_are_looked_at_first_can_be_read(tmp_path, monkeypatch):
    monkeypatch.setattr(sequence_floor, "_FLOOR_FRAMES", 3)
    write_ours(tmp_path / "walk")
    for step in (0, 2, 4):
        cut(tmp_path / "walk" / "depth" / f"{step:06d}.png")
    sequence, _ = open_sequence(tmp_path / "walk", SequenceOptions(max_bad=0.5))
    assert sequence_floor.find_floor_m(sequence) == pytest.approx(0.0, abs=0.02)
