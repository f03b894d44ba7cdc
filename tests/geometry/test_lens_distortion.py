"""Lens distortion: the models against values worked out by hand, and images that come out straight."""

import math

import numpy as np
import pytest
from scipy import sparse
from scipy.optimize import least_squares

from anm_mj.geometry.lens_distortion import LensDistortion, undistortion
from anm_mj.types import Intrinsics

CAMERA = Intrinsics(96, 72, 78.0, 77.5, 47.8, 38.3)
FREIBURG1 = (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)
MODELS = [
    ("plumb_bob", FREIBURG1),
    ("plumb_bob", (-0.28, 0.07, 0.0002, 0.00002)),
    ("rational_polynomial", (0.8, -0.4, 0.0007, -0.0002, 0.1, 1.1, -0.3, 0.02)),
    ("thin_prism", (0.1, -0.05, 0.0007, -0.0002, 0.0, 0.0, 0.0, 0.0, 0.01, -0.002, -0.005, 0.003)),
    ("equidistant", (-0.02, 0.01, -0.004, 0.001)),
]


def lens_of(model, coefficients):
    lens = LensDistortion.of(model, coefficients)
    assert lens is not None
    return lens


def texture(xy):
    """A smooth picture over directions x / z, y / z."""
    x, y = xy[..., 0], xy[..., 1]
    return np.stack([128 + 90 * np.sin(5 * x + k) * np.cos(4 * y - k) for k in range(3)], axis=-1)


def depth_of(xy):
    return 2.0 + 0.5 * xy[..., 0] + 0.3 * xy[..., 1]


def directions():
    col, row = np.meshgrid(np.arange(CAMERA.width) + 0.5, np.arange(CAMERA.height) + 0.5)
    return np.stack(((col - CAMERA.cx) / CAMERA.fx, (row - CAMERA.cy) / CAMERA.fy), axis=-1)


def straight(lens, imaged):
    """The directions that are imaged at these, by a solver that knows nothing of the code."""
    wanted = imaged.reshape(-1, 2)
    found = least_squares(
        lambda flat: (lens.distorted(flat.reshape(-1, 2)) - wanted).ravel(),
        wanted.ravel(),
        jac_sparsity=sparse.kron(sparse.eye(len(wanted)), np.ones((2, 2))),
        xtol=1e-12,
    )
    assert np.abs(found.fun).max() < 1e-6
    return found.x.reshape(imaged.shape)


@pytest.mark.parametrize(("model", "coefficients"), MODELS)
def test_an_image_comes_out_as_a_pinhole_would_see_it(model, coefficients):
    lens = lens_of(model, coefficients)
    seen = straight(lens, directions())
    rgb, depth_m = np.rint(texture(seen)).astype(np.uint8), depth_of(seen).astype(np.float32)
    out = undistortion(CAMERA, lens)
    error = out.colour(rgb).astype(float) - texture(directions())
    inner = out.inside.copy()
    inner[[0, -1]] = inner[:, [0, -1]] = False
    assert inner.mean() > 0.7
    assert np.abs(error[inner]).max() < 3.0
    # The nearest pixel is half a pixel away at most in each direction.
    half = 0.75 * (0.5 / CAMERA.fx + 0.3 / CAMERA.fy)
    assert np.abs(out.depth(depth_m) - depth_of(directions()))[inner].max() < half
    assert np.isnan(out.depth(depth_m)[~out.inside]).all()
    assert not out.colour(rgb)[~out.inside].any()
    # Without the correction it is off by far more.
    assert np.abs(rgb.astype(float) - texture(directions())).max() > 8.0


@pytest.mark.parametrize(
    ("model", "coefficients", "expected"),
    [
        # x = 0.3, y = 0.4: r2 = 0.25.
        ("plumb_bob", (0.2,), (0.3 * 1.05, 0.4 * 1.05)),
        ("plumb_bob", (0.0, 0.2), (0.3 * 1.0125, 0.4 * 1.0125)),
        ("plumb_bob", (0.0, 0.0, 0.1), (0.3 + 0.2 * 0.12, 0.4 + 0.1 * (0.25 + 0.32))),
        ("plumb_bob", (0.0, 0.0, 0.0, 0.1), (0.3 + 0.1 * (0.25 + 0.18), 0.4 + 0.2 * 0.12)),
        ("plumb_bob", (0.0, 0.0, 0.0, 0.0, 0.64), (0.3 * 1.01, 0.4 * 1.01)),
        ("rational_polynomial", (0.0,) * 5 + (0.2,), (0.3 / 1.05, 0.4 / 1.05)),
        ("thin_prism", (0.0,) * 8 + (0.1, 0.2, 0.3, 0.4), (0.3 + 0.025 + 0.0125, 0.4 + 0.075 + 0.025)),
        ("equidistant", (0.1,), tuple(math.atan(0.5) * (1 + 0.1 * math.atan(0.5) ** 2) * c for c in (0.6, 0.8))),
    ],
)
def test_each_coefficient_does_what_its_model_says(model, coefficients, expected):
    lens = lens_of(model, coefficients)
    np.testing.assert_allclose(lens.distorted(np.array([[0.3, 0.4]]))[0], expected, rtol=1e-12)


def test_what_a_polynomial_folds_back_into_the_image_is_left_out():
    lens = lens_of("plumb_bob", (-0.5,))
    # r (1 - r2 / 2) turns round at r = sqrt(2 / 3).
    assert lens.farthest(2.0) == pytest.approx(math.sqrt(2 / 3), abs=0.005)
    wide = Intrinsics(64, 64, 16.0, 16.0, 32.0, 32.0)
    inside = undistortion(wide, lens).inside
    assert inside[32, 32]
    assert not inside[0, 0]


def test_no_distortion_is_none_and_aliases_are_known():
    assert LensDistortion.of("plumb_bob", (0.0,) * 5) is None
    assert LensDistortion.of("anything", ()) is None
    assert lens_of("fisheye", (0.1,)).model == "equidistant"
    assert lens_of("fisheye", ()) == lens_of("equidistant", (0.0,))
    # Without coefficients it is a lens still: an angle of 45 degrees is imaged at pi / 4.
    np.testing.assert_allclose(lens_of("fisheye", (0.0,) * 4).distorted(np.array([[1.0, 0.0]])), [[math.pi / 4, 0.0]])
    assert lens_of("rational_polynomial", (0.0,) * 8 + (0.1,)).model == "thin_prism"
    assert str(lens_of("plumb_bob", (0.1, 0.0, 0.2))) == "plumb_bob k1 0.1, p1 0.2"


@pytest.mark.parametrize(
    ("model", "coefficients", "said"),
    [
        ("division", (0.1,), "model 'division' is none of"),
        ("plumb_bob", (0.1,) * 6, "has 5 coefficients, not 6"),
        ("rational_polynomial", (0.1,) * 14, "has 12 coefficients, not 14"),
        ("plumb_bob", (math.nan,), "not finite"),
    ],
)
def test_what_is_unknown_is_refused_by_name(model, coefficients, said):
    with pytest.raises(ValueError, match=said):
        lens_of(model, coefficients)


@pytest.mark.parametrize(
    ("words", "model", "coefficients"),
    [
        ("0.1,0,0.2", "plumb_bob", (0.1, 0.0, 0.2, 0.0, 0.0)),
        ("0.1,0,0,0,0,0.2", "rational_polynomial", (0.1, 0.0, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0)),
        ("fisheye,0.1,0.2", "equidistant", (0.1, 0.2, 0.0, 0.0)),
        ("OPENCV_FISHEYE", "equidistant", (0.0,) * 4),
        ("thin_prism, 0.1", "thin_prism", (0.1, *(0.0,) * 11)),
    ],
)
def test_a_lens_is_given_in_words(words, model, coefficients):
    lens = LensDistortion.read(words)
    assert lens is not None
    assert (lens.model, lens.coefficients) == (model, coefficients)
