from dataclasses import replace

import numpy as np
import pytest
import torch

from anm_mj.errors import MapError
from anm_mj.mapping.backends.parameters import DECODER_NAMES, decoder_shapes
from anm_mj.mapping.backends.torch_backend import TorchBackend
from anm_mj.mapping.backends.torch_field import decode_color, decode_sdf
from anm_mj.mapping.mapping_config import MappingConfig
from anm_mj.mapping.rays import RayBatch, sample_frame
from tests.mapping.ray_room import Room


@pytest.fixture
def rays(room: Room) -> RayBatch:
    return sample_frame(room.observe(1.5, 1.5, 0.4), 64, np.random.default_rng(0))


def _backend(config: MappingConfig, seed: int = 0) -> TorchBackend:
    return TorchBackend(config, seed=seed, device="cpu")


def test_one_step_lowers_the_loss_on_its_own_batch(tiny_config, rays):
    backend = _backend(tiny_config)
    first = backend.step(rays, 1)
    for _ in range(20):
        last = backend.step(rays, 1)
    assert last.total < 0.5 * first.total
    assert all(np.isfinite(last))


def test_the_total_is_the_weighted_sum_of_the_terms(tiny_config, rays):
    config = replace(tiny_config, loss=replace(tiny_config.loss, smoothness=0.5, smoothness_points=4))
    losses = _backend(config).step(rays, 1, np.zeros(3))
    weights = config.loss
    expected = (
        weights.rgb * losses.rgb
        + weights.depth * losses.depth
        + weights.sdf * losses.sdf
        + weights.free_space * losses.free_space
        + weights.smoothness * losses.smoothness
    )
    assert losses.smoothness > 0.0
    assert losses.total == pytest.approx(expected, rel=1e-5)


def test_gradients_agree_with_double_precision_autograd_through_plain_indexing(tiny_config, rays):
    backend = _backend(tiny_config)
    points = torch.from_numpy(rays.origin_m + rays.direction * np.nan_to_num(rays.depth_m)[:, None])
    field = backend.field
    index, weight = field._grid.corners(points)
    features, blob = field.encode(points)
    outputs = decode_sdf(field.decoders, features, blob)
    (outputs.square().sum() + decode_color(field.decoders, blob, outputs[:, 1:]).sum()).backward()
    planes = [p.detach().double().requires_grad_() for p in field.planes]
    weights = [field.decoders[n].detach().double().requires_grad_() for n in DECODER_NAMES]
    gathered = torch.stack([(plane[index.long()] * weight.double()).sum(dim=0) for plane in planes])
    encoded = torch.cat((gathered.view(-1, len(points)).t(), blob.double()), dim=1)
    doubled = torch.relu(encoded @ weights[0].t()) @ weights[1].t()
    hidden = torch.relu(torch.cat((blob.double(), doubled[:, 1:]), dim=1) @ weights[2].t())
    (doubled.square().sum() + torch.sigmoid(hidden @ weights[3].t()).sum()).backward()
    for ours, reference in zip([*field.planes, *field.decoders.values()], [*planes, *weights], strict=True):
        difference = (ours.grad.double() - reference.grad).norm() / reference.grad.norm()
        assert float(difference) < 1e-5


def test_the_same_seed_gives_the_same_parameters_bit_for_bit(tiny_config, rays):
    states = []
    for _ in range(2):
        backend = _backend(tiny_config)
        for k in range(5):
            backend.step(rays, k)
        states.append(backend.parameters())
    for name in states[0]:
        np.testing.assert_array_equal(states[0][name], states[1][name])
    other = _backend(tiny_config, seed=1).parameters()
    assert (other["sdf_out"] != states[0]["sdf_out"]).any()


def test_state_moves_to_another_engine_and_answers_the_same(tiny_config, rays, room):
    backend = _backend(tiny_config)
    backend.step(rays, 0)
    other = _backend(tiny_config, seed=9)
    other.set_parameters(backend.parameters())
    points = np.random.default_rng(0).uniform(0.0, 2.0, (100, 3))
    np.testing.assert_array_equal(other.query_sdf(points), backend.query_sdf(points))
    np.testing.assert_array_equal(other.query_rgb(points), backend.query_rgb(points))


def test_a_state_of_another_shape_is_refused(tiny_config):
    backend = _backend(tiny_config)
    state = backend.parameters()
    state["table"] = state["table"][:10]
    with pytest.raises(MapError, match=r"'table' has shape \(10, 2\)"):
        backend.set_parameters(state)
    del state["table"]
    with pytest.raises(MapError, match="lacks 'table'"):
        backend.set_parameters(state)


def test_queries_do_not_depend_on_how_points_are_chunked(tiny_config):
    backend = _backend(tiny_config)
    points = np.random.default_rng(0).uniform(-3.0, 3.0, (9000, 3))
    whole = backend.query_sdf(points)
    parts = np.concatenate([backend.query_sdf(points[:5000]), backend.query_sdf(points[5000:])])
    np.testing.assert_allclose(whole, parts, atol=1e-6)
    assert backend.query_sdf(np.zeros((0, 3))).shape == (0,)


def test_sensitivity_is_the_squared_norm_of_the_decoders_gradient(tiny_config, rays):
    backend = _backend(tiny_config)
    for k in range(10):
        backend.step(rays, k)
    points = np.random.default_rng(0).uniform(0.0, 2.0, (5, 3)).astype(np.float32)
    s_square, rgb_square = backend.query_sensitivity(points)
    weights = list(backend.field.decoders.values())
    for i in range(len(points)):
        features, blob = backend.field.encode(torch.from_numpy(points[i : i + 1]))
        outputs = decode_sdf(backend.field.decoders, features.detach(), blob)
        color = decode_color(backend.field.decoders, blob, outputs[:, 1:])

        def square(value):
            gradients = torch.autograd.grad(value, weights, retain_graph=True, allow_unused=True)
            return sum(float(g.square().sum()) for g in gradients if g is not None)

        assert s_square[i] == pytest.approx(square(outputs[0, 0]), rel=1e-4)
        assert rgb_square[i] == pytest.approx(np.mean([square(color[0, c]) for c in range(3)]), rel=1e-4)


def test_unperturbed_weights_answer_like_the_plain_query(tiny_config):
    backend = _backend(tiny_config)
    state = backend.parameters()
    decoders = np.concatenate([state[name].ravel() for name in decoder_shapes(tiny_config.field)])[None]
    points = np.random.default_rng(0).uniform(0.0, 2.0, (20, 3))
    s, rgb = backend.query_perturbed(points, decoders)
    np.testing.assert_allclose(s[0], backend.query_sdf(points), atol=1e-6)
    np.testing.assert_allclose(rgb[0], backend.query_rgb(points), atol=1e-6)
