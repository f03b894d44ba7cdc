"""Poses of keyframes from what was measured between them."""

from dataclasses import replace

import numpy as np
import pytest

from anm_mj.localisation.pose_graph import Edge, chi_squares, optimised
from anm_mj.localisation.registration import FREE, PLANAR
from anm_mj.localisation.se3 import camera_motion, moved_camera
from tests.mapping.ray_room import camera_pose

COUNT = 24
INFORMATION = np.diag([1e4] * 3 + [1e5] * 3)


def ring() -> np.ndarray:
    """A way round a circle, back to its beginning."""
    angle = np.linspace(0.0, 2.0 * np.pi, COUNT)
    return np.array([camera_pose(2.0 * np.cos(a), 2.0 * np.sin(a), 1.0, a + np.pi / 2) for a in angle])


def edge(poses: np.ndarray, first: int, second: int, error: np.ndarray | None = None, kernel: float = 0.0) -> Edge:
    """What is measured between two poses, with an error."""
    second_pose = poses[second] if error is None else moved_camera(poses[second], error)
    return Edge(first, second, np.linalg.inv(poses[first]) @ second_pose, INFORMATION, kernel)


def drifted(true: np.ndarray) -> tuple[list[Edge], np.ndarray]:
    """Edges along the way that turn a little too far each, and the poses that they make."""
    error = np.array([0.004, -0.003, 0.0, 0.0, 0.0, 0.008])
    edges = [edge(true, k, k + 1, error) for k in range(COUNT - 1)]
    poses = [true[0]]
    for one in edges:
        poses.append(poses[-1] @ one.T_first_second)
    return edges, np.array(poses)


def worst_m(poses: np.ndarray, true: np.ndarray) -> float:
    return float(np.linalg.norm(poses[:, :3, 3] - true[:, :3, 3], axis=1).max())


def first_fixed() -> np.ndarray:
    return np.arange(COUNT) == 0


@pytest.mark.parametrize("basis", [PLANAR, FREE])
def test_a_loop_takes_the_drift_away(basis: np.ndarray) -> None:
    true = ring()
    edges, poses = drifted(true)
    found = optimised(poses, [*edges, edge(true, 0, COUNT - 1)], first_fixed(), basis)
    assert worst_m(poses, true) > 0.3
    assert worst_m(found, true) < 0.4 * worst_m(poses, true)
    assert worst_m(found[-1:], true[-1:]) < 0.03
    np.testing.assert_array_equal(found[0], poses[0])
    np.testing.assert_allclose(found[:, 2, 3], 1.0, atol=1e-6)


def test_poses_that_agree_with_everything_stay() -> None:
    true = ring()
    edges = [edge(true, k, k + 1) for k in range(COUNT - 1)] + [edge(true, 0, 9), edge(true, 3, 20)]
    np.testing.assert_allclose(optimised(true, edges, first_fixed(), FREE), true, atol=1e-8)


def test_fixed_poses_stay_and_bind_the_others() -> None:
    true = ring()
    edges, poses = drifted(true)
    fixed = np.arange(COUNT) < 12
    poses[:12] = true[:12]
    found = optimised(poses, edges, fixed, PLANAR)
    np.testing.assert_array_equal(found[:12], true[:12])
    assert chi_squares(found, edges[11:]).max() < 1e-6


def test_a_kernel_takes_the_say_from_a_wrong_edge() -> None:
    true = ring()
    edges = [edge(true, k, k + 1) for k in range(COUNT - 1)]
    wrong = edge(true, 0, 12, np.array([0.5, 0.3, 0.0, 0.0, 0.0, 0.2]), kernel=3.0)
    assert worst_m(optimised(true, [*edges, wrong], first_fixed(), PLANAR), true) < 0.01
    assert worst_m(optimised(true, [*edges, replace(wrong, kernel=0.0)], first_fixed(), PLANAR), true) > 0.05


def test_the_deviation_is_that_of_the_second_pose() -> None:
    true = ring()
    change = np.array([0.02, -0.01, 0.0, 0.0, 0.0, 0.03])
    one = edge(true, 2, 5)
    moved = true.copy()
    moved[5] = moved_camera(true[5], change)
    np.testing.assert_allclose(one.deviation(moved), change, atol=1e-9)
    np.testing.assert_allclose(camera_motion(true[5], moved[5]), change, atol=1e-9)
    assert chi_squares(moved, [one])[0] == pytest.approx(1e4 * (0.02**2 + 0.01**2) + 1e5 * 0.03**2)
