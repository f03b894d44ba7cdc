import numpy as np

from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.lattice import crossings
from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.mapping.surface import SurfaceExtractor, gradient_directions
from anm_mj.types import OCCUPIED

CENTRE = np.array([2.0, 1.5])


def _sphere(points):
    return (np.linalg.norm(points, axis=1) - 0.73).astype(np.float32)


def _crossings_of_the_sphere():
    return crossings(_sphere, np.ones((20, 20, 20), bool), np.array([-10, -10, -10]), 0.1)


def test_crossings_of_a_sphere_lie_on_it_and_look_outwards():
    points = _crossings_of_the_sphere()
    assert len(points) > 500
    assert np.abs(np.linalg.norm(points, axis=1) - 0.73).max() < 0.002
    assert (gradient_directions(_sphere, points) * points).sum(axis=1).min() > 0.7


def test_each_edge_is_crossed_once():
    points = _crossings_of_the_sphere()
    assert len(np.unique(np.round(points, 6), axis=0)) == len(points)


def test_only_edges_of_the_given_cells_are_crossed():
    cells = np.zeros((20, 20, 20), bool)
    cells[17, 10, 10] = True
    points = crossings(_sphere, cells, np.array([-10, -10, -10]), 0.1)
    assert len(points)
    assert ((points >= [0.7, 0.0, 0.0]) & (points <= [0.8, 0.1, 0.1])).all()


def test_no_cells_give_no_points():
    points = crossings(_sphere, np.zeros((0, 0, 0), bool), np.zeros(3, np.int64), 0.1)
    assert points.shape == gradient_directions(_sphere, points).shape == (0, 3)


def test_a_flat_field_still_gives_unit_normals():
    normals = gradient_directions(lambda p: np.zeros(len(p), np.float32), np.zeros((2, 3)))
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)


def test_surface_points_lie_on_walls_and_normals_look_into_the_room(trained_map, room):
    surface = trained_map.surface(CENTRE, 10.0)
    points = surface.xyz_m.astype(float)
    assert len(points) > 1000
    error = np.abs(room.sdf(points))
    assert error.mean() < 0.03
    assert (error < 0.05).mean() > 0.9
    inward = room.sdf(points + 0.05 * surface.normal) - room.sdf(points - 0.05 * surface.normal)
    assert (inward > 0.0).mean() > 0.95
    np.testing.assert_allclose(np.linalg.norm(surface.normal, axis=1), 1.0, rtol=1e-5)
    assert surface.uncertainty.shape == (len(points),)


def test_surface_points_stay_within_the_radius(trained_map):
    points = trained_map.surface(np.array([0.5, 0.5]), 1.0).xyz_m
    assert len(points) > 50
    assert np.hypot(*(points[:, :2] - 0.5).T).max() <= 1.0
    assert len(trained_map.surface(np.array([50.0, 0.5]), 1.0).xyz_m) == 0


def test_only_blocks_that_a_new_frame_touched_are_asked_again(room):
    occupancy = DepthOccupancy(OccupancyConfig())
    extractor = SurfaceExtractor(occupancy, 0.1)
    asked = []

    def sdf(points):
        asked.append(len(points))
        return room.sdf(points).astype(np.float32)

    def integrate(yaw):
        observation = room.observe(2.0, 1.5, yaw, size=128)
        occupancy.integrate(observation.depth_m, observation.intrinsics, observation.T_world_camera)

    integrate(0.0)
    first, _ = extractor.extract(sdf, CENTRE, 10.0)
    full = sum(asked)
    asked.clear()
    again, _ = extractor.extract(sdf, CENTRE, 10.0)
    assert not asked
    np.testing.assert_array_equal(first, again)
    integrate(np.pi)
    both, _ = extractor.extract(sdf, CENTRE, 10.0)
    assert len(both) > 1.5 * len(first)
    assert 0 < sum(asked) < 1.5 * full
    fresh, _ = SurfaceExtractor(occupancy, 0.1).extract(sdf, CENTRE, 10.0)
    assert {tuple(p) for p in fresh} == {tuple(p) for p in both}


def test_points_up_to_a_height_are_those_of_all_and_cost_less(room):
    occupancy = DepthOccupancy(OccupancyConfig())
    observation = room.observe(2.0, 1.5, 0.0, size=128)
    occupancy.integrate(observation.depth_m, observation.intrinsics, observation.T_world_camera)
    asked = []

    def sdf(points):
        asked.append(len(points))
        return room.sdf(points).astype(np.float32)

    every, normals = SurfaceExtractor(occupancy, 0.1).extract(sdf, CENTRE, 10.0)
    full, low = sum(asked), every[:, 2] <= 1.0
    assert 0 < np.count_nonzero(low) < len(every)
    asked.clear()
    extractor = SurfaceExtractor(occupancy, 0.1)
    found = extractor.extract(sdf, CENTRE, 10.0, 1.0)
    np.testing.assert_array_equal(found[0], every[low])
    np.testing.assert_array_equal(found[1], normals[low])
    assert sum(asked) == full - 4 * np.count_nonzero(~low)
    assert set(map(tuple, extractor.places(sdf, CENTRE, 10.0))) == set(map(tuple, every))
    again = extractor.extract(sdf, CENTRE, 10.0)
    np.testing.assert_array_equal(again[1], normals)


def test_a_sign_change_where_nothing_was_observed_is_no_surface(room):
    occupancy = DepthOccupancy(OccupancyConfig())
    observation = room.observe(2.0, 1.5, 0.0, size=128)
    occupancy.integrate(observation.depth_m, observation.intrinsics, observation.T_world_camera)

    def rippled(points):
        return np.sin(points.sum(axis=1) * 9.0).astype(np.float32)

    points, _ = SurfaceExtractor(occupancy, 0.1).extract(rippled, CENTRE, 10.0)
    grid = occupancy.grid
    centres = grid.origin_m + (np.argwhere(grid.state == OCCUPIED)[:, ::-1] + 0.5) * 0.05
    nearest = np.array([np.abs(centres - p).max(axis=1).min() for p in points[:300]])
    assert nearest.max() <= 0.0501
