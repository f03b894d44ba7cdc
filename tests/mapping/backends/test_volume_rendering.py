import torch

from anm_mj.mapping.backends.torch_losses import composite, sdf_to_weight

TRUNCATION_M = 0.1


def _wall(depth_m, num_samples=200):
    z = torch.linspace(0.0, 3.0, num_samples).expand(1, -1)
    return ((depth_m - z) / TRUNCATION_M).clamp(-1.0, 1.0), z


def test_weights_sum_to_one_and_render_the_wall_where_it_is():
    s, z = _wall(1.7)
    weights = sdf_to_weight(s, z, TRUNCATION_M)
    torch.testing.assert_close(weights.sum(dim=1), torch.ones(1))
    assert abs(float((weights * z).sum()) - 1.7) < 0.01


def test_a_second_wall_does_not_shine_through_the_first():
    s, z = _wall(1.0)
    s = torch.where((z > 1.5) & (z < 2.0), torch.ones(()), s)
    weights = sdf_to_weight(s, z, TRUNCATION_M)
    assert weights[z >= 1.0 + TRUNCATION_M + 0.02].max() == 0.0


def test_a_ray_without_a_crossing_keeps_all_samples():
    s = torch.ones(2, 10)
    z = torch.linspace(0.0, 1.0, 10).expand(2, -1)
    weights = sdf_to_weight(s, z, TRUNCATION_M)
    torch.testing.assert_close(weights, torch.full((2, 10), 0.1), atol=1e-3, rtol=0.0)


def test_the_bell_is_the_product_of_two_sigmoids():
    s = torch.tensor([[0.05, -0.02]])
    weights = sdf_to_weight(s, torch.tensor([[1.0, 1.01]]), TRUNCATION_M)
    raw = torch.sigmoid(s / 0.1) * torch.sigmoid(-s / 0.1)
    torch.testing.assert_close(weights, raw / raw.sum(), atol=1e-6, rtol=1e-6)


def test_composite_is_the_weighted_sum_of_colours():
    weights = torch.tensor([[0.25, 0.75]])
    values = torch.tensor([[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    torch.testing.assert_close(composite(weights, values), torch.tensor([[0.25, 0.75, 0.0]]))
