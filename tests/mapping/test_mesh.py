import numpy as np
import pytest

from anm_mj.errors import MapError
from anm_mj.mapping.config import OccupancyConfig
from anm_mj.mapping.mesh import extract_mesh
from anm_mj.mapping.occupancy import OccupancyGrid


@pytest.fixture(scope="module")
def occupancy(room) -> OccupancyGrid:
    grid = OccupancyGrid(OccupancyConfig())
    for observation in room.turn(1.5, 1.5, 12, size=128):
        grid.integrate(observation.depth_m, observation.intrinsics, observation.T_world_camera)
    return grid


def _exact(room):
    return lambda points: np.clip(room.sdf(points), -0.1, 0.1).astype(np.float32)


@pytest.mark.parametrize("resolution_m", [0.03, 0.05, 0.1])
def test_the_mesh_of_the_exact_field_lies_on_the_walls_and_faces_the_room(room, occupancy, resolution_m):
    vertices, faces = extract_mesh(_exact(room), occupancy, resolution_m)
    assert len(faces) > 1000
    assert np.abs(room.sdf(vertices)).mean() < 0.2 * resolution_m
    a, b, c = vertices[faces].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    centre = (a + b + c) / 3.0
    assert (room.sdf(centre + 0.02 * normal) > room.sdf(centre - 0.02 * normal)).mean() > 0.99


def test_blocks_meet_without_seams(room, occupancy):
    _, faces = extract_mesh(_exact(room), occupancy, 0.05)
    edges = np.sort(np.concatenate((faces[:, :2], faces[:, 1:], faces[:, ::2])), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts <= 2).all()
    open_edges = (counts == 1).sum()
    # Only the rims of what was not seen are open: a seam would cut the room across.
    assert open_edges < 0.08 * len(counts)


def test_nothing_floats_where_nothing_was_observed(room, occupancy):
    rippled = lambda points: np.sin(points.sum(axis=1) * 9.0).astype(np.float32)  # noqa: E731
    vertices, faces = extract_mesh(rippled, occupancy, 0.05)
    assert len(faces)
    assert np.abs(room.sdf(vertices)).max() < 0.12


def test_an_empty_grid_gives_an_empty_mesh(room):
    vertices, faces = extract_mesh(_exact(room), OccupancyGrid(OccupancyConfig()), 0.05)
    assert len(vertices) == len(faces) == 0


def test_a_resolution_of_nothing_is_refused(room, occupancy):
    with pytest.raises(MapError, match=r"resolution is 0\.0"):
        extract_mesh(_exact(room), occupancy, 0.0)


def test_the_learnt_mesh_is_accurate_and_coloured(trained_map, room):
    mesh = trained_map.mesh(0.05)
    error = np.abs(room.sdf(mesh.vertices))
    assert error.mean() < 0.025
    assert (error < 0.05).mean() > 0.9
    colors = np.asarray(mesh.visual.vertex_colors)[:, :3] / 255.0
    assert np.abs(colors - room.color(mesh.vertices)).mean() < 0.1
