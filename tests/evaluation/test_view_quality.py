import math

import numpy as np
import pytest

from anm_mj.evaluation.view_quality import MAX_PSNR_DB, compare_view, mean_quality, psnr_db

RNG = np.random.default_rng(0)
RGB = RNG.integers(0, 200, (32, 32, 3), np.uint8)
DEPTH = RNG.uniform(1.0, 4.0, (32, 32)).astype(np.float32)


def test_a_perfect_view_has_no_error():
    quality = compare_view(RGB, DEPTH, RGB, DEPTH)
    assert (quality.psnr_db, quality.psnr_known_db) == (MAX_PSNR_DB, MAX_PSNR_DB)
    assert quality.ssim == pytest.approx(1.0)
    assert (quality.depth_l1_cm, quality.known_percent) == (0.0, 100.0)


def test_psnr_of_a_uniform_error():
    half = np.full((16, 16, 3), 100, np.uint8)
    off = half + np.uint8(25)
    everywhere = np.ones((16, 16), bool)
    assert psnr_db(off, half, everywhere) == pytest.approx(20.0 * math.log10(255.0 / 25.0))
    assert psnr_db(half, off, everywhere) == psnr_db(off, half, everywhere)


def test_depth_l1_is_in_centimetres():
    sign = np.where(RNG.random(DEPTH.shape) < 0.5, -1.0, 1.0).astype(np.float32)
    assert compare_view(RGB, DEPTH + np.float32(0.02) * sign, RGB, DEPTH).depth_l1_cm == pytest.approx(2.0, abs=1e-4)


def test_unknown_pixels_cost_colour_but_not_depth():
    rgb, depth = RGB.copy(), DEPTH.copy()
    rgb[:16], depth[:16] = 0, np.nan
    quality = compare_view(rgb, depth, RGB, DEPTH)
    assert (quality.psnr_known_db, quality.depth_l1_cm, quality.known_percent) == (MAX_PSNR_DB, 0.0, 50.0)
    assert quality.psnr_db < 15.0
    assert quality.ssim < 0.6


def test_the_depth_error_counts_unknown_pixels_and_caps_all():
    depth = DEPTH + np.float32(0.02)
    depth[:8], depth[8:16] = np.nan, DEPTH[8:16] + 5.0
    assert compare_view(RGB, depth, RGB, DEPTH).depth_error_cm == pytest.approx(0.5 * 100.0 + 0.5 * 2.0, abs=1e-3)
    nothing = np.full_like(DEPTH, np.nan)
    assert compare_view(RGB, nothing, RGB, DEPTH).depth_error_cm == 100.0
    assert math.isnan(compare_view(RGB, DEPTH, RGB, nothing).depth_error_cm)


def test_depth_beyond_the_range_does_not_count():
    far = DEPTH.copy()
    far[:16] += 20.0
    far[0] = np.nan
    quality = compare_view(RGB, DEPTH, RGB, far)
    assert (quality.depth_l1_cm, quality.known_percent) == (0.0, 100.0)


def test_an_empty_map_has_no_depth_error():
    quality = compare_view(np.zeros_like(RGB), np.full_like(DEPTH, np.nan), RGB, DEPTH)
    assert math.isnan(quality.depth_l1_cm)
    assert math.isnan(quality.psnr_known_db)
    assert quality.known_percent == 0.0


def test_the_mean_skips_undefined_values():
    known = compare_view(RGB, DEPTH + np.float32(0.5), RGB, DEPTH)
    unknown = compare_view(np.zeros_like(RGB), np.full_like(DEPTH, np.nan), RGB, DEPTH)
    mean = mean_quality([known, unknown])
    assert mean.depth_l1_cm == known.depth_l1_cm
    assert mean.known_percent == pytest.approx(50.0)
    assert math.isnan(mean_quality([unknown]).depth_l1_cm)
