from dataclasses import replace

import numpy as np
import pytest
import torch

from anm_mj.errors import MapError
from anm_mj.mapping.backends.mlp_backend import MlpBackend
from anm_mj.mapping.mapping_config import MappingConfig, UncertaintyConfig, anm_mapping
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.mapping.rays import RayBatch, sample_frame
from tests.mapping.ray_room import Room


@pytest.fixture
def config() -> MappingConfig:
    anm = anm_mapping()
    return replace(anm, schedule=replace(anm.schedule, first_iterations=2, iterations=8, keyframe_every=1))


@pytest.fixture
def rays(room: Room) -> RayBatch:
    return sample_frame(room.observe(1.5, 1.5, 0.4), 64, np.random.default_rng(0))


@pytest.mark.slow
def test_one_turn_in_a_room_teaches_its_distances(config, room):
    config = replace(config, schedule=replace(config.schedule, first_iterations=40))
    learnt = NeuralMap(config, seed=0, device="cpu")
    for observation in room.turn(1.5, 1.5, 10):
        learnt.integrate(observation)

    points = room.observe(1.5, 1.5, 0.4)
    hits = np.argwhere(np.isfinite(points.depth_m))[::7]
    rays = sample_frame(points, len(hits), np.random.default_rng(0))
    surface = rays.origin_m + rays.depth_m[:, None] * rays.direction
    before = rays.origin_m + (rays.depth_m - 0.08)[:, None] * rays.direction
    s = learnt.backend.query_sdf(surface) * config.field.truncation_m
    assert np.abs(s).mean() < 0.09
    assert (learnt.sdf(before) > learnt.sdf(surface)).mean() > 0.85
    found = learnt.surface(np.array([1.5, 1.5]), 5.0)
    assert np.abs(room.sdf(found.xyz_m.astype(float))).mean() < 0.12
    assert (found.uncertainty > 0.0).all()


def test_the_same_seed_trains_the_same_network(config, rays):
    states = []
    for _ in range(2):
        backend = MlpBackend(config, seed=3, device="cpu")
        for k in range(3):
            backend.step(rays, k)
        states.append(backend.parameters())

    assert all(np.array_equal(states[0][name], states[1][name]) for name in states[0])


def test_the_sensitivity_is_the_norm_of_the_gradient_by_all_weights(config, rays):
    backend = MlpBackend(config, seed=0, device="cpu")
    points = rays.origin_m[:4] + rays.depth_m[:4, None] * rays.direction[:4]

    s_square, rgb_square = backend.query_sensitivity(points)

    for k in range(4):
        s = backend._s(torch.from_numpy(points[k : k + 1]), backend._weights)
        gradients = torch.autograd.grad(s.sum(), backend._weights)
        assert s_square[k] == pytest.approx(sum(float(g.square().sum()) for g in gradients), rel=1e-4)
    assert not rgb_square.any()


def test_weights_without_noise_answer_as_the_network_does(config, rays):
    backend = MlpBackend(config, seed=0, device="cpu")
    points = rays.origin_m + rays.depth_m[:, None] * rays.direction
    weights = np.concatenate([values.ravel() for values in backend.parameters().values()])

    s, _ = backend.query_perturbed(points, weights[None])

    np.testing.assert_array_equal(s[0], backend.query_sdf(points))


def test_a_saved_network_answers_as_before(config, room, tmp_path):
    learnt = NeuralMap(config, seed=0, device="cpu")
    learnt.integrate(room.observe(1.5, 1.5, 0.4))
    learnt.save(tmp_path / "map.safetensors")

    loaded = NeuralMap.load(tmp_path / "map.safetensors", device="cpu")

    points = np.random.default_rng(0).random((50, 3)) * 2
    np.testing.assert_array_equal(loaded.sdf(points), learnt.sdf(points))


def test_a_network_without_a_table_stays_as_it_is_however_large_the_scene(config, room):
    field = replace(config.field, largest_log2_table_size=config.field.log2_table_size + 1)
    learnt = NeuralMap(replace(config, field=field), seed=0, device="cpu")
    learnt.integrate(room.observe(1.5, 1.5, 0.4))
    before = learnt.field.backend.parameters()
    learnt.field.fit_table(1e9)
    after = learnt.field.backend.parameters()
    assert all(np.array_equal(before[name], after[name]) for name in before)


def test_evidence_is_refused_because_it_needs_the_decoders():
    with pytest.raises(MapError, match=r"uncertainty\.method is 'last_layer_variance'; engine mlp has no"):
        MappingConfig(engine="mlp", uncertainty=UncertaintyConfig("last_layer_variance"))


def test_a_batch_without_any_depth_teaches_nothing(config, rays):
    backend = MlpBackend(config, seed=0, device="cpu")
    before = backend.parameters()

    losses = backend.step(replace(rays, depth_m=np.full_like(rays.depth_m, np.nan)), 0)

    assert losses.total == 0.0
    assert all(np.array_equal(value, before[name]) for name, value in backend.parameters().items())
