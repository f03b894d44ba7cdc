import math

import numpy as np
import pytest

from anm_mj.mapping.depth_occupancy import DepthOccupancy
from anm_mj.mapping.mapping_config import OccupancyConfig
from anm_mj.mapping.view import view_samples
from anm_mj.types import OCCUPIED, Intrinsics

SURFACE_X_M = 3.0


@pytest.fixture
def view(room):
    """Looks along +x from x = 1."""
    return room.observe(1.0, 1.5, 0.0, size=16)


@pytest.fixture
def all_occupied(view) -> DepthOccupancy:
    grid = DepthOccupancy(OccupancyConfig())
    grid.integrate(view.depth_m, view.intrinsics, view.T_world_camera)
    grid.set_arrays({**grid.arrays(), "state": np.full_like(grid.grid.state, OCCUPIED)})
    return grid


def plane(points):
    return (SURFACE_X_M - points[:, 0]).astype(np.float32)


def test_a_ray_through_occupied_voxels_goes_on_to_where_the_field_turns_solid(all_occupied, view):
    _, _, z, hit = view_samples(all_occupied, plane, view.intrinsics, view.T_world_camera, 0.1)
    assert hit.sum() > 100
    centre = z[np.abs(z.mean(axis=1) - (SURFACE_X_M - 1.0)) < 0.05]
    assert len(centre) > 100
    np.testing.assert_allclose(centre.mean(axis=1), SURFACE_X_M - 1.0, atol=0.01)


def test_a_ray_whose_field_has_no_surface_ends_at_the_first_voxel(all_occupied, view):
    def free(points):
        return np.ones(len(points), np.float32)

    _, _, z, hit = view_samples(all_occupied, free, view.intrinsics, view.T_world_camera, 0.1)
    assert hit.all()
    assert z.max() < 0.5


def test_a_ray_that_leaves_a_solid_behind_it_meets_no_surface_there(all_occupied, view):
    def inverted(points):
        return -plane(points)

    _, _, z, _ = view_samples(all_occupied, inverted, view.intrinsics, view.T_world_camera, 0.1)
    assert z.max() < 0.5


@pytest.mark.parametrize("back_m", [5.0, 15.0, 40.0])
def test_the_map_is_seen_from_however_far(all_occupied, view, back_m):
    T_world_camera = view.T_world_camera.copy()
    T_world_camera[0, 3] -= back_m
    looking = Intrinsics.from_fov(8, 8, math.radians(1.0))
    _, _, z, hit = view_samples(all_occupied, plane, looking, T_world_camera, 0.1)
    assert hit.all()
    np.testing.assert_allclose(z.mean(axis=1), SURFACE_X_M - 1.0 + back_m, atol=0.02)
    assert not view_samples(all_occupied, plane, looking, T_world_camera, 0.1, 0.5 * back_m)[3].any()


def test_the_way_to_a_map_far_off_costs_nothing(all_occupied, view, monkeypatch):
    T_world_camera = view.T_world_camera.copy()
    T_world_camera[0, 3] -= 5e5
    looked, state_at = [], all_occupied.state_at
    monkeypatch.setattr(all_occupied, "state_at", lambda points: looked.append(len(points)) or state_at(points))
    looking = Intrinsics(1, 1, 1e6, 1e6, 0.5, 0.5)
    _, _, z, hit = view_samples(all_occupied, plane, looking, T_world_camera, 0.1)
    assert hit.all()
    np.testing.assert_allclose(z.mean(axis=1), 5e5 + SURFACE_X_M - 1.0, atol=0.1)
    assert len(looked) < 500


def test_an_empty_map_shows_nothing(view):
    grid = DepthOccupancy(OccupancyConfig())
    assert not view_samples(grid, plane, view.intrinsics, view.T_world_camera, 0.1)[3].any()
