import numpy as np
import pytest

from anm_mj.errors import RunFolderError, SceneError
from anm_mj.ground_truth.ground_truth import GroundTruth, sample_triangles
from tests.box_room import room, room_truth

TRIANGLES = np.array([[0.0, 0, 0], [3, 0, 0], [0, 1, 0], [0, 0, 5], [1, 0, 5], [0, 1, 5]])
FACES = np.array([[0, 1, 2], [3, 4, 5]])


def sample_surface(vertices, faces, num_samples=100, seed=0):
    return sample_triangles(vertices, faces, num_samples, seed)[0].astype(np.float32)


def test_samples_fall_on_faces_by_their_area():
    samples = sample_surface(TRIANGLES, FACES, 40_000)
    assert np.mean(samples[:, 2] == 0.0) == pytest.approx(0.75, abs=0.01)


def test_samples_fill_a_triangle_evenly():
    samples = sample_surface(TRIANGLES, FACES[:1], 40_000)
    assert samples.mean(axis=0) == pytest.approx([1.0, 1.0 / 3.0, 0.0], abs=0.02)
    assert np.all(samples[:, 0] / 3.0 + samples[:, 1] <= 1.0 + 1e-6)
    # A quarter of a triangle's area lies below half of its height.
    assert np.mean(samples[:, 1] > 0.5) == pytest.approx(0.25, abs=0.01)


def test_same_seed_same_samples_other_seed_others():
    first, again, other = (sample_surface(TRIANGLES, FACES, 100, seed) for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_faces_without_area_get_no_samples():
    faces = np.array([[0, 0, 1], [0, 1, 2], [2, 2, 2]])
    assert np.all(sample_surface(TRIANGLES, faces, 1_000)[:, 2] == 0.0)


def test_a_surface_without_area_is_refused():
    with pytest.raises(SceneError, match="a surface is needed"):
        sample_surface(TRIANGLES, FACES[:0])


def test_saved_truth_reads_back_equal(tmp_path):
    mesh = room()
    for observable in (None, np.arange(100) % 3 == 0):
        truth = GroundTruth(
            sample_surface(mesh.vertices, mesh.faces, 100),
            mesh.vertices.astype(np.float32),
            mesh.faces.astype(np.int32),
            observable,
        )
        truth.save(tmp_path / "truth.npz")
        back = GroundTruth.load(tmp_path / "truth.npz")
        assert np.array_equal(back.samples, truth.samples)
        assert np.array_equal(back.faces, truth.faces)
        assert (back.observable is None) == (observable is None)
        assert observable is None or np.array_equal(back.observable, observable)


def test_missing_and_damaged_truth_are_told_apart(tmp_path):
    with pytest.raises(RunFolderError, match="is missing"):
        GroundTruth.load(tmp_path / "truth.npz")
    room_truth(100).save(tmp_path / "truth.npz")
    data = (tmp_path / "truth.npz").read_bytes()
    for damaged in (data[: len(data) // 2], b"", b"not a zip file"):
        (tmp_path / "truth.npz").write_bytes(damaged)
        with pytest.raises(RunFolderError, match="cannot be read as a true surface"):
            GroundTruth.load(tmp_path / "truth.npz")


def test_samples_in_one_place_are_no_surface(tmp_path):
    GroundTruth(np.zeros((2000, 3), np.float32), TRIANGLES.astype(np.float32), FACES.astype(np.int32)).save(
        tmp_path / "a.npz"
    )
    with pytest.raises(RunFolderError, match="2000 of 2000 samples lie in one place"):
        GroundTruth.load(tmp_path / "a.npz")
