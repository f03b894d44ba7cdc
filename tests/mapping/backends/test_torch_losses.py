import pytest
import torch

from anm_mj.mapping.backends.torch_losses import ray_losses, smoothness_lattice, smoothness_loss
from anm_mj.mapping.mapping_config import LossConfig

TRUNCATION_M = 0.1


def _terms(s, z, depth, *, valid=True, rendered=None, config=None):
    n = len(z)
    rgb = torch.full((n, 3), 0.5)
    return ray_losses(
        s,
        z,
        rgb if rendered is None else rendered,
        depth.clone(),
        rgb,
        depth,
        torch.full((n,), valid),
        TRUNCATION_M,
        config or LossConfig(),
    )


def test_the_true_sdf_costs_nothing():
    z = torch.tensor([[0.3, 1.0, 1.95, 2.0, 2.05]])
    depth = torch.tensor([2.0])
    s = ((depth[:, None] - z) / TRUNCATION_M).clamp(max=1.0)
    terms = _terms(s, z, depth)
    assert float(terms.total) == pytest.approx(0.0, abs=1e-9)


def test_sdf_and_free_space_terms_are_means_over_all_samples_weighted_by_the_others_share():
    z = torch.tensor([[0.5, 1.0, 1.5, 2.02]])
    depth = torch.tensor([2.0])
    s = torch.zeros(1, 4)
    terms = _terms(s, z, depth)
    # Three free samples with (0 - 1)^2 and one in the band with (2.02 - 2.0)^2, over four samples.
    assert float(terms.free_space) == pytest.approx(0.25 * 3.0 / 4.0)
    assert float(terms.sdf) == pytest.approx(0.75 * 0.02**2 / 4.0, rel=1e-4)
    expected = 10.0 * float(terms.free_space) + 1000.0 * float(terms.sdf)
    assert float(terms.total) == pytest.approx(expected)


def test_samples_behind_the_band_are_not_supervised():
    depth = torch.tensor([2.0])
    z = torch.tensor([[1.0, 2.05, 3.0]])
    near = _terms(torch.tensor([[1.0, -0.5, 0.0]]), z, depth)
    far = _terms(torch.tensor([[1.0, -0.5, 9.0]]), z, depth)
    torch.testing.assert_close(near.total, far.total)


@pytest.mark.parametrize(("is_free", "pushes"), [(True, True), (False, False)])
def test_rays_without_depth_say_free_or_nothing(is_free, pushes):
    z = torch.tensor([[0.5, 1.5], [0.5, 1.95]])
    depth = torch.tensor([torch.nan, 2.0])
    s = torch.zeros(2, 2, requires_grad=True)
    rgb = torch.full((2, 3), 0.5)
    terms = ray_losses(
        s,
        z,
        rgb,
        torch.tensor([0.0, 2.0]),
        rgb,
        depth,
        torch.tensor([False, True]),
        TRUNCATION_M,
        LossConfig(no_depth_is_free=is_free),
    )
    terms.total.backward()
    assert bool((s.grad[0] < 0.0).all()) is pushes
    assert torch.isfinite(s.grad).all()


def test_colour_residual_of_rays_without_depth_is_scaled_down():
    z = torch.tensor([[1.0]])
    depth = torch.tensor([1.0])
    wrong = torch.ones(1, 3)
    s = torch.zeros(1, 1)
    seen = _terms(s, z, depth, rendered=wrong)
    unseen = _terms(s, z, depth, rendered=wrong, valid=False)
    assert float(unseen.rgb) == pytest.approx(0.05**2 * float(seen.rgb))


def test_smoothness_of_a_linear_feature_is_its_slope_squared():
    config = LossConfig(smoothness_points=5, smoothness_spacing_m=0.1)
    lattice = smoothness_lattice(torch.tensor([1.0, -2.0, 0.5]), config)
    assert lattice.shape == (125, 3)
    torch.testing.assert_close(lattice[-1], torch.tensor([1.4, -1.6, 0.9]))
    features = lattice @ torch.tensor([[1.0], [2.0], [0.0]])
    expected = (0.1**2 + 0.2**2) * 4 * 25 / 6**3
    assert float(smoothness_loss(features, config)) == pytest.approx(expected, rel=1e-4)
