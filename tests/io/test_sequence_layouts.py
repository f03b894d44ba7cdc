"""Every layout is written here as its data set documents it, and read back as the frames that it was written from."""

import json
import math

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from anm_mj.errors import RunFolderError
from anm_mj.export.formats import export_run
from anm_mj.frames import pixel_directions, transform_points
from anm_mj.io.own_sequence import SequenceWriter
from anm_mj.io.sequence_floor import find_floor_m
from anm_mj.io.sequence_layouts import SequenceOptions, open_sequence
from anm_mj.recording.record_config import RecordConfig
from anm_mj.types import Intrinsics, Pose2
from tests.box_room import ROOM_HIGH_M, ROOM_LOW_M, new_recorder, observe, record_steps

CAMERA = Intrinsics.from_fov(64, 48, math.radians(100.0))
LIFT_M = 0.7
"""Height of the floor in the worlds of others."""


def seen():
    return [observe(step, Pose2(0.1 * step, -0.2, 0.5 * step), CAMERA) for step in range(6)]


def lifted(T_world_camera):
    T = T_world_camera.copy()
    T[2, 3] += LIFT_M
    return T


def write_images(folder, colour, depth, unit_m):
    for index, observation in enumerate(seen()):
        for name in (colour.format(index), depth.format(index)):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(observation.rgb).save(folder / colour.format(index))
        Image.fromarray(np.rint(observation.depth_m / unit_m).astype(np.uint16)).save(folder / depth.format(index))


def write_tum(folder):
    write_images(folder, "rgb/{:d}.png", "depth/{:d}.png", 1 / 5000)
    (folder / "rgb.txt").write_text("# color images\n" + "".join(f"{k + 0.01:.4f} rgb/{k}.png\n" for k in range(6)))
    # The last depth image has no colour image near it.
    times = [0.0, 1.0, 2.0, 3.0, 4.0, 5.2]
    (folder / "depth.txt").write_text(
        "# depth maps\n" + "".join(f"{t:.4f} depth/{k}.png\n" for k, t in enumerate(times))
    )
    lines = ["# timestamp tx ty tz qx qy qz qw"]
    for k, observation in enumerate(seen()):
        T = lifted(observation.T_world_camera)
        values = (k - 0.004, *T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_quat())
        lines.append(" ".join(f"{value:.6f}" for value in values))
    (folder / "groundtruth.txt").write_text("\n".join(lines) + "\n")


def write_nerfstudio(folder):
    write_images(folder, "images/{:03d}.png", "depth/{:03d}.png", 0.001)
    frames = [
        {
            "file_path": f"images/{k:03d}.png",
            "depth_file_path": f"depth/{k:03d}.png",
            "transform_matrix": (lifted(one.T_world_camera) @ np.diag([1, -1, -1, 1])).tolist(),
        }
        for k, one in enumerate(seen())
    ]
    facts = {"w": 64, "h": 48, "fl_x": CAMERA.fx, "fl_y": CAMERA.fy, "cx": CAMERA.cx, "cy": CAMERA.cy}
    (folder / "transforms.json").write_text(json.dumps(facts | {"frames": frames[::-1]}))


def write_replica(folder):
    write_images(folder, "results/frame{:06d}.jpg", "results/depth{:06d}.png", 1 / 6553.5)
    lines = (" ".join(str(value) for value in lifted(one.T_world_camera).ravel()) for one in seen())
    (folder / "traj.txt").write_text("\n".join(lines) + "\n")
    camera = {"w": 64, "h": 48, "fx": CAMERA.fx, "fy": CAMERA.fy, "cx": 31.5, "cy": 23.5, "scale": 6553.5}
    (folder.parent / "cam_params.json").write_text(json.dumps({"camera": camera}))


def write_ours(folder):
    writer = SequenceWriter(folder)
    for observation in seen():
        writer.write(observation)


def points_of(observation):
    directions = pixel_directions(observation.intrinsics)
    return transform_points(
        observation.T_world_camera, (directions * observation.depth_m[..., None].astype(float)).reshape(-1, 3)
    )


def to_wall_m(observation):
    points = points_of(observation)
    return np.abs(np.minimum(points - ROOM_LOW_M, ROOM_HIGH_M - points)).min(axis=1)


PINHOLE = (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)


@pytest.mark.parametrize(
    ("layout", "write", "num_frames", "camera"),
    [
        ("tum", write_tum, 5, (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)),
        ("nerfstudio", write_nerfstudio, 6, None),
        ("replica", write_replica, 6, None),
        ("anm-mj", write_ours, 6, None),
    ],
)
def test_a_layout_is_recognised_and_its_pixels_lie_on_the_walls(tmp_path, layout, write, num_frames, camera):
    folder = tmp_path / "walk"
    folder.mkdir()
    write(folder)
    sequence, found = open_sequence(folder, SequenceOptions(camera=camera))
    assert found == layout
    observations = list(sequence.observations())
    assert len(observations) == len(sequence) == num_frames
    for before, after in zip(seen(), observations, strict=False):
        np.testing.assert_allclose(after.T_world_camera, before.T_world_camera, atol=0.02)
        assert after.pose.yaw_rad == pytest.approx(before.pose.yaw_rad, abs=1e-4)
        assert to_wall_m(after).max() < 0.02  # The floor is found to a centimetre or two.
        np.testing.assert_allclose(after.rgb.astype(int), before.rgb, atol=3)


def test_a_run_folder_is_a_sequence(tmp_path):
    with new_recorder(tmp_path / "run") as recorder:
        record_steps(recorder, 4)
    sequence, found = open_sequence(tmp_path / "run")
    assert found == "run"
    observations = list(sequence.observations())
    assert len(observations) == 5
    for observation in observations:
        # Reduced depth keeps the first pixel of each block, with its own ray.
        assert observation.depth_m.shape == (128, 128)
        assert to_wall_m(observation).max() < 0.001


@pytest.mark.parametrize("images", ["small", "full"])
@pytest.mark.parametrize("exported", ["run", "nerfstudio", "rosbag"])
def test_a_run_of_a_wide_camera_keeps_the_rays_of_its_depth(tmp_path, images, exported):
    # Depth has 128 rows of it, a small image 102.
    camera = Intrinsics.from_fov(640, 512, math.radians(90.0))
    with new_recorder(tmp_path / "run", record=RecordConfig(images=images)) as recorder:
        recorder.observation(observe(0, Pose2(0.3, -0.2, 0.4), camera))
    path = tmp_path / "run" if exported == "run" else export_run(tmp_path / "run", [exported], tmp_path / "out")[0]
    sequence, found = open_sequence(path, SequenceOptions(floor_m=0.0))
    assert found == exported
    (observation,) = sequence.observations()
    assert observation.depth_m.shape == (128, 128)
    assert to_wall_m(observation).max() < 0.001


def test_another_axis_may_point_up(tmp_path):
    (tmp_path / "walk").mkdir()
    write_nerfstudio(tmp_path / "walk")
    path = tmp_path / "walk" / "transforms.json"
    facts = json.loads(path.read_text())
    # World z up to y up.
    turn = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    for entry in facts["frames"]:
        entry["transform_matrix"] = (turn @ np.array(entry["transform_matrix"])).tolist()
    path.write_text(json.dumps(facts))
    sequence, _ = open_sequence(path, SequenceOptions(up="y", floor_m=LIFT_M))
    for before, after in zip(seen(), sequence.observations(), strict=True):
        np.testing.assert_allclose(after.T_world_camera, before.T_world_camera, atol=1e-9)


def test_the_floor_is_found_from_the_depth(tmp_path):
    (tmp_path / "walk").mkdir()
    write_nerfstudio(tmp_path / "walk")
    sequence, _ = open_sequence(tmp_path / "walk", SequenceOptions(floor_m=0.0))
    assert find_floor_m(sequence) == pytest.approx(LIFT_M, abs=0.01)


@pytest.mark.parametrize(("x", "y", "moved"), [(530_030.0, -180_060.0, (530_000.0, -180_100.0)), (600.0, 700.0, None)])
def test_a_world_whose_origin_is_far_away_is_moved_by_whole_hundreds_of_metres(tmp_path, caplog, x, y, moved):
    (tmp_path / "walk").mkdir()
    write_nerfstudio(tmp_path / "walk")
    path = tmp_path / "walk" / "transforms.json"
    facts = json.loads(path.read_text())
    for entry in facts["frames"]:
        entry["transform_matrix"] = np.array(entry["transform_matrix"])
        entry["transform_matrix"][:2, 3] += x, y
        entry["transform_matrix"] = entry["transform_matrix"].tolist()
    path.write_text(json.dumps(facts))
    sequence, _ = open_sequence(path)
    assert sequence.origin_m[:2] == (moved or (0.0, 0.0))
    assert sequence.origin_m[2] == pytest.approx(LIFT_M, abs=0.02)
    for before, after in zip(seen(), sequence.observations(), strict=True):
        stated = lifted(before.T_world_camera)[:3, 3] + (x, y, 0.0)
        np.testing.assert_allclose(after.T_world_camera[:3, 3] + sequence.origin_m, stated, atol=1e-6)
        assert np.abs(after.T_world_camera[:2, 3]).max() < 1000.0
    assert ("is 560 km from the origin" in caplog.text) == (moved is not None)


def test_only_every_third_frame(tmp_path):
    write_ours(tmp_path / "walk")
    sequence, _ = open_sequence(tmp_path / "walk", SequenceOptions(every=3))
    assert [frame.colour.name for frame in sequence.frames] == ["000000.png", "000003.png"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"layout": "lsd"}, "There is no layout 'lsd'; choose from run, anm-mj, tum"),
        ({"up": "x"}, "--up is 'x'"),
        ({"every": 0}, "--every is 0"),
        ({"layout": "tum"}, "no whole sequence of the layout tum: it has no groundtruth.txt, no rgb.txt"),
    ],
)
def test_what_cannot_be_is_one_sentence(tmp_path, options, message):
    write_ours(tmp_path / "walk")
    with pytest.raises(RunFolderError, match=message):
        open_sequence(tmp_path / "walk", SequenceOptions(**options))


def test_a_folder_of_something_else(tmp_path):
    with pytest.raises(RunFolderError, match=r"is no recorded sequence; it has none of frames\.jsonl \(run\)"):
        open_sequence(tmp_path)
    with pytest.raises(RunFolderError, match="is not a folder"):
        open_sequence(tmp_path / "nowhere")
    with pytest.raises(RunFolderError, match="is not a folder"):
        open_sequence(tmp_path / ("x" * 5000))


def test_a_run_without_images_cannot_be_mapped_again(tmp_path):
    with new_recorder(tmp_path / "run") as recorder:
        record_steps(recorder, 1)
    for path in (tmp_path / "run" / "rgb").iterdir():
        path.unlink()
    with pytest.raises(RunFolderError, match="keeps no colour images"):
        open_sequence(tmp_path / "run")


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("rgb.txt", "rgb/0.png", "../../elsewhere.png", "lies outside"),
        ("groundtruth.txt", "0.70", "nan", "no pose of a camera|cannot be read"),
    ],
)
def test_what_cannot_be_a_recording_is_refused(tmp_path, name, old, new, said):
    write_tum(tmp_path)
    Image.new("RGB", (64, 48)).save(tmp_path.parent / "elsewhere.png")
    lines = (tmp_path / name).read_text()
    changed = lines.replace(old, new) if old in lines else lines.replace("0.0", "nan", 1)
    assert changed != lines
    (tmp_path / name).write_text(changed)
    with pytest.raises(RunFolderError, match=said):
        open_sequence(tmp_path)


@pytest.mark.parametrize(
    "camera", [(0.0, 0.0, 0.0, 0.0), (math.nan, 50.0, 32.0, 24.0), (1e-5, 50.0, 32.0, 24.0), (50.0, 1e5, 32.0, 24.0)]
)
def test_a_camera_that_cannot_be_is_refused(tmp_path, camera):
    write_ours(tmp_path / "walk")
    with pytest.raises(RunFolderError, match="give the true ones by --camera"):
        open_sequence(tmp_path / "walk", SequenceOptions(camera=camera))


def _changed(path, change):
    facts = json.loads(path.read_text())
    change(facts)
    path.write_text(json.dumps(facts))


def _mirror(facts):
    for frame in facts["frames"]:
        frame["transform_matrix"][0] = [-value for value in frame["transform_matrix"][0]]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_mirror, "no pose of a camera"),
        (lambda facts: facts.update(camera_model="EQUIRECTANGULAR"), "camera_model 'EQUIRECTANGULAR'"),
        (lambda facts: facts.update(w="64"), "w is '64', which is no number"),
        (lambda facts: facts.update(w=63.5), "w and h are 63.5"),
        (lambda facts: facts.update(w=True), "w is True, which is no number"),
        (lambda facts: [frame.update(depth_file_path=None) for frame in facts["frames"]], "no frame a depth_file_path"),
        (
            lambda facts: (
                [frame.update(w=facts["w"] + i) for i, frame in enumerate(facts["frames"])] and facts.pop("w")
            ),
            "cameras of different sizes",
        ),
    ],
)
def test_a_nerfstudio_camera_that_is_no_pinhole_is_refused(tmp_path, change, said):
    write_nerfstudio(tmp_path)
    _changed(tmp_path / "transforms.json", change)
    with pytest.raises(RunFolderError, match=said):
        open_sequence(tmp_path)


@pytest.mark.parametrize(
    ("model", "stated", "expected"),
    [
        ("OPENCV", {"k1": 0.3, "p2": 0.01}, ("plumb_bob", (0.3, 0.0, 0.0, 0.01, 0.0))),
        ("OPENCV_FISHEYE", {"k1": 0.1, "k4": 0.02}, ("equidistant", (0.1, 0.0, 0.0, 0.02))),
        ("SIMPLE_RADIAL", {"k1": 0.1}, ("plumb_bob", (0.1, 0.0, 0.0, 0.0, 0.0))),
    ],
)
def test_the_distortion_of_nerfstudio_is_taken_out(tmp_path, model, stated, expected):
    write_nerfstudio(tmp_path)
    _changed(tmp_path / "transforms.json", lambda facts: facts.update(stated, camera_model=model))
    sequence, _ = open_sequence(tmp_path, SequenceOptions(floor_m=0.0))
    assert (sequence.distortion.model, sequence.distortion.coefficients) == expected
    plain, _ = open_sequence(tmp_path, SequenceOptions(floor_m=0.0, distortion=None))
    bent, straight = next(plain.observations()), next(sequence.observations())
    assert not np.array_equal(straight.depth_m, bent.depth_m, equal_nan=True)
    # The centre stays.
    assert straight.depth_m[24, 32] == bent.depth_m[24, 32]


def test_a_distortion_that_a_model_has_not_is_refused(tmp_path):
    write_nerfstudio(tmp_path)
    _changed(tmp_path / "transforms.json", lambda facts: facts.update(k4=0.1))
    with pytest.raises(RunFolderError, match="states k4, which the camera_model 'OPENCV' has not here"):
        open_sequence(tmp_path)


@pytest.mark.parametrize(("name", "k1"), [("freiburg1", 0.2624), ("freiburg2", 0.2312), ("freiburg3", None)])
def test_the_cameras_of_tum_are_known_by_the_folder(tmp_path, name, k1):
    folder = tmp_path / f"rgbd_dataset_{name}_desk"
    folder.mkdir()
    write_tum(folder)
    sequence, _ = open_sequence(folder, SequenceOptions(floor_m=0.0))
    if k1 is None:
        assert sequence.distortion is None
    else:
        assert sequence.distortion.coefficients[0] == k1
        assert f"as published for {name}, by the folder's name" in sequence.distortion.source


def test_poses_may_be_absent_or_have_gaps_where_they_are_found(tmp_path, caplog):
    write_tum(tmp_path)
    truth = tmp_path / "groundtruth.txt"
    lines = truth.read_text().splitlines()
    truth.write_text("\n".join(lines[:3] + lines[4:]) + "\n")
    sequence, _ = open_sequence(tmp_path, SequenceOptions(floor_m=0.0, needs_poses=False, camera=PINHOLE))
    assert len(sequence) == 5
    assert sequence.interpolated == (2,)
    before, between, after = (frame.T_world_camera[:3, 3] for frame in sequence.frames[1:4])
    np.testing.assert_allclose(between, (before + after) / 2, atol=1e-9)
    truth.unlink()
    with pytest.raises(RunFolderError, match="give --track"):
        open_sequence(tmp_path)
    unposed, found = open_sequence(tmp_path, SequenceOptions(needs_poses=False, camera=(525.0, 525.0, 320.0, 240.0)))
    assert (found, unposed.has_poses, len(unposed)) == ("tum", False, 5)
    # By a camera of larger images these small images show what is above only.
    assert "shows nothing below the camera: the floor is taken to be 1 m below" in caplog.text
    assert unposed.frames[0].T_world_camera[2, 3] == 1.0
    assert len({frame.T_world_camera.tobytes() for frame in unposed.frames}) == 1


def test_times_that_run_backwards_are_said(tmp_path, caplog):
    write_nerfstudio(tmp_path)

    def change(facts):
        for frame in facts["frames"]:
            frame["time"] = 100 if "000" in frame["file_path"] else 50

    _changed(tmp_path / "transforms.json", change)
    open_sequence(tmp_path)
    assert "run backwards (frame " in caplog.text


@pytest.mark.parametrize(("key", "value"), [("scale", 0), ("fx", "60"), ("w", [1])])
def test_a_replica_camera_of_other_types_is_refused(tmp_path, key, value):
    folder = tmp_path / "walk"
    folder.mkdir()
    write_replica(folder)
    path = next(each for each in (folder / "cam_params.json", tmp_path / "cam_params.json") if each.is_file())
    _changed(path, lambda facts: facts["camera"].update({key: value}))
    with pytest.raises(RunFolderError, match=rf"camera\.{key}: expected"):
        open_sequence(folder)


def test_a_replica_image_without_its_partner_costs_one_frame(tmp_path, caplog):
    folder = tmp_path / "walk"
    folder.mkdir()
    write_replica(folder)
    (folder / "results" / "depth000002.png").unlink()
    sequence, _ = open_sequence(folder)
    assert len(sequence) == 5
    assert max(to_wall_m(one).max() for one in sequence.observations()) < 0.03
    assert "1 of 6 frames are left out, because they have a colour or a depth image without its partner" in caplog.text


@pytest.mark.parametrize(
    ("write", "poses"), [(write_ours, "poses.tum"), (write_replica, "traj.txt"), (write_tum, "groundtruth.txt")]
)
def test_frames_without_a_pose_are_counted(tmp_path, caplog, write, poses):
    folder = tmp_path / "walk"
    folder.mkdir()
    write(folder)
    path = folder / poses
    path.write_text("\n".join(path.read_text().splitlines()[:-1]) + "\n")
    open_sequence(folder, SequenceOptions(floor_m=0.0, camera=PINHOLE))
    assert "left out, because" in caplog.text


def test_depth_of_complex_numbers_is_refused(tmp_path):
    write_ours(tmp_path)
    np.save(tmp_path / "depth" / "000000.npy", np.zeros((48, 64), complex))
    with pytest.raises(RunFolderError, match="complex128, which is no depth"):
        list(open_sequence(tmp_path, SequenceOptions(max_bad=0.0))[0].observations())
