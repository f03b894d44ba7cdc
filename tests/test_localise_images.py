"""Images are found in the map of a finished run."""

import gc
import json
import math
import shutil
import signal
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from anm_mj.cli import console
from anm_mj.cli.main import main
from anm_mj.config import make_config
from anm_mj.frames import pose_matrix
from anm_mj.io.own_sequence import SequenceWriter
from anm_mj.io.sequence_layouts import SequenceOptions, open_sequence
from anm_mj.localisation.floor_plane import pose_above_floor
from anm_mj.localisation.relocaliser import Relocaliser
from anm_mj.localise_images import localise_images
from anm_mj.types import Observation, Pose2
from tests.mapping.ray_room import TABLE, Room

pytestmark = pytest.mark.usefixtures("quick_results")

CUPBOARD = (np.array([0.0, 2.4, 0.0]), np.array([1.2, 3.0, 1.9]))
STEP = math.radians(10.0)


def write(folder, views):
    room = Room((TABLE, CUPBOARD))
    writer = SequenceWriter(folder)
    for step, view in enumerate(views):
        writer.write(replace(room.observe(*view, size=96, step=step), time_s=0.1 * step))
    return folder


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mapped")
    walk = write(folder / "walk", [(1.5 + 0.005 * k, 1.5, STEP * k) for k in range(40)])
    assert main(["map", str(walk), "--out", str(folder / "run"), "--preset", "quick"]) == 0
    return folder / "run"


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    return write(tmp_path_factory.mktemp("images") / "others", [(1.2, 1.3, 2.0 - 0.5 * STEP * k) for k in range(12)])


def localised(mapped, images, out, *words):
    assert main(["localise", str(mapped), str(images), "--out", str(out), *words]) == 0
    return json.loads((out / "poses.json").read_text())


def test_all_images_of_a_walk_are_found_also_those_before_the_first_that_was(mapped, images, tmp_path):
    out = localised(mapped, images, tmp_path / "out", "--reference", str(images / "poses.tum"))
    assert out["found"] == out["frames"] == 12
    assert out["position_rmse_cm"] < 4.0
    found, true = np.loadtxt(tmp_path / "out" / "poses.tum"), np.loadtxt(images / "poses.tum")
    np.testing.assert_allclose(found[:, 0], true[:, 0])
    np.testing.assert_allclose(found[:, 1:4], true[:, 1:4], atol=0.06)
    turned = Rotation.from_quat(found[:, 4:]) * Rotation.from_quat(true[:, 4:]).inv()
    assert turned.magnitude().max() < math.radians(2.0)
    assert all(0.0 < pose["deviation_m"] < 0.05 for pose in out["poses"])


@pytest.mark.slow
def test_single_images_are_found_one_by_one(mapped, tmp_path):
    places = [(1.2, 1.3, 2.0), (1.9, 1.9, 2.5), (1.5, 1.3, 0.2)]
    out = localised(mapped, write(tmp_path / "scattered", places), tmp_path / "out", "--single")
    found = [pose["T_world_camera"] for pose in out["poses"]]
    for place, T in zip(places, found, strict=True):
        if T is not None:
            np.testing.assert_allclose(np.array(T)[:2, 3], place[:2], atol=0.1)
    assert out["found"] == sum(T is not None for T in found) >= 1


def test_two_images_are_enough(mapped, tmp_path):
    images = write(tmp_path / "two", [(1.2, 1.3, 2.0 - 0.5 * STEP * k) for k in range(2)])
    out = localised(mapped, images, tmp_path / "out", "--reference", str(images / "poses.tum"))
    assert out["found"] >= 1
    found, true = np.loadtxt(tmp_path / "out" / "poses.tum", ndmin=2), np.loadtxt(images / "poses.tum")
    np.testing.assert_allclose(found[-1, 1:4], true[-1, 1:4], atol=0.06)


def test_what_the_map_does_not_show_is_not_found(mapped, tmp_path, capsys):
    writer = SequenceWriter(tmp_path / "elsewhere")
    for step in range(6):
        seen = Room().observe(1.5, 1.5, STEP * step, size=96, step=step)
        # A wall, half a metre ahead.
        writer.write(replace(seen, depth_m=np.full_like(seen.depth_m, 0.5), rgb=np.full_like(seen.rgb, 255)))
    words = ["localise", str(mapped), str(tmp_path / "elsewhere"), "--out", str(tmp_path / "out")]
    assert main(words) == 1
    told = capsys.readouterr().out
    assert "0 of 6 images found." in told
    assert "Not found: 0-5 (looked for in the whole map" in told
    assert (tmp_path / "out" / "poses.tum").read_text() == ""
    assert json.loads((tmp_path / "out" / "poses.json").read_text())["found"] == 0
    assert all(pose["searched"] for pose in json.loads((tmp_path / "out" / "poses.json").read_text())["poses"])


def test_what_was_found_before_an_error_is_written(mapped, images, tmp_path, capsys):
    folder, out = tmp_path / "others", tmp_path / "out"
    shutil.copytree(images, folder)
    for step in range(9, 12):
        (folder / "rgb" / f"{step:06d}.png").write_bytes(b"")
    assert main(["localise", str(mapped), str(folder), "--out", str(out)]) == 2
    told = " ".join("".join(capsys.readouterr()).split())
    assert "3 of 12 frames of" in told
    assert f"Localisation ended after 9 of 12 images; {out} holds the poses up to there." in told
    assert json.loads((out / "poses.json").read_text())["found"] == 9
    assert len((out / "poses.tum").read_text().splitlines()) == 9


def test_what_was_found_before_an_interruption_is_written(mapped, images, tmp_path, capsys, monkeypatch):
    @contextmanager
    def bar(*_):
        yield lambda done, total: signal.raise_signal(signal.SIGTERM) if done == 8 else None

    monkeypatch.setattr(console, "progress_bar", bar)
    assert localised(mapped, images, tmp_path / "out")["frames"] == 8
    assert "Localisation ended after 8 of 12 images" in " ".join(capsys.readouterr().err.split())
    assert len((tmp_path / "out" / "poses.tum").read_text().splitlines()) == 8


def test_images_that_wait_for_a_place_take_no_memory(mapped, images, tmp_path, monkeypatch):
    """They are read again once a place is found."""
    monkeypatch.setattr(Relocaliser, "look", lambda *_: None)
    sequence, _ = open_sequence(images, SequenceOptions(needs_poses=False, ignores_poses=True))
    config = make_config("quick", [], scene=str(images), pose="slam")
    alive = []

    def count(*_):
        gc.collect()
        alive.append(sum(type(one) is Observation for one in gc.get_objects()))

    # To look through what was there before takes longer than the images.
    gc.freeze()
    try:
        assert all(pose.T_world_camera is None for pose in localise_images(mapped, sequence, config, on_image=count))
    finally:
        gc.unfreeze()
    assert alive[-1] <= alive[2]


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("images", "is not a folder; give that of a recorded sequence"),
        ("run", "is not a folder; give the folder that a run wrote"),
        ("out", "choose another folder"),
    ],
)
def test_wrong_input_is_one_sentence(mapped, images, tmp_path, capsys, wrong, words):
    given = {"run": mapped, "images": images, "out": tmp_path / "out"}
    given[wrong] = mapped if wrong == "out" else tmp_path / "nothing"
    assert main(["localise", str(given["run"]), str(given["images"]), "--out", str(given["out"])]) == 2
    assert words in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("pitch", [0.0, 0.4])
def test_the_floor_tells_height_and_tilt(pitch):
    rng = np.random.default_rng(0)
    floor = np.column_stack((rng.uniform(0.5, 4.0, 300), rng.uniform(-2.0, 2.0, 300), np.zeros(300)))
    wall = np.column_stack((np.full(300, 4.0), rng.uniform(-2.0, 2.0, 300), rng.uniform(0.0, 2.5, 300)))
    T = pose_matrix(Pose2(0.0, 0.0, 0.0))
    T[:3, :3] = (
        np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
        @ Rotation.from_rotvec([-pitch, 0.0, 0.0]).as_matrix()
    )
    T[2, 3] = 1.1
    points = ((np.vstack((floor, wall)) - T[:3, 3]) @ T[:3, :3]).astype(np.float32)
    found = pose_above_floor(points, rng)
    assert found is not None
    np.testing.assert_allclose(found, T, atol=1e-3)
    assert pose_above_floor(points[300:], rng) is None
    assert pose_above_floor(points[:10], rng) is None
