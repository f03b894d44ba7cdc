"""Normal equations of a frame: the native engine against autograd through the torch engine."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from anm_mj import _native
from anm_mj.errors import MapError
from anm_mj.mapping.alignment import AlignSettings, FramePoints
from anm_mj.mapping.backends.native_backend import NativeBackend
from anm_mj.mapping.backends.torch_backend import TorchBackend
from anm_mj.mapping.backends.torch_encoding import one_blob
from anm_mj.mapping.backends.torch_field import TorchField, decode_color, decode_sdf
from anm_mj.mapping.mapping_config import MappingConfig

NUM_POINTS = 210
SETTINGS = AlignSettings(3.0, 0.01, 0.1, 2.0, saturation=50.0, least_slope=0.01, most_slope=1e3)


def small(config: MappingConfig) -> MappingConfig:
    return replace(config, field=replace(config.field, log2_table_size=12))


def odd() -> MappingConfig:
    """Sizes that fill no vector."""
    config = MappingConfig()
    field = replace(config.field, num_levels=5, blob_bins=7, hidden_width=20, geometry_features=5, log2_table_size=9)
    return replace(config, field=field)


@pytest.fixture(scope="module")
def points() -> FramePoints:
    rng = np.random.default_rng(0)
    trust = np.ones(NUM_POINTS, np.float32)
    trust[::7] = 0.0
    return FramePoints(
        rng.uniform(-2.0, 2.0, (NUM_POINTS, 3)).astype(np.float32),
        rng.random((NUM_POINTS, 3)).astype(np.float32),
        rng.uniform(0.0, 1e-3, NUM_POINTS).astype(np.float32),
        trust,
    )


@pytest.fixture(scope="module")
def T_world_camera() -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    T[:3, 3] = 1.0, 2.0, 0.5
    return T


def engines(config: MappingConfig, kernel: str, threads: int = 1) -> tuple[NativeBackend, TorchBackend]:
    """Both with the same parameters, large enough for steep gradients."""
    native = NativeBackend(config, seed=0, num_threads=threads, kernel=kernel)
    reference = TorchBackend(config, seed=0, device="cpu")
    rng = np.random.default_rng(1)
    state = {
        name: (value + rng.normal(0.0, 0.3, value.shape)).astype(np.float32)
        for name, value in native.parameters().items()
    }
    native.set_parameters(state)
    reference.set_parameters(state)
    return native, reference


def features_of(field: TorchField, points_m: Tensor) -> Tensor:
    """Grid features, differentiable in the points, which the engine's own are not."""
    grid = field._grid
    with torch.no_grad():
        index, _ = grid.corners(points_m)
    scaled = points_m.t()[:, None, :] * grid._cells_per_m
    high = scaled - scaled.detach().floor()
    sides = 1.0 - high, high
    weight = torch.stack([sides[x][0] * sides[y][1] * sides[z][2] for z in (0, 1) for y in (0, 1) for x in (0, 1)])
    weight = weight.reshape(8, -1)
    values = [(plane.detach()[index.long()] * weight).sum(0).view(grid.num_levels, -1) for plane in field.planes]
    return torch.cat(values).t()


def field_with_gradients(reference: TorchBackend, points_m: np.ndarray) -> tuple[np.ndarray, ...]:
    """s, its gradient, colours and theirs [channel][axis], at world points."""
    field = reference.field
    points = torch.from_numpy(points_m.astype(np.float32)).requires_grad_()
    blob = one_blob(points, field._period_m, field.config.blob_bins)
    outputs = decode_sdf(field.decoders, features_of(field, points), blob)
    rgb = decode_color(field.decoders, blob, outputs[:, 1:])

    def gradient(values: Tensor) -> np.ndarray:
        return torch.autograd.grad(values.sum(), points, retain_graph=True)[0].numpy().astype(np.float64)

    grad_rgb = np.stack([gradient(rgb[:, channel]) for channel in range(3)], axis=1)
    s, rgb_value = (values.detach().numpy().astype(np.float64) for values in (outputs[:, 0], rgb))
    return s, gradient(outputs[:, 0]), rgb_value, grad_rgb


def reference_equations(
    reference: TorchBackend, points: FramePoints, T: np.ndarray, settings: AlignSettings
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    arm = points.camera_m @ T[:3, :3].T
    s, grad_s, rgb, grad_rgb = field_with_gradients(reference, arm + T[:3, 3])
    truncation = reference.config.field.truncation_m
    slope = truncation * np.linalg.norm(grad_s, axis=1)
    normal = truncation * grad_s / slope[:, None]
    distance = truncation * s / slope
    incidence = (normal * arm / np.linalg.norm(arm, axis=1, keepdims=True)).sum(axis=1)
    spread = points.variance_m2 * incidence**2 + settings.field_deviation_m**2
    square = distance**2 / spread
    share = settings.kernel**2 / (settings.kernel**2 + square)
    valid = points.trust * (np.abs(s) < settings.saturation)
    valid *= (slope > settings.least_slope) & (slope < settings.most_slope)
    jacobian = np.concatenate((normal, np.cross(arm, normal)), axis=1)
    weight = valid * share**2 / spread
    difference = rgb - points.rgb
    tangent = grad_rgb - (grad_rgb * normal[:, None]).sum(axis=2, keepdims=True) * normal[:, None]
    total = (difference**2).sum(axis=1) / settings.color_deviation**2
    color_share = settings.color_kernel**2 / (settings.color_kernel**2 + total)
    color_weight = valid * share**2 * color_share**2 / settings.color_deviation**2
    color_jacobian = np.concatenate((tangent, np.cross(arm[:, None], tangent)), axis=2)
    hessian = np.stack(
        (
            np.einsum("ni,n,nj->ij", jacobian, weight, jacobian),
            np.einsum("nci,n,ncj->ij", color_jacobian, color_weight, color_jacobian),
        )
    )
    gradient = np.stack(
        (
            np.einsum("ni,n->i", jacobian, weight * distance),
            np.einsum("nci,n,nc->i", color_jacobian, color_weight, difference),
        )
    )
    facts = np.array(
        [
            [(valid * share * square).sum(), (valid * share**2).sum(), np.count_nonzero(valid)],
            [
                (valid * share**2 * color_share * total).sum(),
                (valid * share**2 * color_share**2).sum(),
                np.count_nonzero(valid),
            ],
        ]
    )
    return hessian, gradient, facts


@pytest.mark.parametrize("kernel", _native.kernel_names())
@pytest.mark.parametrize("config", [small(MappingConfig()), odd()], ids=["default", "odd"])
def test_normal_equations_are_those_of_autograd(
    config: MappingConfig, kernel: str, points: FramePoints, T_world_camera: np.ndarray
) -> None:
    native, reference = engines(config, kernel)
    found = native.align(points, T_world_camera, SETTINGS)
    hessian, gradient, facts = reference_equations(reference, points, T_world_camera, SETTINGS)
    for kind in range(2):
        np.testing.assert_allclose(found.hessian[kind], hessian[kind], atol=2e-4 * np.abs(hessian[kind]).max())
        np.testing.assert_allclose(found.gradient[kind], gradient[kind], atol=1e-3 * np.abs(gradient[kind]).max())
    np.testing.assert_allclose(found.facts, facts, rtol=1e-3)


def test_threads_change_no_byte(points: FramePoints, T_world_camera: np.ndarray) -> None:
    config = small(MappingConfig())
    one, three = (engines(config, "", threads)[0].align(points, T_world_camera, SETTINGS) for threads in (1, 3))
    for first, second in zip(one, three, strict=True):
        np.testing.assert_array_equal(first, second)


def test_points_without_trust_do_not_count(points: FramePoints, T_world_camera: np.ndarray) -> None:
    native, _ = engines(small(MappingConfig()), "")
    kept = points.trust > 0.0
    some = FramePoints(points.camera_m[kept], points.rgb[kept], points.variance_m2[kept], points.trust[kept])
    all_points, fewer = (native.align(given, T_world_camera, SETTINGS) for given in (points, some))
    np.testing.assert_allclose(all_points.hessian, fewer.hessian, rtol=1e-4, atol=1e-2)
    np.testing.assert_array_equal(all_points.facts[:, 2], fewer.facts[:, 2])


def test_without_colour_the_distances_stay(points: FramePoints, T_world_camera: np.ndarray) -> None:
    native, _ = engines(small(MappingConfig()), "")
    with_color = native.align(points, T_world_camera, SETTINGS)
    without = native.align(points, T_world_camera, SETTINGS._replace(color_deviation=0.0))
    np.testing.assert_allclose(with_color.hessian[0], without.hessian[0], rtol=1e-3, atol=0.1)
    assert not without.hessian[1].any()


def test_other_engines_say_that_they_cannot(points: FramePoints, T_world_camera: np.ndarray) -> None:
    _, reference = engines(small(MappingConfig()), "")
    with pytest.raises(MapError, match="native"):
        reference.align(points, T_world_camera, SETTINGS)
