import numpy as np
import pytest

from anm_mj.errors import MapError
from anm_mj.mapping.keyframes import PIXEL, KeyframeStore
from anm_mj.mapping.mapping_config import SamplingConfig
from anm_mj.mapping.rays import RayBatch, part, sample_frame
from tests.mapping.numpy_reference import concatenate
from tests.mapping.ray_room import Room


def drawn(store: KeyframeStore, count: int, rng: np.random.Generator) -> RayBatch:
    """So many stored pixels, and none of a frame at hand."""
    (rays,) = store.batches(1, count, Room().observe(1.5, 1.5, 0.0), 0, rng)
    return rays


@pytest.mark.parametrize("stored", [True, False])
def test_rays_lead_from_the_camera_to_the_surface_they_saw(room: Room, stored: bool):
    rng = np.random.default_rng(0)
    observation = room.observe(1.5, 1.2, 0.7)
    if stored:
        store = KeyframeStore(10_000_000, 1.0)
        store.add(observation, rng)
        rays = drawn(store, 200, rng)
    else:
        rays = sample_frame(observation, 200, rng)
    points = rays.origin_m + rays.direction * rays.depth_m[:, None]
    assert np.abs(room.sdf(points.astype(float))).max() < 1e-3
    np.testing.assert_allclose(rays.rgb, room.color(points), atol=0.005)
    np.testing.assert_allclose(rays.origin_m, np.broadcast_to([1.5, 1.2, 1.2], (200, 3)), atol=1e-6)


def test_missing_and_far_depth_come_back_as_nan():
    rng = np.random.default_rng(0)
    observation = Room(ceiling=False).observe(1.5, 1.2, 0.7)
    assert np.isinf(observation.depth_m).any()
    observation.depth_m[:, :10] = 40.0
    store = KeyframeStore(10_000_000, 1.0)
    store.add(observation, rng)
    rays = drawn(store, 500, rng)
    assert np.isnan(rays.depth_m).any()
    assert np.nanmax(rays.depth_m) < 10.0


def test_all_depth_that_counts_is_kept():
    rng = np.random.default_rng(0)
    largest_m = SamplingConfig(max_depth_m=13.1).max_depth_m
    with pytest.raises(MapError, match=r"max_depth_m is 13\.2.*at most 13\.1"):
        SamplingConfig(max_depth_m=13.2)
    observation = Room().observe(1.5, 1.2, 0.7)
    observation.depth_m[:] = largest_m
    store = KeyframeStore(10_000_000, 1.0)
    store.add(observation, rng)
    np.testing.assert_allclose(drawn(store, 500, rng).depth_m, largest_m, atol=1e-3)


def test_memory_stays_bounded_and_every_keyframe_keeps_being_replayed(room: Room):
    rng = np.random.default_rng(0)
    store = KeyframeStore(64 * 64 * 3 * PIXEL.itemsize, 1.0)
    for observation in room.turn(1.5, 1.5, 10):
        store.add(observation, rng)
        assert store.num_pixels.sum() <= 64 * 64 * 3
    assert len(store) == 10
    headings = {tuple(np.round(d, 4)) for d in drawn(store, 4000, rng).direction}
    yaws = np.arctan2([d[1] for d in headings], [d[0] for d in headings])
    assert np.histogram(yaws, bins=10, range=(-np.pi, np.pi))[0].min() > 0


def test_a_full_store_keeps_as_much_of_the_oldest_keyframe_as_of_the_newest(room: Room):
    rng = np.random.default_rng(0)
    store = KeyframeStore(64 * 64 * 9 * 3, 1.0)
    views = [room.observe(1.0 + 0.1 * k, 1.5, 0.3 * k) for k in range(14)]
    for view in views:
        store.add(view, rng)
    # Of quarters only twelve would fit, so each is down to an eighth.
    assert store.num_pixels.tolist() == [64 * 64 // 8] * 14
    rays = drawn(store, 20_000, rng)
    shares = [(np.abs(rays.origin_m[:, 0] - 1.0 - 0.1 * k) < 0.01).mean() for k in range(14)]
    np.testing.assert_allclose(shares, 1 / 14, atol=0.01)
    # What is left of each is still what that camera saw, and spread over its whole image.
    points = rays.origin_m + rays.direction * rays.depth_m[:, None]
    assert np.abs(room.sdf(points.astype(float))).max() < 1e-3
    oldest = rays.direction[np.abs(rays.origin_m[:, 0] - 1.0) < 0.01]
    counts, _, _ = np.histogram2d(oldest[:, 1], oldest[:, 2], bins=4, range=[(-1, 1), (-1, 1)])
    assert counts.min() > 0.5 * counts.mean()


def test_images_of_several_sizes_share_a_store(room: Room):
    rng = np.random.default_rng(0)
    store = KeyframeStore(10_000_000, 1.0)
    store.add(room.observe(1.5, 1.2, 0.0, size=32), rng)
    store.add(room.observe(1.5, 1.2, 2.0, size=300), rng)
    assert store.num_pixels.tolist() == [32 * 32, 300 * 300]
    rays = drawn(store, 2000, rng)
    points = rays.origin_m + rays.direction * rays.depth_m[:, None]
    assert np.abs(room.sdf(points.astype(float))).max() < 1e-3


def test_a_store_too_small_for_one_pixel_of_each_keyframe_says_so(room: Room):
    rng = np.random.default_rng(0)
    store = KeyframeStore(9 * 3, 1.0)
    *fitting, surplus = room.turn(1.5, 1.5, 4)
    for observation in fitting:
        store.add(observation, rng)
    with pytest.raises(MapError, match="3 keyframes of one pixel"):
        store.add(surplus, rng)


def test_a_share_of_the_pixels_can_be_kept(room: Room):
    rng = np.random.default_rng(0)
    store = KeyframeStore(10_000_000, 0.05)
    store.add(room.observe(1.5, 1.2, 0.0), rng)
    assert store.num_pixels.tolist() == [round(0.05 * 64 * 64)]


def test_pixels_are_kept_as_often_as_their_weight_says(room: Room):
    rng = np.random.default_rng(0)
    store = KeyframeStore(10_000_000, 0.5)
    observation = room.observe(1.5, 1.2, 0.0)
    weight = np.ones((64, 64), np.float32)
    weight[:, 32:] = 7.0
    store.add(observation, rng, weight)
    assert store.num_pixels.tolist() == [64 * 64 // 2]
    # The camera looks along world x, so the right half of the picture lies at negative y.
    share = (drawn(store, 20_000, rng).direction[:, 1] < 0.0).mean()
    assert share == pytest.approx(7 / 8, abs=0.01)


def test_a_pixel_without_weight_is_never_replayed(room: Room):
    rng = np.random.default_rng(0)
    store = KeyframeStore(10_000_000, 1.0)
    weight = np.zeros((64, 64), np.float32)
    weight[10, 20] = 0.3
    store.add(room.observe(1.5, 1.2, 0.0), rng, weight)
    rays = drawn(store, 50, rng)
    assert np.ptp(rays.direction, axis=0).max() == 0.0


def test_the_parts_of_a_batch_joined_are_the_batch(room: Room):
    rays = sample_frame(room.observe(1.5, 1.2, 0.0), 10, np.random.default_rng(0))
    joined = concatenate(part(rays, 0, 4), part(rays, 4, 6))
    for name in ("origin_m", "direction", "rgb", "depth_m"):
        np.testing.assert_array_equal(getattr(joined, name), getattr(rays, name))


def test_thinned_keyframes_fit_and_small_ones_keep_all(room: Room):
    rng = np.random.default_rng(0)
    store = KeyframeStore(10_000_000, 1.0)
    for count, observation in zip((10, 4096, 4096), room.turn(1.5, 1.5, 3), strict=True):
        observation.depth_m.reshape(-1)[count:] = np.nan
        store.add(observation, rng)
    every = store.keyframes()
    thin = every.thinned(1010 * PIXEL.itemsize)
    assert thin.num_pixels.tolist() == [10, 500, 500]
    np.testing.assert_array_equal(thin.pixels[10:510], every.pixels[10:510])
    np.testing.assert_array_equal(thin.pixels[510:], every.pixels[10 + 4096 : 10 + 4096 + 500])
    assert every.thinned(10**9).num_pixels.tolist() == [10, 4096, 4096]
    assert len(every.thinned(0)) == 0


def test_replaced_keyframes_leave_the_others_as_they_are(room: Room):
    rng = np.random.default_rng(0)
    store = KeyframeStore(10_000_000, 1.0)
    for observation in room.turn(1.5, 1.5, 3):
        store.add(observation, rng)
    last = store.keyframes().pixels[2 * 4096 :].copy()
    left_out = np.zeros(2 * 4096, bool)
    left_out[:4096] = True
    left_out[5000:] = True
    store.replace(2, store.keyframes(2).without(left_out))
    assert store.num_pixels.tolist() == [5000 - 4096, 4096]
    np.testing.assert_array_equal(store.keyframes().pixels[5000 - 4096 :], last)
    points = (rays := drawn(store, 200, rng)).origin_m + rays.direction * rays.depth_m[:, None]
    assert np.abs(room.sdf(points.astype(float))).max() < 1e-3
