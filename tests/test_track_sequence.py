"""A recorded sequence whose poses are found in the map that grows from it."""

import json
import math

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from anm_mj import map_sequence
from anm_mj.cli.main import main
from anm_mj.cli.map import is_of_sequence
from anm_mj.frames import pixel_directions
from anm_mj.io.jsonl import read_jsonl
from anm_mj.sequence_check.correction import axes_matrix
from anm_mj.types import Intrinsics, Pose2
from tests.box_room import camera_pose, room_depth

pytestmark = pytest.mark.usefixtures("quick_results")

CAMERA = Intrinsics.from_fov(128, 96, math.radians(70.0))
FRAMES = 30
GAP = range(16, 24)
"""Frames in which something hangs before the lens."""
CALIBRATION = f"{CAMERA.fx},{CAMERA.fy},{CAMERA.cx},{CAMERA.cy}"
START_S = 1305031910.765


def walk(step):
    """The camera in a hand: it turns, sways, nods."""
    T = camera_pose(Pose2(-0.6 + 0.02 * step, 0.1 * math.sin(0.3 * step), math.radians(1.5 * step)), 1.25)
    T[:3, :3] = T[:3, :3] @ Rotation.from_euler("xz", [0.05 * math.sin(0.4 * step), 0.02 * step / 5]).as_matrix()
    return T


def picture(T, depth_m):
    """Colours that depend on the place on the wall."""
    xyz = T[:3, 3] + (pixel_directions(CAMERA) * depth_m[..., None]) @ T[:3, :3].T
    waves = [np.sin(xyz @ np.array(k) + a) for a, k in enumerate([(5.0, 3.0, 2.0), (2.0, 6.0, 3.0), (3.0, 2.0, 5.0)])]
    return np.clip(128 + 100 * np.stack(waves, axis=-1), 0, 255).astype(np.uint8)


def write(folder, *, gap=(), poses=(), axes="RDF"):
    """A sequence in the layout of TUM, with the poses of some frames in it, in camera axes of choice."""
    lists = {"rgb": [], "depth": []}
    for name in lists:
        (folder / name).mkdir(parents=True)
    truth, stated = {}, {}
    for step in range(FRAMES):
        T = walk(step)
        depth_m = room_depth(T, CAMERA)
        rgb = picture(T, depth_m)
        if step in gap:
            # A hand before the lens, of another shape in every frame.
            col, row = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
            depth_m = (0.4 + 0.1 * np.sin(0.1 * col + step) * np.cos(0.08 * row - step)).astype(np.float32)
        Image.fromarray(rgb).save(folder / "rgb" / f"{step}.png")
        Image.fromarray(np.rint(depth_m * 5000).astype(np.uint16)).save(folder / "depth" / f"{step}.png")
        time_s = START_S + step / 30.0
        for name, lines in lists.items():
            lines.append(f"{time_s:.6f} {name}/{step}.png")
        for lines, turn in ((truth, np.eye(3)), (stated, axes_matrix(axes))):
            values = (*T[:3, 3], *Rotation.from_matrix(T[:3, :3] @ turn).as_quat())
            lines[step] = f"{time_s:.6f} " + " ".join(f"{value:.6f}" for value in values)
    for name, lines in lists.items():
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    if poses:
        (folder / "groundtruth.txt").write_text("\n".join(stated[step] for step in poses) + "\n")
    (folder.parent / "reference.tum").write_text("\n".join(truth.values()) + "\n")
    return folder


def said(capsys):
    """All that was printed, in one line."""
    return " ".join("".join(capsys.readouterr()).split())


def track(folder, out, *words):
    command = ["map", str(folder), "--track", "--out", str(out), "--camera", CALIBRATION, "--preset", "quick", *words]
    assert main([*command, "--set", "mapping.schedule.final_iterations=0"]) == 0
    return json.loads((out / "metrics.json").read_text())


@pytest.fixture(scope="module")
def tracked(tmp_path_factory):
    folder = write(tmp_path_factory.mktemp("hand") / "walk")
    out = tmp_path_factory.mktemp("tracked") / "walk"
    metrics = track(folder, out, "--reference", str(folder.parent / "reference.tum"), "--floor", "-1.25")
    return folder, out, metrics


def test_poses_are_found_without_any(tracked):
    _, out, metrics = tracked
    assert metrics["frames"] == FRAMES
    assert metrics["lost_percent"] == 0.0
    assert metrics["ate_rmse_cm"] < 3.0
    assert metrics["position_rmse_cm"] < 6.0
    assert metrics["final_position_error_cm"] < 10.0
    assert set(metrics["frame_ms"]) == {"read", "localise", "check", "map"}
    frames = read_jsonl(out / "frames.jsonl")
    assert all(frame["localisation"]["state"] == "TRACKING" for frame in frames)
    # The first camera defines the world: it is held level, 1.25 m above the floor.
    first = np.array(frames[0]["T_world_camera"])
    np.testing.assert_allclose(first, [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 1.25], [0, 0, 0, 1]], atol=1e-9)


def test_the_camera_s_trajectory_is_in_the_format_of_tum(tracked):
    _, out, _ = tracked
    lines = (out / "trajectory_camera.tum").read_text().splitlines()
    assert len(lines) == FRAMES
    assert all(len(line.split()) == 8 for line in lines)
    # To the microsecond, though it counts from 1970.
    times = [float(line.split()[0]) for line in lines]
    np.testing.assert_allclose(times, START_S + np.arange(FRAMES) / 30.0, atol=1e-6)
    last = np.array(read_jsonl(out / "frames.jsonl")[-1]["T_world_camera"])
    np.testing.assert_allclose([float(word) for word in lines[-1].split()[1:4]], last[:3, 3], atol=1e-6)


def test_the_same_seed_gives_the_same_poses(tracked, tmp_path):
    folder, out, _ = tracked
    again = tmp_path / "again"
    track(folder, again, "--floor", "-1.25")
    assert (again / "trajectory_camera.tum").read_bytes() == (out / "trajectory_camera.tum").read_bytes()


def test_poses_of_the_sequence_are_a_prior_and_their_gaps_are_bridged(tmp_path, capsys):
    known = [step for step in range(FRAMES) if not 3 <= step <= 19 and step != 29]
    folder = write(tmp_path / "walk", poses=known)
    metrics = track(folder, tmp_path / "out", "--reference", str(tmp_path / "reference.tum"), "--floor", "0")
    assert "18 of 30 frames have no pose (3-19, 29)" in said(capsys)
    assert metrics["frames"] == FRAMES
    assert metrics["ate_rmse_cm"] < 2.0
    first = np.array(read_jsonl(tmp_path / "out" / "frames.jsonl")[0]["T_world_camera"])
    np.testing.assert_allclose(first, walk(0), atol=1e-5)


@pytest.mark.slow
def test_a_prior_with_other_camera_axes_is_put_right(tmp_path):
    folder = write(tmp_path / "walk", poses=range(FRAMES), axes="RUB")
    out = tmp_path / "out"
    words = ["--reference", str(tmp_path / "reference.tum"), "--floor", "0", "--every", "2", "--fix"]
    metrics = track(folder, out, *words)
    assert json.loads((out / "manifest.json").read_text())["corrections"] == ["--axes RUB"]
    assert metrics["ate_rmse_cm"] < 2.0


def test_a_reference_of_the_sequence_itself_is_no_prior(tmp_path, capsys):
    folder = write(tmp_path / "walk", poses=range(FRAMES))
    track(folder, tmp_path / "out", "--reference", str(folder / "groundtruth.txt"), "--every", "5", "--floor", "-1.25")
    words = said(capsys)
    assert "the first camera defines the world" in words
    assert "ATE RMSE, aligned" in words


def test_a_reference_belongs_to_a_sequence_that_is_given_as_a_file(tmp_path):
    (tmp_path / "walk").mkdir()
    for file in ("transforms.json", "poses.tum"):
        (tmp_path / "walk" / file).touch()
    assert is_of_sequence(tmp_path / "walk" / "poses.tum", tmp_path / "walk" / "transforms.json")
    assert is_of_sequence(tmp_path / "walk" / "poses.tum", tmp_path / "walk")
    assert not is_of_sequence(tmp_path / "poses.tum", tmp_path / "walk" / "transforms.json")


@pytest.mark.slow
def test_a_gap_is_lost_named_and_not_mapped(tmp_path, capsys, monkeypatch):
    folder = write(tmp_path / "walk", gap=GAP)
    out = tmp_path / "out"
    make, heard = map_sequence._shadow_policy, []

    def listening(*arguments):
        policy = make(*arguments)
        observe = policy.observe
        monkeypatch.setattr(policy, "observe", lambda seen: (heard.append(seen.step), observe(seen))[1], raising=False)
        return policy

    monkeypatch.setattr(map_sequence, "_shadow_policy", listening)
    metrics = track(folder, out, "--floor", "-1.25", "--shadow")
    frames = read_jsonl(out / "frames.jsonl")
    usable = [frame["localisation"]["usable"] for frame in frames]
    assert not any(usable[step] for step in GAP)
    # What is not in the map was not seen.
    assert heard == [step for step in range(FRAMES) if usable[step]]
    lost = [frame["step"] for frame in frames if frame["localisation"]["state"] == "LOST"]
    assert lost
    assert lost[0] in GAP
    assert all(frames[step]["fit"]["fitting"] is None for step in lost)
    assert metrics["lost_percent"] == pytest.approx(100.0 * len(lost) / FRAMES)
    assert f"LOST in {len(lost)} of 30 frames: {lost[0]}" in said(capsys)
    assert len((out / "trajectory_camera.tum").read_text().splitlines()) == FRAMES - len(lost)


def test_without_track_a_sequence_without_poses_is_refused(tmp_path, capsys):
    folder = write(tmp_path / "walk")
    assert main(["map", str(folder), "--out", str(tmp_path / "out")]) == 2
    assert "has no groundtruth.txt; give --track" in said(capsys)
    words = ["--reference", str(tmp_path / "reference.tum")]
    assert main(["map", str(folder), "--out", str(tmp_path / "out"), *words]) == 2
    assert "--reference is for poses that --track finds" in said(capsys)


@pytest.mark.parametrize(
    "words", ["0.1,x", "nan,0.1", "division,0.1", "fisheye,0.1,0.1,0.1,0.1,0.1", ",".join(["0.1"] * 13)]
)
def test_a_distortion_that_cannot_be_is_one_sentence(tmp_path, capsys, words):
    folder = write(tmp_path / "walk")
    assert main(["map", str(folder), "--track", "--out", str(tmp_path / "out"), "--distortion", words]) == 2
    assert "--distortion is" in said(capsys)


def test_a_reference_of_few_poses_is_interpolated_across_the_gap_that_is_given(tmp_path):
    folder = write(tmp_path / "walk", poses=range(FRAMES))
    reference = tmp_path / "reference.tum"
    lines = reference.read_text().splitlines()
    reference.write_text(f"{lines[0]}\n{lines[-1]}\n")
    words = ["--every", "5", "--floor", "0", "--reference", str(reference), "--max-gap", "1.5"]
    assert track(folder, tmp_path / "out", *words)["ate_rmse_cm"] < 10.0
