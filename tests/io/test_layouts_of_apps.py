"""What apps and data sets write is read as the frames that it was written from."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from anm_mj.errors import RunFolderError
from anm_mj.io.bag_files import files_in
from anm_mj.io.sequence_layouts import SequenceOptions, open_sequence
from anm_mj.io.sequence_text import seconds
from anm_mj.types import Intrinsics
from tests.box_room import room_depth
from tests.io.test_sequence_layouts import to_wall_m
from tests.recorded.layouts import (
    EPOCH_S,
    write_arkitscenes,
    write_icl,
    write_nerfstudio,
    write_open3d,
    write_ours,
    write_polycam,
    write_record3d,
    write_scannet,
    write_stray,
    write_tum,
)
from tests.recorded.walk import walk

WRITERS = {
    "stray": write_stray,
    "polycam": write_polycam,
    "record3d": write_record3d,
    "arkitscenes": write_arkitscenes,
    "icl": write_icl,
    "open3d": write_open3d,
}
WALK = walk(count=4)
ICL_WALK = walk(Intrinsics(64, 48, 48.12, 48.0, 32.0, 24.0), count=4)
"""As with its camera, images a tenth of the size."""


def write(folder, layout):
    WRITERS[layout](folder, ICL_WALK if layout == "icl" else WALK)
    return folder


@pytest.mark.parametrize("layout", WRITERS)
def test_a_layout_is_recognised_and_its_pixels_lie_on_the_walls(tmp_path, layout):
    # So narrow a camera does not see the floor.
    floor_m = 0.0 if layout == "icl" else None
    sequence, found = open_sequence(write(tmp_path, layout), SequenceOptions(floor_m=floor_m))
    assert found == layout
    assert_as_written(sequence, mirrored=layout == "icl", in_first_camera=layout == "open3d")


def hide_files_beside(folder):
    """As macOS does on a disk of another system."""
    for path in [path for path in folder.rglob("*") if path.is_file()]:
        path.with_name(f"._{path.name}").write_bytes(b"\x00\x05\x16\x07Mac OS X")


@pytest.mark.parametrize("write_layout", [write_polycam, write_scannet, write_open3d, write_ours, write_arkitscenes])
def test_hidden_files_are_no_frames(tmp_path, write_layout):
    write_layout(tmp_path, WALK)
    hide_files_beside(tmp_path)
    sequence, _ = open_sequence(tmp_path, SequenceOptions(max_bad=0.0))
    assert len(list(sequence.observations())) == len(WALK)


def test_hidden_files_are_no_parts_of_a_bag(tmp_path):
    for name in ("walk_10.mcap", "walk_2.mcap"):
        (tmp_path / name).touch()
    hide_files_beside(tmp_path)
    assert [path.name for path in files_in(tmp_path)] == ["walk_2.mcap", "walk_10.mcap"]


def assert_as_written(sequence, *, walk=WALK, mirrored=False, in_first_camera=False):
    observations = list(sequence.observations())
    walk = ICL_WALK if mirrored else walk
    assert len(observations) == len(walk)
    for before, after in zip(walk, observations, strict=True):
        if in_first_camera:
            moved = np.linalg.inv(observations[0].T_world_camera) @ after.T_world_camera
            np.testing.assert_allclose(moved, np.linalg.inv(walk[0].T_world_camera) @ before.T_world_camera, atol=1e-6)
            assert observations[0].T_world_camera[2, 3] == pytest.approx(1.25, abs=0.02)
        else:
            np.testing.assert_allclose(after.T_world_camera, before.T_world_camera, atol=0.02)
            assert np.nanmax(to_wall_m(after)) < 0.03
        assert abs(after.rgb.astype(int) - before.rgb).mean() < 3.0
        assert after.intrinsics.fx == pytest.approx(before.intrinsics.fx)


@pytest.mark.parametrize(
    "lost",
    [["depth/00005.png"], ["color/00003.jpg", "depth/00005.png"], ["color/00003.jpg", "depth/00003.png"]],
)
def test_images_of_open3d_keep_their_partners_and_poses_where_one_is_lost(tmp_path, lost):
    path = walk(count=12)
    write_open3d(tmp_path, path)
    for name in lost:
        (tmp_path / name).unlink()
    sequence, _ = open_sequence(tmp_path)
    numbers = sorted(set(range(12)) - {int(name[-9:-4]) for name in lost})
    assert [int(frame.colour.stem) for frame in sequence.frames] == numbers
    assert_as_written(sequence, walk=[path[k] for k in numbers], in_first_camera=True)


def test_images_of_open3d_whose_names_are_times_are_paired_by_rank(tmp_path):
    path = walk(count=4)
    write_open3d(tmp_path, path)
    for name, begin in (("color", 1000), ("depth", 1010)):
        for k, file in enumerate(sorted((tmp_path / name).iterdir())):
            file.rename(file.with_stem(f"{begin + 33 * k}"))
    assert_as_written(open_sequence(tmp_path)[0], walk=path, in_first_camera=True)


@pytest.mark.parametrize("layout", ["stray", "polycam", "arkitscenes"])
def test_depth_of_low_confidence_is_not_measured(tmp_path, layout):
    sequence, _ = open_sequence(write(tmp_path, layout))
    depth_m = next(sequence.observations()).depth_m
    assert np.isnan(depth_m[20:24, 30:40]).all()
    assert np.isnan(depth_m).sum() == 40


def test_colour_out_of_a_video(tmp_path):
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    write(tmp_path, "stray")
    make = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(tmp_path / "rgb" / "%06d.png"), "-qp", "4"]
    subprocess.run([*make, "-pix_fmt", "yuv444p", str(tmp_path / "rgb.mp4")], check=True)
    shutil.rmtree(tmp_path / "rgb")
    sequence, _ = open_sequence(tmp_path)
    assert_as_written(sequence)
    (tmp_path / "rgb.mp4").write_bytes((tmp_path / "rgb.mp4").read_bytes()[:600])
    with pytest.raises(RunFolderError, match=r"rgb\.mp4 cannot be decoded"):
        open_sequence(tmp_path)
    (tmp_path / "rgb.mp4").unlink()
    with pytest.raises(RunFolderError, match=r"layout stray: it has no rgb or rgb\.mp4; copy"):
        open_sequence(tmp_path)


def test_depth_in_openexr(tmp_path):
    openexr = pytest.importorskip("OpenEXR", reason="the package OpenEXR is not installed")

    def save(path, depth_m):
        openexr.File({"compression": openexr.ZIP_COMPRESSION, "type": openexr.scanlineimage}, {"R": depth_m}).write(
            str(path)
        )

    write_record3d(tmp_path, WALK, save)
    assert_as_written(open_sequence(tmp_path)[0])


def test_openexr_is_named_where_it_is_not_installed(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    write_record3d(tmp_path, WALK, lambda path, _: path.write_bytes(b"x"))
    with pytest.raises(RunFolderError, match=r"needs the package OpenEXR: pip install 'anm-mj\[exr\]'"):
        open_sequence(tmp_path)


def test_a_recording_of_record3d_itself_is_refused_with_the_way_out(tmp_path):
    (tmp_path / "rgbd").mkdir()
    (tmp_path / "rgbd" / "0.depth").write_bytes(b"bvx2")
    (tmp_path / "metadata").write_text("{}")
    for path in (tmp_path, tmp_path / "scan.r3d"):
        with pytest.raises(RunFolderError, match="let the app export it as EXR and RGB"):
            open_sequence(path)


@pytest.mark.parametrize(("down_deg", "roll_deg"), [(0, 0), (25, 0), (40, 8), (10, -12)])
def test_without_poses_the_world_is_levelled_by_the_floor_in_the_first_image(tmp_path, caplog, down_deg, roll_deg):
    one = WALK[0]
    T = one.T_world_camera.copy()
    T[:3, :3] = T[:3, :3] @ Rotation.from_euler("xz", [-down_deg, roll_deg], degrees=True).as_matrix()
    depth_m = room_depth(T, one.intrinsics)
    write_tum(tmp_path, [replace(one, T_world_camera=T, depth_m=depth_m)])
    (tmp_path / "groundtruth.txt").unlink()
    options = SequenceOptions(camera=(32.0, 32.0, 32.0, 32.0), needs_poses=False, up="floor")
    found = next(open_sequence(tmp_path, options)[0].observations()).T_world_camera
    # Up in the camera, and its height.
    np.testing.assert_allclose(found[2], T[2], atol=0.02)
    assert ("is tilted by" in caplog.text) is (down_deg > 0)
    stated = open_sequence(tmp_path, replace(options, up="-y", floor_m=-1.0))[0].frames[0].T_world_camera
    np.testing.assert_allclose(stated[2], (0.0, -1.0, 0.0, 1.0), atol=1e-9)


def test_each_frame_is_seen_by_its_own_camera(tmp_path):
    """Every other frame was taken with twice the focal length and another centre."""
    wide, narrow = WALK, walk(Intrinsics(64, 64, 64.0, 60.0, 30.0, 33.0), count=4)
    mixed = [narrow[k] if k % 2 else wide[k] for k in range(4)]
    write_nerfstudio(tmp_path, mixed)
    facts = json.loads((tmp_path / "transforms.json").read_text())
    for frame in facts["frames"]:
        k = mixed[int(frame["file_path"][7:10])].intrinsics
        frame |= {"fl_x": k.fx, "fl_y": k.fy, "cx": k.cx, "cy": k.cy}
    for key in ("fl_x", "fl_y", "cx", "cy"):
        del facts[key]
    (tmp_path / "transforms.json").write_text(json.dumps(facts))
    observations = list(open_sequence(tmp_path)[0].observations())
    assert len({one.intrinsics for one in observations}) == 1
    for before, after in zip(mixed, observations, strict=True):
        depth_m = room_depth(before.T_world_camera, after.intrinsics)
        near = np.abs(after.depth_m - depth_m) < 0.05 * depth_m
        # Beyond its own image it saw nothing.
        assert near[np.isfinite(after.depth_m)].mean() > 0.97
    assert np.isnan(observations[1].depth_m).any()


def test_colour_is_turned_as_exif_says_where_the_depth_is(tmp_path):
    """Depth stands upright; the colours lie on their side in the file."""
    upright = walk(Intrinsics(48, 64, 32.0, 32.0, 24.0, 32.0), count=4)
    write_nerfstudio(tmp_path, upright)
    turned = Image.Exif()
    turned[0x0112] = 6
    for path in (tmp_path / "images").iterdir():
        Image.open(path).transpose(Image.Transpose.ROTATE_90).save(path, exif=turned)
    assert_as_written(open_sequence(tmp_path)[0], walk=upright)


@pytest.mark.parametrize(
    ("layout", "lacks", "said"),
    [
        ("stray", "odometry.csv", "looks like a sequence of the layout stray, but has no odometry.csv"),
        ("stray", "camera_matrix.csv", "no whole sequence of the layout stray: it has no camera_matrix.csv; copy"),
        ("polycam", "keyframes/depth", "of the layout polycam: it has no keyframes/depth"),
        ("arkitscenes", "lowres_wide_intrinsics", "of the layout arkitscenes: it has no lowres_wide_intrinsics"),
        ("icl", "associations.txt", "of the layout icl: it has no associations.txt"),
        ("open3d", "trajectory.log", "looks like a sequence of the layout open3d, but has no trajectory.log or"),
        ("record3d", "depth", "of the layout record3d: it has no depth or EXR_RGBD/depth"),
    ],
)
def test_what_lacks_of_a_layout_is_named(tmp_path, layout, lacks, said):
    write(tmp_path, layout)
    (tmp_path / lacks).rename(tmp_path / "elsewhere")
    with pytest.raises(RunFolderError, match=said):
        open_sequence(tmp_path)


@pytest.mark.parametrize(("digits", "first"), [(9, 1305031100), (6, 1305031100), (3, 1305031100), (9, 100)])
def test_stamps_in_other_units_than_seconds(tmp_path, digits, first):
    write_tum(tmp_path, WALK)
    for name in ("rgb.txt", "depth.txt", "groundtruth.txt"):
        lines = (tmp_path / name).read_text().splitlines()
        words = [line.split(maxsplit=1) for line in lines[1:]]
        stamps = [round((float(time_s) - EPOCH_S + first) * 10**digits) for time_s, _ in words]
        text = "".join(f"{stamp} {rest}\n" for stamp, (_, rest) in zip(stamps, words, strict=True))
        (tmp_path / name).write_text(text)
    sequence, _ = open_sequence(tmp_path, SequenceOptions(camera=(32.0, 32.0, 32.0, 32.0)))
    assert_as_written(sequence)
    assert [frame.time_s for frame in sequence.frames] == pytest.approx([first + one.time_s for one in WALK], abs=1e-3)


@pytest.mark.parametrize("unit", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("rate_hz", [30, 200, 1000])
def test_stamps_of_fast_poses_are_of_this_century(unit, rate_hz):
    times_s = EPOCH_S + np.arange(50) / rate_hz
    assert seconds((times_s / unit).tolist()) == pytest.approx(times_s.tolist(), rel=0.0, abs=1e-3)


@pytest.mark.parametrize(
    ("layout", "name", "damage"),
    [
        ("stray", "odometry.csv", lambda path: path.write_text(path.read_text().replace(" 000002", " inf"))),
        ("stray", "camera_matrix.csv", lambda path: path.write_text("0 0 0\n0 0 0\n0 0 1\n")),
        ("open3d", "trajectory.log", lambda path: (path.unlink(), path.mkdir())),
        ("record3d", "depth/3.npy", lambda path: path.write_bytes(path.read_bytes().replace(b"'fortran", b"'''rtran"))),
    ],
)
def test_a_damaged_file_is_refused_in_one_sentence(tmp_path, layout, name, damage):
    write(tmp_path, layout)
    damage(tmp_path / name)
    with pytest.raises(RunFolderError, match=f"{name}|camera has|cannot be read"):
        list(open_sequence(tmp_path, SequenceOptions(max_bad=0.0))[0].observations())
