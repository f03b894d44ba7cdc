import numpy as np
import pytest
import trimesh

from anm_mj.errors import SceneError
from anm_mj.evaluation.mesh_quality import mesh_quality
from anm_mj.ground_truth.ground_truth import GroundTruth, sample_triangles
from tests.evaluation.triangle_distance import triangle_distance_squared


def plate(x_m: float, y_m: float, z_m: float, cells: int = 1) -> trimesh.Trimesh:
    """A horizontal rectangle with a corner at the origin's side, in 2 * cells ** 2 triangles."""
    x, y = np.meshgrid(np.linspace(0.0, x_m, cells + 1), np.linspace(0.0, y_m, cells + 1))
    vertices = np.stack([x.ravel(), y.ravel(), np.full(x.size, z_m)], axis=1)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()[:, None]
    faces = np.concatenate([corner + np.array(f) for f in ([0, 1, cells + 1], [1, cells + 2, cells + 1])])
    return trimesh.Trimesh(vertices, faces, process=False)


def truth_of(mesh: trimesh.Trimesh) -> GroundTruth:
    return GroundTruth.sample(np.asarray(mesh.vertices), np.asarray(mesh.faces), 5_000)


def quality(mesh: trimesh.Trimesh, truth: GroundTruth):
    everything = np.ones(len(truth.samples), bool)
    whole, culled = mesh_quality(np.asarray(mesh.vertices), np.asarray(mesh.faces), truth, everything, 5_000)
    assert culled == whole
    return whole


def test_a_perfect_mesh_has_no_error_however_it_is_cut():
    # Distances from samples to samples would be some centimetres here.
    found = quality(plate(4.0, 3.0, 0.0, cells=37), truth_of(plate(4.0, 3.0, 0.0)))
    assert found.accuracy_cm == pytest.approx(0.0, abs=1e-6)
    assert found.completion_cm == pytest.approx(0.0, abs=5e-3)
    assert found.completion_ratio_percent == 100.0


@pytest.mark.parametrize(("offset_m", "ratio"), [(0.03, 100.0), (0.06, 0.0)])
def test_a_shifted_mesh_is_off_by_the_shift_both_ways(offset_m, ratio):
    found = quality(plate(4.0, 3.0, offset_m, cells=20), truth_of(plate(4.0, 3.0, 0.0)))
    assert found.accuracy_cm == pytest.approx(100.0 * offset_m, rel=1e-4)
    assert found.completion_cm == pytest.approx(100.0 * offset_m, abs=5e-3)
    assert found.completion_ratio_percent == ratio


def test_a_chair_is_no_ghost_where_it_stands():
    floor, seat = plate(4.0, 3.0, 0.0, cells=20), plate(0.3, 0.3, 0.45)
    mesh, truth = trimesh.util.concatenate([floor, seat]), truth_of(plate(4.0, 3.0, 0.0))
    everything = np.ones(len(truth.samples), bool)
    here, gone = (
        mesh_quality(*mesh_arrays(mesh), truth, everything, 5_000, at) for at in ((0.15, 0.15, 0.0), (9.0, 9.0, 0.0))
    )
    assert here[0].ghost_percent == 0.0
    assert gone[0].ghost_percent == pytest.approx(100 * 0.09 / 12.09, rel=0.3)
    assert here[0].accuracy_cm == pytest.approx(0.0, abs=1e-6)


def test_a_mesh_of_nothing_but_a_leaf_of_a_door_is_not_judged():
    truth = truth_of(plate(4.0, 3.0, 0.0))
    everything = np.ones(len(truth.samples), bool)
    leaf = mesh_arrays(plate(0.8, 0.04, 1.0))
    assert mesh_quality(*leaf, truth, everything, 5_000, doors=[(0.0, 0.0, 0.0, 0.8)]) is None
    assert mesh_quality(*leaf, truth, everything, 5_000) is not None


def test_half_a_mesh_is_accurate_but_not_complete():
    found = quality(plate(2.0, 3.0, 0.0), truth_of(plate(4.0, 3.0, 0.0)))
    assert found.accuracy_cm == pytest.approx(0.0, abs=1e-6)
    # Within 5 cm: 2.05 of 4 m. Mean distance: 0 over one half, 0 to 2 m over the other.
    assert found.completion_ratio_percent == pytest.approx(51.25, abs=2.0)
    assert found.completion_cm == pytest.approx(50.0, rel=0.05)


def test_a_mesh_without_area_is_refused():
    with pytest.raises(SceneError, match="a surface is needed"):
        mesh_quality(np.zeros((3, 3)), np.array([[0, 1, 2]]), truth_of(plate(1.0, 1.0, 0.0)), np.ones(5_000, bool))


def slow_quality(samples, truth_triangles, true_samples, mesh_triangles):
    """Every number by its definition: all distances to all triangles."""

    def nearest(points, triangles):
        return np.sqrt([triangle_distance_squared(np.tile(p, (len(triangles), 1)), triangles).min() for p in points])

    accuracy, completion = nearest(samples, truth_triangles), nearest(true_samples, mesh_triangles)
    precision, recall = np.mean(accuracy < 0.05), np.mean(completion < 0.05)
    f_score = 2.0 * precision * recall / (precision + recall)
    return 100.0 * np.array([accuracy.mean(), completion.mean(), recall, precision, f_score]), accuracy, completion


def numbers(found):
    return [
        found.accuracy_cm,
        found.completion_cm,
        found.completion_ratio_percent,
        found.precision_percent,
        found.f_score_percent,
    ]


def test_all_numbers_agree_with_their_definitions_with_culling_and_without():
    truth = GroundTruth.sample(*mesh_arrays(plate(2.0, 1.0, 0.0, cells=2)), 700)
    bumpy = plate(2.4, 1.0, 0.0, cells=5)
    bumpy.vertices[:, 2] = 0.04 + 0.03 * np.sin(7.0 * bumpy.vertices[:, 0])
    covered = truth.samples[:, 0] < 1.1
    samples, _ = sample_triangles(*mesh_arrays(bumpy), 600, 0)

    whole, culled = mesh_quality(*mesh_arrays(bumpy), truth, covered, 600)

    true_triangles = truth.vertices[truth.faces].astype(float)
    slow, accuracy, completion = slow_quality(
        samples, true_triangles, truth.samples.astype(float), np.asarray(bumpy.triangles)
    )
    assert numbers(whole) == pytest.approx(slow, rel=1e-3)
    assert whole.chamfer_cm == pytest.approx(slow[:2].mean(), rel=1e-3)
    kept = covered[[np.argmin(((truth.samples - p) ** 2).sum(axis=1)) for p in samples]]
    assert 0.2 < kept.mean() < 0.8
    assert culled.accuracy_cm == pytest.approx(100.0 * accuracy[kept].mean(), rel=1e-3)
    assert culled.completion_cm == pytest.approx(100.0 * completion[covered].mean(), rel=1e-3)
    assert culled.precision_percent == pytest.approx(100.0 * np.mean(accuracy[kept] < 0.05), rel=1e-3)


def test_a_run_that_observed_nothing_has_no_culled_quality():
    truth = truth_of(plate(1.0, 1.0, 0.0))
    assert mesh_quality(*mesh_arrays(plate(1.0, 1.0, 0.1)), truth, np.zeros(5_000, bool), 100)[1] is None


def mesh_arrays(mesh):
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)
