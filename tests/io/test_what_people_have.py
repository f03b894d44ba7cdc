"""Tables, names, poses and cameras as programs, editors and people leave them, one kind of damage to a sound folder."""

import json
import math

import numpy as np
import pytest
from PIL import Image

from anm_mj.errors import RunFolderError
from anm_mj.io.sequence_layouts import SequenceOptions, open_sequence
from anm_mj.sequence_check.warn_and_fix import BeforeMapping
from tests.io.test_sequence_layouts import (
    CAMERA,
    PINHOLE,
    lifted,
    seen,
    to_wall_m,
    write_images,
    write_nerfstudio,
    write_replica,
    write_tum,
)


def rewrite(path, change):
    path.write_text(change(path.read_text()))


def byte_order_mark(folder):
    rewrite(folder / "groundtruth.txt", lambda text: "\ufeff" + text.replace("\n", "\r\n"))


def commas_and_a_header(folder):
    rewrite(folder / "groundtruth.txt", lambda text: text.replace("# ", "").replace(" ", ","))


def backslashes(folder):
    for name in ("rgb.txt", "depth.txt"):
        rewrite(folder / name, lambda text: text.replace("/", "\\"))


def blank_in_names(folder):
    (folder / "rgb").rename(folder / "my images")
    rewrite(folder / "rgb.txt", lambda text: text.replace("rgb/", "my images/"))


def float_metres(folder):
    for path in (folder / "depth").iterdir():
        metres = np.asarray(Image.open(path)).astype(np.float32) / 5000
        Image.fromarray(metres).save(path.with_suffix(".tiff"))
        path.unlink()
    rewrite(folder / "depth.txt", lambda text: text.replace(".png", ".tiff"))


def test_depth_in_floating_point_has_the_unit_that_is_given(tmp_path, caplog):
    write_tum(tmp_path)
    for path in (tmp_path / "depth").iterdir():
        millimetres = np.asarray(Image.open(path)).astype(np.float32) / 5
        Image.fromarray(millimetres).save(path.with_suffix(".tiff"))
    rewrite(tmp_path / "depth.txt", lambda text: text.replace(".png", ".tiff"))
    judged = BeforeMapping()
    open_sequence(tmp_path, SequenceOptions(camera=PINHOLE, judge=judged))
    assert [finding.kind for finding in judged.verdict.findings] == ["unit"]
    assert "This puts it right: --depth-unit 0.001, or --fix." in caplog.text
    assert "as in --depth-unit 0.001)" in caplog.text
    assert_on_the_walls(tmp_path, 5, camera=PINHOLE, depth_unit_m=0.001)


@pytest.mark.parametrize("change", [byte_order_mark, commas_and_a_header, backslashes, blank_in_names, float_metres])
def test_tum_lists_are_read_as_people_write_them(tmp_path, change):
    write_tum(tmp_path)
    change(tmp_path)
    assert_on_the_walls(tmp_path, 5, camera=PINHOLE)


def test_poses_between_the_images_are_interpolated(tmp_path):
    write_tum(tmp_path)
    twice = [line.split() for line in (tmp_path / "groundtruth.txt").read_text().splitlines()[1:]]
    lines = [f"{float(line[0]) + shift:.6f} {' '.join(line[1:])}" for line in twice for shift in (-0.1, 0.1)]
    (tmp_path / "groundtruth.txt").write_text("\n".join(lines) + "\n")
    assert_on_the_walls(tmp_path, 5, camera=PINHOLE)


def test_a_row_of_nan_costs_one_frame(tmp_path, caplog):
    write_tum(tmp_path)
    rewrite(tmp_path / "groundtruth.txt", lambda text: text.replace(text.splitlines()[3].split()[4], "nan", 1))
    assert_on_the_walls(tmp_path, 4, camera=PINHOLE, max_bad=0.4)
    assert "1 of 6 lines are no poses" in caplog.text


def test_a_camera_that_no_file_states_is_refused_where_the_images_contradict_it(tmp_path):
    write_tum(tmp_path)
    with pytest.raises(RunFolderError, match=r"states its camera.* 640 x 480 pixels, but they have 64 x 48"):
        open_sequence(tmp_path)
    camera = f"{CAMERA.fx} {CAMERA.fy} {CAMERA.cx - 0.5} {CAMERA.cy - 0.5}\n"
    (tmp_path / "calibration.txt").write_text(camera)
    assert_on_the_walls(tmp_path, 5)


def test_frames_of_replica_are_in_the_order_of_their_numbers(tmp_path):
    folder = tmp_path / "walk"
    folder.mkdir()
    write_replica(folder)
    for path in (folder / "results").iterdir():
        number = int(path.stem[-6:]) + 7
        path.rename(path.with_name(f"{path.stem[:-6]}{number}{path.suffix}"))
    assert_on_the_walls(folder, 6)


def test_images_of_replica_may_stand_in_folders_of_their_own(tmp_path):
    folder = tmp_path / "walk"
    folder.mkdir()
    write_replica(folder)
    for name, sign in (("rgb", "frame"), ("depth", "depth")):
        (folder / name).mkdir()
        for path in (folder / "results").glob(f"{sign}*"):
            path.rename(folder / name / path.name.replace(sign, "" if name == "rgb" else "depth_"))
    (folder / "results").rmdir()
    assert_on_the_walls(folder, 6)


def test_poses_of_replica_may_have_twelve_numbers(tmp_path):
    folder = tmp_path / "walk"
    folder.mkdir()
    write_replica(folder)
    rewrite(folder / "traj.txt", lambda text: "".join(f"{' '.join(line.split()[:12])}\n" for line in text.splitlines()))
    assert_on_the_walls(folder, 6)


@pytest.mark.parametrize("value", ["-inf", "nan", "0"])
def test_a_pose_that_is_none_costs_one_frame_and_many_the_sequence(tmp_path, caplog, value):
    folder = tmp_path / "walk"
    folder.mkdir()
    write_replica(folder)
    lines = (folder / "traj.txt").read_text().splitlines()
    lines[2] = " ".join([value] * 16)
    (folder / "traj.txt").write_text("\n".join(lines) + "\n")
    assert_on_the_walls(folder, 5)
    assert "1 of 6 frames are left out, because their pose is none" in caplog.text
    lines[4] = lines[2]
    (folder / "traj.txt").write_text("\n".join(lines) + "\n")
    with pytest.raises(RunFolderError, match="Pose 2 of"):
        open_sequence(folder)


def without_one_depth(facts):
    del facts["frames"][1]["depth_file_path"]


def slightly_different_cameras(facts):
    for k, frame in enumerate(facts["frames"]):
        frame["fl_x"] = facts["fl_x"] + 0.01 * (k - 2.5)
    del facts["fl_x"]


def an_angle_alone(facts):
    for key in ("w", "h", "fl_x", "fl_y", "cx", "cy"):
        del facts[key]
    facts["camera_angle_x"] = 2.0 * math.atan(0.5 * CAMERA.width / CAMERA.fx)


def sizes_with_a_point(facts):
    for frame in facts["frames"]:
        frame |= {"w": float(facts["w"]), "h": float(facts["h"])}
    del facts["w"], facts["h"]


def windows(facts):
    for frame in facts["frames"]:
        frame["file_path"] = frame["file_path"].replace("/", "\\")


@pytest.mark.parametrize(
    ("change", "frames"),
    [
        (without_one_depth, 5),
        (slightly_different_cameras, 6),
        (an_angle_alone, 6),
        (sizes_with_a_point, 6),
        (windows, 6),
    ],
)
def test_a_transforms_json_of_phones_and_renderers(tmp_path, change, frames):
    write_nerfstudio(tmp_path)
    facts = json.loads((tmp_path / "transforms.json").read_text())
    change(facts)
    (tmp_path / "transforms.json").write_text(json.dumps(facts))
    assert_on_the_walls(tmp_path, frames)


def test_whole_numbers_of_npy_are_in_units_of_the_depth(tmp_path):
    write_nerfstudio(tmp_path)
    for path in (tmp_path / "depth").iterdir():
        np.save(path.with_suffix(".npy"), np.asarray(Image.open(path)).astype(np.uint16))
    rewrite(tmp_path / "transforms.json", lambda text: text.replace('.png", "trans', '.npy", "trans'))
    assert_on_the_walls(tmp_path, 6)


def test_seven_scenes(tmp_path):
    write_images(tmp_path, "frame-{:06d}.color.png", "frame-{:06d}.depth.png", 0.001)
    for k, one in enumerate(seen()):
        np.savetxt(tmp_path / f"frame-{k:06d}.pose.txt", lifted(one.T_world_camera))
    assert_on_the_walls(tmp_path, 6, layout="7scenes", camera=PINHOLE)
    with pytest.raises(RunFolderError, match="states its camera"):
        open_sequence(tmp_path)


def test_an_export_of_scannet_without_one_pose(tmp_path, caplog):
    write_images(tmp_path, "color/{:d}.jpg", "depth/{:d}.png", 0.001)
    for name in ("pose", "intrinsic"):
        (tmp_path / name).mkdir()
    for k, one in enumerate(seen()):
        np.savetxt(tmp_path / "pose" / f"{k}.txt", lifted(one.T_world_camera))
    camera = np.eye(4)
    camera[[0, 1, 0, 1], [0, 1, 2, 2]] = CAMERA.fx, CAMERA.fy, CAMERA.cx - 0.5, CAMERA.cy - 0.5
    np.savetxt(tmp_path / "intrinsic" / "intrinsic_depth.txt", camera)
    (tmp_path / "pose" / "3.txt").unlink()
    assert_on_the_walls(tmp_path, 5, layout="scannet")
    assert "1 of 6 frames are left out" in caplog.text


def assert_on_the_walls(folder, frames, *, layout=None, **options):
    sequence, found = open_sequence(folder, SequenceOptions(**options))
    assert layout in (None, found)
    observations = list(sequence.observations())
    assert len(observations) == frames
    assert max(to_wall_m(one).max() for one in observations) < 0.03
