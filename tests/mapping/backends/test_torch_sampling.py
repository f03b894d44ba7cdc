import pytest
import torch

from anm_mj.mapping.backends.torch_sampling import counter_uniform, sample_depths
from anm_mj.mapping.mapping_config import SamplingConfig

TRUNCATION_M = 0.1
CPU = torch.device("cpu")


def test_guided_samples_fill_the_free_part_and_the_band_and_end_there():
    config = SamplingConfig(free_samples=4, near_samples=8)
    depth = torch.tensor([1.0, 3.0, 7.5])
    z = sample_depths(depth, config, TRUNCATION_M, seed=1)
    assert z.shape == (3, 12)
    assert (z.diff(dim=1) > 0.0).all()
    assert ((z[:, :4] >= 0.0) & (z[:, :4] <= depth[:, None] - TRUNCATION_M)).all()
    assert ((z[:, 4:] - depth[:, None]).abs() <= TRUNCATION_M + 1e-5).all()


@pytest.mark.parametrize("scheme", ["guided", "uniform"])
@pytest.mark.parametrize("depth_m", [float("nan"), 0.0, 25.0])
def test_rays_without_a_surface_in_range_are_sampled_up_to_far(scheme, depth_m):
    config = SamplingConfig(scheme=scheme, far_m=3.0)
    z = sample_depths(torch.full((50,), depth_m), config, TRUNCATION_M, seed=1)
    assert torch.isfinite(z).all()
    assert (z >= 0.0).all()
    assert (z <= 3.0).all()
    assert z.max() > 2.5


def test_rays_without_depth_say_nothing_of_what_is_too_far_to_be_known():
    """A wall beyond the range is no free space."""
    z = sample_depths(torch.full((50,), float("nan")), SamplingConfig(max_depth_m=3.0), TRUNCATION_M, seed=1)
    assert 2.5 < z.max() <= 3.0


def test_a_surface_nearer_than_the_truncation_gives_no_sample_behind_the_camera():
    z = sample_depths(torch.tensor([0.04]), SamplingConfig(), TRUNCATION_M, seed=0)
    assert (z >= 0.0).all()
    assert (z <= 0.14 + 1e-6).all()


def test_uniform_samples_span_far_whatever_the_depth_and_are_sorted():
    config = SamplingConfig(scheme="uniform", free_samples=32, near_samples=11, far_m=4.0)
    z = sample_depths(torch.tensor([1.5]), config, TRUNCATION_M, seed=2)[0]
    assert (z.diff() >= 0.0).all()
    assert ((z - 1.5).abs() < TRUNCATION_M).sum() >= 10
    assert z.max() > 3.8


def test_jitter_depends_on_the_seed_alone():
    first = counter_uniform(5, 100, 12, CPU)
    torch.testing.assert_close(first, counter_uniform(5, 100, 12, CPU), rtol=0.0, atol=0.0)
    assert (counter_uniform(6, 100, 12, CPU) != first).any()
    # A longer batch starts with the same numbers: position decides, not the draw's history.
    torch.testing.assert_close(counter_uniform(5, 200, 12, CPU)[:100], first, rtol=0.0, atol=0.0)


def test_jitter_is_uniform_and_uncorrelated():
    u = counter_uniform(123, 1000, 100, CPU)
    assert float(u.min()) >= 0.0
    assert float(u.max()) < 1.0
    assert abs(float(u.mean()) - 0.5) < 0.005
    assert abs(float(u.var()) - 1.0 / 12.0) < 0.002
    flat = u.flatten() - 0.5
    assert abs(float((flat[1:] * flat[:-1]).mean())) < 0.002
