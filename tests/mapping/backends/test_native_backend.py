"""The native engine against the torch engine, which is the reference."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
import torch

from anm_mj import _native
from anm_mj.errors import MapError
from anm_mj.mapping.backends.backend import MapperBackend
from anm_mj.mapping.backends.native_backend import NativeBackend, _optional, _ray_arrays
from anm_mj.mapping.backends.parameters import DECODER_NAMES
from anm_mj.mapping.backends.torch_backend import TorchBackend
from anm_mj.mapping.backends.torch_sampling import sample_depths
from anm_mj.mapping.mapping_config import MappingConfig, paper_mapping
from anm_mj.mapping.rays import RayBatch, part, sample_frame
from tests.mapping.numpy_reference import concatenate
from tests.mapping.ray_room import Room
from tests.mapping.reference import reference_gradients

CORNER_M = np.array([0.3, 0.4, 0.1])


def small(config: MappingConfig) -> MappingConfig:
    return replace(config, field=replace(config.field, log2_table_size=12))


def odd_mapping() -> MappingConfig:
    """Sizes that fill no vector."""
    config = MappingConfig()
    field = replace(config.field, num_levels=5, blob_bins=7, hidden_width=20, geometry_features=5, log2_table_size=9)
    sampling = replace(config.sampling, free_samples=2, near_samples=3)
    loss = replace(config.loss, smoothness=0.3, smoothness_points=3, no_depth_is_free=False)
    return replace(config, field=field, sampling=sampling, loss=loss)


CONFIGS = {"default": small(MappingConfig()), "paper": small(paper_mapping()), "odd": odd_mapping()}


@pytest.fixture
def config(request) -> MappingConfig:
    return CONFIGS[request.param]


all_configs = pytest.mark.parametrize("config", CONFIGS, indirect=True)
all_kernels = pytest.mark.parametrize("kernel", _native.kernel_names())


@pytest.fixture(scope="module")
def rays() -> RayBatch:
    """Some with depth, some into the sky, which the room is open to."""
    room = Room(ceiling=False)
    rng = np.random.default_rng(0)
    batch = concatenate(*(sample_frame(room.observe(1.5, 1.5, yaw), 35, rng) for yaw in (0.4, 2.0)))
    assert 0.1 < np.isnan(batch.depth_m).mean() < 0.9
    return batch


def corner(config: MappingConfig):
    return CORNER_M if config.loss.smoothness > 0.0 else None


def trained_pair(config: MappingConfig, rays: RayBatch, kernel: str = "", steps: int = 10):
    """Both engines with the same parameters, off their start values."""
    native = NativeBackend(config, seed=0, kernel=kernel)
    for seed in range(steps):
        native.step(rays, seed, corner(config))
    reference = TorchBackend(config, seed=1, device="cpu")
    reference.set_parameters(native.parameters())
    return native, reference


def relative_error(ours, theirs):
    return np.linalg.norm(ours.astype(np.float64) - theirs) / np.linalg.norm(theirs)


def test_the_name_says_the_instruction_set():
    backend = NativeBackend(CONFIGS["odd"], seed=0)
    assert backend.device == "cpu"
    assert backend.name == f"native-{_native.kernel_names()[0]}"


@all_configs
@all_kernels
def test_sample_depths_are_those_of_the_torch_engine_bit_for_bit(config, kernel, rays):
    depth = np.concatenate((rays.depth_m, np.float32([0.05, 0.1, 9.99, 10.0, 10.01, 0.0, -1.0, np.inf])))
    ours = NativeBackend(config, seed=0, kernel=kernel)._engine.sample(depth, 7)
    theirs = sample_depths(torch.from_numpy(depth), config.sampling, config.field.truncation_m, 2**40 + 7)
    np.testing.assert_array_equal(ours, theirs.numpy())


@all_configs
@all_kernels
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_losses_and_gradients_are_those_of_autograd(config, kernel, dtype, rays):
    native, reference = trained_pair(config, rays, kernel)
    z = native._engine.sample(rays.depth_m, 3)
    losses, table, decoders = native._engine.gradients(*_ray_arrays(rays), z, _optional(corner(config)))
    gradients = {"table": table, **native._split(decoders)}
    expected_losses, expected = reference_gradients(reference, rays, z, dtype, corner(config))
    np.testing.assert_allclose(losses, expected_losses, rtol=1e-5)
    for name, gradient in gradients.items():
        assert relative_error(gradient, expected[name]) < 1e-5, name


@pytest.mark.parametrize("config", ["default", pytest.param("paper", marks=pytest.mark.slow), "odd"], indirect=True)
def test_fifty_steps_lead_to_the_same_surface(config, rays):
    native = NativeBackend(config, seed=0)
    reference = TorchBackend(config, seed=0, device="cpu")
    for seed in range(50):
        ours = native.step(rays, seed, corner(config))
        theirs = reference.step(rays, seed, corner(config))
    np.testing.assert_allclose(ours, theirs, rtol=1e-3)
    hit = np.isfinite(rays.depth_m)
    points = rays.origin_m[hit] + rays.direction[hit] * rays.depth_m[hit, None]
    np.testing.assert_allclose(native.query_sdf(points), reference.query_sdf(points), atol=1e-4)


@all_configs
@all_kernels
def test_queries_answer_as_the_torch_engine_does(config, kernel, rays):
    native, reference = trained_pair(config, rays, kernel)
    rng = np.random.default_rng(0)
    points = rng.uniform(-1.0, 4.0, (333, 3))
    np.testing.assert_allclose(native.query_sdf(points), reference.query_sdf(points), atol=2e-5)
    np.testing.assert_allclose(native.query_rgb(points), reference.query_rgb(points), atol=2e-5)
    np.testing.assert_allclose(native.query_hidden(points), reference.query_hidden(points), atol=2e-5)
    for ours, theirs in zip(native.query_sensitivity(points), reference.query_sensitivity(points), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-3)
    state = native.parameters()
    weights = np.concatenate([state[name].ravel() for name in DECODER_NAMES])
    decoders = weights + 0.02 * rng.standard_normal((3, weights.size)).astype(np.float32)
    pairs = zip(native.query_perturbed(points, decoders), reference.query_perturbed(points, decoders), strict=True)
    for ours, theirs in pairs:
        np.testing.assert_allclose(ours, theirs, atol=2e-5)
    z = np.sort(rng.uniform(0.0, 4.0, (len(rays.depth_m), 9)).astype(np.float32), axis=1)
    rendered = native.render(rays.origin_m, rays.direction, z)
    for ours, theirs in zip(rendered, reference.render(rays.origin_m, rays.direction, z), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-3)


@all_configs
def test_any_number_of_threads_gives_the_same_bytes(config, rays):
    states, answers = [], []
    for num_threads in (1, 2, 5):
        backend = NativeBackend(config, seed=0, num_threads=num_threads)
        losses = [backend.step(rays, seed, corner(config)) for seed in range(8)]
        states.append(backend.parameters())
        answers.append((losses, backend.query_sdf(rays.origin_m).tolist()))
    assert answers[0] == answers[1] == answers[2]
    for state in states[1:]:
        for name, value in state.items():
            np.testing.assert_array_equal(value, states[0][name])


@all_configs
@all_kernels
def test_steps_that_overlap_give_the_same_bytes_as_one_after_another(config, kernel, rays):
    # Of several sizes, so that no step's samples lie where those of the step before did.
    batches = [part(rays, k, len(rays) - 9 * k) for k in range(7)]
    draws = [(2**32 + 5 * k, corner(config) if k % 3 else None) for k in range(7)]
    one = NativeBackend(config, seed=0, num_threads=1, kernel=kernel)
    expected = [one.step(batch, *draw) for batch, draw in zip(batches, draws, strict=True)]
    for num_threads in (1, 2, 5):
        together = NativeBackend(config, seed=0, num_threads=num_threads, kernel=kernel)
        assert together.steps(batches[:5], draws[:5]) + together.steps(batches[5:], draws[5:]) == expected
        assert together.steps([], []) == []
        for name, value in together.get_state().items():
            np.testing.assert_array_equal(value, one.get_state()[name])


def test_nothing_is_trained_after_a_loss_that_is_not_finite(rays):
    config = CONFIGS["default"]
    spoilt = replace(rays, rgb=np.full_like(rays.rgb, np.nan))
    batches, draws = [rays, spoilt, rays], [(k, None) for k in range(3)]
    for steps in (NativeBackend.steps, MapperBackend.steps):
        backend, reference = (NativeBackend(config, seed=0) for _ in range(2))
        losses = steps(backend, batches, draws)
        assert [math.isfinite(each.total) for each in losses] == [True, False]
        for batch, draw in zip(batches[:2], draws, strict=False):
            reference.step(batch, *draw)
        for name, value in backend.parameters().items():
            np.testing.assert_array_equal(value, reference.parameters()[name])


def test_checkpoints_move_both_ways(rays):
    config = CONFIGS["default"]
    native, reference = trained_pair(config, rays)
    state = reference.parameters()
    back = NativeBackend(config, seed=5)
    back.set_parameters(state)
    for name, value in native.parameters().items():
        np.testing.assert_array_equal(value, state[name])
        np.testing.assert_array_equal(value, back.parameters()[name])
    # The optimiser starts afresh on both sides, so the next steps agree too.
    ours, theirs = back.step(rays, 1), reference.step(rays, 1)
    np.testing.assert_allclose(ours, theirs, rtol=1e-5)
    assert back.step(rays, 1) != native.step(rays, 1)


def test_start_values_are_those_of_the_torch_engine():
    ours = NativeBackend(CONFIGS["default"], seed=3).parameters()
    for name, value in TorchBackend(CONFIGS["default"], seed=3, device="cpu").parameters().items():
        np.testing.assert_array_equal(ours[name], value)


def test_a_state_of_another_shape_is_refused():
    with pytest.raises(MapError, match="lacks 'table'"):
        NativeBackend(CONFIGS["default"], seed=0).set_parameters({})


def test_a_layer_beyond_the_engines_buffers_is_refused():
    config = CONFIGS["default"]
    with pytest.raises(MapError, match="2000 are configured"):
        NativeBackend(replace(config, field=replace(config.field, hidden_width=2000)), seed=0)


@all_kernels
@pytest.mark.parametrize("num_bins", [7, 16])
def test_places_far_off_or_unknown_have_a_bin(num_bins, kernel):
    config = CONFIGS["odd"]
    config = replace(config, field=replace(config.field, blob_bins=num_bins, blob_period_m=(0.01, 0.01, 0.01)))
    backend = NativeBackend(config, seed=0, num_threads=1, kernel=kernel)
    near = backend.query_sdf(np.random.default_rng(0).uniform(-1.0, 1.0, (64, 3)))
    far = np.geomspace(1.0, 1e15, 999)[:, None] * np.random.default_rng(1).choice([-1.0, 1.0], (999, 3))
    # Every answer is made of the weights of bins that exist, so that it is as large as any other.
    assert np.abs(backend.query_sdf(far)).max() < 20.0 * np.abs(near).max()
    backend.query_sdf(np.full((64, 3), np.nan))
    backend.query_sdf(np.full((64, 3), np.inf))


@pytest.mark.parametrize("samples", [(-1000, 1006), (0, 4), (-5, 4), (1000, 1000)])
def test_rays_of_no_or_too_many_samples_are_refused(samples):
    config = CONFIGS["default"]
    for name, value in zip(("free_samples", "near_samples"), samples, strict=True):
        # As a damaged checkpoint brings it, past the checks of settings.
        sampling = object.__new__(type(config.sampling))
        for field in fields(config.sampling):
            object.__setattr__(sampling, field.name, getattr(config.sampling, field.name))
        object.__setattr__(sampling, name, value)
        config = replace(config, sampling=sampling)
    with pytest.raises((ValueError, MapError)):
        NativeBackend(config, seed=0)


def test_empty_queries_have_empty_answers():
    backend = NativeBackend(CONFIGS["default"], seed=0)
    assert backend.query_sdf(np.zeros((0, 3))).shape == (0,)
    assert backend.query_rgb(np.zeros((0, 3))).shape == (0, 3)


def test_large_queries_do_not_depend_on_how_points_are_chunked():
    backend = NativeBackend(CONFIGS["default"], seed=0)
    points = np.random.default_rng(0).uniform(-3.0, 3.0, (70_001, 3))
    whole = backend.query_sdf(points)
    parts = np.concatenate([backend.query_sdf(points[:5001]), backend.query_sdf(points[5001:])])
    np.testing.assert_array_equal(whole, parts)


def test_the_roofline_measures_what_it_names():
    limits = _native.roofline(1 << 19, "")
    assert limits.keys() == {"fma_gflops", "load_ns", "update_ns", "stream_gb_per_s"}
    assert all(0.0 < limit < np.inf for limit in limits.values())
