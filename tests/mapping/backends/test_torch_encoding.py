from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from anm_mj.mapping.backends.parameters import cell_sizes_m, doubled_table, index_factors
from anm_mj.mapping.backends.torch_encoding import HashGrid, _Interpolate, gather_corners, one_blob
from anm_mj.mapping.mapping_config import FieldConfig

CPU = torch.device("cpu")
SMALL = FieldConfig(num_levels=4, log2_table_size=10, finest_cell_m=0.05, coarsest_cell_m=0.6)


def test_cells_shrink_geometrically_from_coarsest_to_finest():
    sizes = cell_sizes_m(FieldConfig())
    np.testing.assert_allclose(sizes[[0, -1]], [0.6, 0.01])
    np.testing.assert_allclose(sizes[1:] / sizes[:-1], sizes[1] / sizes[0])


@given(st.lists(st.floats(-50.0, 50.0), min_size=3, max_size=3))
@settings(max_examples=50, deadline=None)
def test_indices_stay_in_their_level_and_weights_sum_to_one_anywhere_in_the_world(point):
    index, weight = HashGrid(SMALL, CPU).corners(torch.tensor([point], dtype=torch.float32))
    level = index.view(8, 4) // (1 << SMALL.log2_table_size)
    assert (level == torch.arange(4)).all()
    torch.testing.assert_close(weight.view(8, 4).sum(dim=0), torch.ones(4))
    assert (weight >= 0.0).all()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_features_are_continuous_across_the_origin(axis):
    # Truncation instead of floor would fold negative cells onto positive ones.
    grid = HashGrid(SMALL, CPU)
    planes = [torch.randn(grid.num_entries) for _ in range(2)]
    points = torch.full((2, 3), 0.123)
    points[0, axis], points[1, axis] = -1e-5, 1e-5
    below, above = grid.features(points, *planes)
    torch.testing.assert_close(below, above, atol=1e-2, rtol=0.0)
    points[0, axis] = -0.03
    assert (grid.features(points, *planes)[0] - above).abs().max() > 0.05


def test_negative_cells_get_entries_of_their_own_on_collision_free_levels():
    config = FieldConfig()
    factors, masks = index_factors(config)
    cells = np.stack(np.meshgrid(np.arange(-20, 20), np.arange(-20, 20), np.arange(-4, 8)), axis=-1).reshape(-1, 3)
    index = np.bitwise_xor.reduce((cells * factors[:, 0]) & masks[:, 0], axis=1)
    assert len(np.unique(index)) == len(cells)


def test_hashed_levels_use_the_whole_table_evenly():
    factors, masks = index_factors(SMALL)
    cells = np.random.default_rng(0).integers(-200, 200, (20000, 3))
    index = np.bitwise_xor.reduce((cells * factors[:, -1]) & masks[:, -1], axis=1)
    counts = np.bincount(index, minlength=1 << SMALL.log2_table_size)
    assert counts.std() < 2.0 * np.sqrt(counts.mean())


def test_the_index_is_the_one_the_formula_gives_for_each_corner():
    grid = HashGrid(SMALL, CPU)
    point = np.array([-1.234, 0.567, 2.13], np.float32)
    factors, masks = index_factors(SMALL)
    index, _ = grid.corners(torch.from_numpy(point[None]))
    entries = 1 << SMALL.log2_table_size
    for level, size in enumerate(cell_sizes_m(SMALL)):
        cell = np.floor(point.astype(float) / size).astype(int)
        expected = {
            level * entries + np.bitwise_xor.reduce(((cell + offset) * factors[:, level]) & masks[:, level])
            for offset in np.ndindex(2, 2, 2)
        }
        assert set(index.view(8, 4)[:, level].tolist()) == expected


def test_gradient_of_the_interpolation_matches_autograd_in_double_precision():
    grid = HashGrid(SMALL, CPU)
    points = torch.rand(50, 3, dtype=torch.float64) * 4.0 - 2.0
    index, weight = grid.corners(points)
    upstream = torch.randn(2, index.shape[1], dtype=torch.float64)
    gradients = []
    for function in (_Interpolate.apply, gather_corners):
        planes = [
            p.requires_grad_() for p in torch.randn(2, grid.num_entries, generator=_seeded(), dtype=torch.float64)
        ]
        function(index, weight, *planes).backward(upstream)
        gradients.append(torch.stack([p.grad for p in planes]))
    torch.testing.assert_close(gradients[0], gradients[1], rtol=1e-12, atol=1e-12)


def _seeded():
    return torch.Generator().manual_seed(3)


def test_one_blob_is_a_bump_of_three_bins_that_sums_to_one_per_axis():
    period = torch.tensor([16.0, 16.0, 4.0])
    code = one_blob(torch.randn(100, 3) * 20.0, period, 16).view(100, 3, 16)
    torch.testing.assert_close(code.sum(dim=-1), torch.ones(100, 3))
    assert ((code > 0.0).sum(dim=-1) <= 3).all()
    centred = one_blob(torch.tensor([[2.5, 2.5, 0.625]]), period, 16).view(3, 16)
    assert (centred.argmax(dim=-1) == 2).all()
    torch.testing.assert_close(centred[:, 1], centred[:, 3])


def test_one_blob_repeats_after_a_period_and_is_continuous_there():
    period = torch.tensor([16.0, 16.0, 4.0])
    points = torch.rand(20, 3)
    torch.testing.assert_close(one_blob(points, period, 16), one_blob(points + period, period, 16), atol=1e-4, rtol=0.0)
    seam = one_blob(torch.tensor([[-1e-4] * 3, [1e-4] * 3]), period, 16)
    torch.testing.assert_close(seam[0], seam[1], atol=2e-3, rtol=0.0)


@pytest.mark.parametrize("bits", [8, 11, 14])
def test_a_doubled_table_gives_every_point_in_the_world_the_features_it_had(bits):
    # Three doublings, so that each axis of the levels indexed by position gets a bit more.
    config = FieldConfig(num_levels=6, log2_table_size=bits)
    table = np.random.default_rng(0).standard_normal((6 << bits, 2)).astype(np.float32)
    points = torch.rand(500, 3, generator=_seeded()) * 80.0 - 40.0
    before = _features(config, table, points)
    for _ in range(3):
        table = doubled_table(table, config)
        config = replace(config, log2_table_size=config.log2_table_size + 1)
        assert table.shape == (6 << config.log2_table_size, 2)
    torch.testing.assert_close(_features(config, table, points), before, rtol=0.0, atol=0.0)


def test_doubling_sets_apart_places_that_shared_an_entry():
    config = FieldConfig(num_levels=1, coarsest_cell_m=0.02, log2_table_size=8)
    cells = np.random.default_rng(0).integers(-500, 500, (1000, 3))

    def num_distinct(config):
        factors, masks = index_factors(config)
        return len(np.unique(np.bitwise_xor.reduce((cells * factors[:, 0]) & masks[:, 0], axis=1)))

    assert num_distinct(config) <= 256
    assert num_distinct(replace(config, log2_table_size=9)) > 1.5 * num_distinct(config)


def _features(config, table, points):
    return HashGrid(config, CPU).features(points, *(torch.from_numpy(plane.copy()) for plane in table.T))
