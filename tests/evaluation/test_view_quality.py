import math

import numpy as np
import pytest

from anm_mj.evaluation.view_quality import MAX_PSNR_DB, compare_view, mean_quality, psnr_db

RNG = np.random.default_rng(0)
RGB = RNG.integers(0, 200, (32, 32, 3), np.uint8)
DEPTH = RNG.uniform(1.0, 4.0, (32, 32)).astype(np.float32)


def test_the_true_view_itself_is_perfect():
    quality = compare_view(RGB, DEPTH, RGB, DEPTH)
    assert (quality.psnr_db, quality.psnr_known_db) == (MAX_PSNR_DB, MAX_PSNR_DB)
    assert quality.ssim == pytest.approx(1.0)
    assert (quality.depth_l1_cm, quality.known_percent) == (0.0, 100.0)


def test_an_error_of_a_tenth_of_full_scale_is_twenty_decibels():
    half = np.full((16, 16, 3), 100, np.uint8)
    off = half + np.uint8(25)
    everywhere = np.ones((16, 16), bool)
    assert psnr_db(off, half, everywhere) == pytest.approx(20.0 * math.log10(255.0 / 25.0))
    assert psnr_db(half, off, everywhere) == psnr_db(off, half, everywhere)


def test_the_depth_error_is_the_mean_of_its_size_in_centimetres():
    sign = np.where(RNG.random(DEPTH.shape) < 0.5, -1.0, 1.0).astype(np.float32)
    assert compare_view(RGB, DEPTH + np.float32(0.02) * sign, RGB, DEPTH).depth_l1_cm == pytest.approx(2.0, abs=1e-4)


def test_what_the_map_does_not_know_costs_colour_but_not_depth():
    rgb, depth = RGB.copy(), DEPTH.copy()
    rgb[:16], depth[:16] = 0, np.nan
    quality = compare_view(rgb, depth, RGB, DEPTH)
    assert (quality.psnr_known_db, quality.depth_l1_cm, quality.known_percent) == (MAX_PSNR_DB, 0.0, 50.0)
    assert quality.psnr_db < 15.0
    assert quality.ssim < 0.6


def test_depth_beyond_the_sensors_range_does_not_count():
    far = DEPTH.copy()
    far[:16] += 20.0
    far[0] = np.nan
    quality = compare_view(RGB, DEPTH, RGB, far)
    assert (quality.depth_l1_cm, quality.known_percent) == (0.0, 100.0)


def test_a_map_that_knows_nothing_has_no_depth_error():
    quality = compare_view(np.zeros_like(RGB), np.full_like(DEPTH, np.nan), RGB, DEPTH)
    assert math.isnan(quality.depth_l1_cm)
    assert math.isnan(quality.psnr_known_db)
    assert quality.known_percent == 0.0


def test_the_mean_leaves_out_what_a_view_does_not_have():
    known = compare_view(RGB, DEPTH + np.float32(0.5), RGB, DEPTH)
    unknown = compare_view(np.zeros_like(RGB), np.full_like(DEPTH, np.nan), RGB, DEPTH)
    mean = mean_quality([known, unknown])
    assert mean.depth_l1_cm == known.depth_l1_cm
    assert mean.known_percent == pytest.approx(50.0)
    assert math.isnan(mean_quality([unknown]).depth_l1_cm)
