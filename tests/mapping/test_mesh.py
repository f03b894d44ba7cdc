import numpy as np
import pytest
from scipy.spatial import KDTree
from skimage.measure import marching_cubes

from anm_mj.errors import MapError
from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.mapping.mesh import MeshExtractor, Triangles
from tests.mapping.ray_room import Room


@pytest.fixture(scope="module")
def occupancy(room) -> DepthOccupancy:
    grid = DepthOccupancy(OccupancyConfig())
    for observation in room.turn(1.5, 1.5, 12, size=128):
        grid.integrate(observation.depth_m, observation.intrinsics, observation.T_world_camera)
    return grid


def _extract(sdf, occupancy, resolution_m) -> tuple[np.ndarray, np.ndarray]:
    triangles = MeshExtractor(occupancy).extract(sdf, _black, resolution_m)
    return triangles.vertices_m, triangles.faces


def _black(points):
    return np.zeros((len(points), 3), np.float32)


def _corners(triangles: Triangles) -> set[tuple[float, ...]]:
    """The triangles as values, whatever order they and their vertices are stored in."""
    corners = np.round(triangles.vertices_m[triangles.faces], 4)
    return {tuple(np.roll(c, -np.lexsort(c.T)[0], axis=0).ravel().tolist()) for c in corners}


def _exact(room):
    return lambda points: np.clip(room.sdf(points), -0.1, 0.1).astype(np.float32)


@pytest.mark.parametrize("resolution_m", [0.03, 0.05, 0.1])
def test_the_mesh_of_the_exact_field_lies_on_the_walls_and_faces_the_room(room, occupancy, resolution_m):
    vertices, faces = _extract(_exact(room), occupancy, resolution_m)
    assert len(faces) > 1000
    assert np.abs(room.sdf(vertices)).mean() < 0.2 * resolution_m
    a, b, c = vertices[faces].transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    centre = (a + b + c) / 3.0
    assert (room.sdf(centre + 0.02 * normal) > room.sdf(centre - 0.02 * normal)).mean() > 0.99


def test_blocks_meet_without_seams(room, occupancy):
    _, faces = _extract(_exact(room), occupancy, 0.05)
    edges = np.sort(np.concatenate((faces[:, :2], faces[:, 1:], faces[:, ::2])), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts <= 2).all()
    open_edges = (counts == 1).sum()
    # Only the rims of what was not seen are open: a seam would cut the room across.
    assert open_edges < 0.08 * len(counts)


def test_nothing_floats_where_nothing_was_observed(room, occupancy):
    rippled = lambda points: np.sin(points.sum(axis=1) * 9.0).astype(np.float32)  # noqa: E731
    vertices, faces = _extract(rippled, occupancy, 0.05)
    assert len(faces)
    assert np.abs(room.sdf(vertices)).max() < 0.12


def test_an_empty_grid_gives_an_empty_mesh(room):
    vertices, faces = _extract(_exact(room), DepthOccupancy(OccupancyConfig()), 0.05)
    assert len(vertices) == len(faces) == 0


def test_the_mesh_is_that_of_marching_the_whole_room_at_once(room, occupancy):
    # In one volume without any blocks, faces being kept by the same rule.
    low = np.array([-5, -5, -5])
    lattice = np.stack(
        np.meshgrid(*[np.arange(a, b) for a, b in zip(low, (90, 70, 60), strict=True)], indexing="ij"), -1
    )
    values = _exact(room)(lattice.reshape(-1, 3) * 0.05 + 0.013).reshape(lattice.shape[:3])
    vertices, faces, _, _ = marching_cubes(values, 0.0, gradient_direction="descent")
    vertices = (vertices + low) * 0.05
    observed = occupancy.near_occupied(vertices, 0.49 * 0.05)
    expected = vertices[faces[observed[faces].all(axis=1)]]
    found, found_faces = _extract(lambda points: _exact(room)(points + 0.013), occupancy, 0.05)
    assert abs(len(found_faces) - len(expected)) < 0.002 * len(expected)
    distance, _ = KDTree(expected.mean(axis=1)).query(found[found_faces].mean(axis=1))
    assert distance.max() < 1e-4


def test_only_parts_that_a_new_frame_touched_are_asked_again(room):
    occupancy = DepthOccupancy(OccupancyConfig())
    extractor = MeshExtractor(occupancy)
    asked = []

    def sdf(points):
        asked.append(len(points))
        return _exact(room)(points)

    def integrate(yaw):
        observation = room.observe(2.0, 1.5, yaw, size=128)
        occupancy.integrate(observation.depth_m, observation.intrinsics, observation.T_world_camera)

    integrate(0.0)
    first = extractor.extract(sdf, _black, 0.05, reuse=True)
    assert sum(asked)
    asked.clear()
    again = extractor.extract(sdf, _black, 0.05, reuse=True)
    assert not asked
    np.testing.assert_array_equal(first.vertices_m, again.vertices_m)
    integrate(np.pi)
    both = extractor.extract(sdf, _black, 0.05, reuse=True)
    partly = sum(asked)
    asked.clear()
    fresh = extractor.extract(sdf, _black, 0.05)
    assert 0 < partly < 0.9 * sum(asked)
    assert _corners(both) == _corners(fresh)
    asked.clear()
    extractor.extract(sdf, _black, 0.1, reuse=True)
    assert sum(asked)


def test_what_is_carved_away_leaves_a_kept_mesh_too(room):
    occupancy = DepthOccupancy(OccupancyConfig())
    extractor = MeshExtractor(occupancy)

    def look(where: Room) -> Triangles:
        observation = where.observe(1.2, 1.5, 0.0, size=128)
        occupancy.integrate(observation.depth_m, observation.intrinsics, observation.T_world_camera)
        return extractor.extract(_exact(room), _black, 0.05, reuse=True)

    def on_table(triangles: Triangles) -> int:
        return int((np.abs(triangles.vertices_m - [3.0, 1.5, 0.7]) < [0.3, 0.3, 0.05]).all(axis=1).sum())

    assert on_table(look(room)) > 20
    bare = [look(Room(furniture=())) for _ in range(20)]
    assert on_table(bare[-1]) == 0


@pytest.mark.parametrize("resolution_m", [0.0, np.nan, np.inf])
def test_a_resolution_of_nothing_is_refused(room, occupancy, resolution_m):
    with pytest.raises(MapError, match=f"resolution is {resolution_m}"):
        _extract(_exact(room), occupancy, resolution_m)


def test_the_learnt_mesh_is_accurate_and_coloured(trained_map, room):
    mesh = trained_map.mesh(0.05)
    error = np.abs(room.sdf(mesh.vertices))
    assert error.mean() < 0.025
    assert (error < 0.05).mean() > 0.9
    colors = np.asarray(mesh.visual.vertex_colors)[:, :3] / 255.0
    assert np.abs(colors - room.color(mesh.vertices)).mean() < 0.1
