"""Replayed pixels in tensors, on the CPU here, against those in arrays of the host."""

import numpy as np
import pytest
import torch

from anm_mj.mapping.backends.triton.pixels import DevicePixels, DeviceRays
from anm_mj.mapping.keyframes import KeyframeStore
from anm_mj.mapping.pixel_memory import PIXEL, HostPixels, PixelMemory
from tests.mapping.ray_room import Room

CPU = torch.device("cpu")
NAMES = ("origin_m", "direction", "rgb", "depth_m")


def on_device(count: int) -> DevicePixels:
    return DevicePixels(count, CPU)


def test_both_memories_stand_at_the_same_border():
    assert isinstance(on_device(1), PixelMemory)
    assert isinstance(HostPixels(1), PixelMemory)


def test_the_same_seed_gives_the_same_batches_bit_for_bit_also_after_thinning():
    room = Room(ceiling=False)
    # Of several sizes, so that pixels move to where others still lie, and places differ from frame to frame.
    views = [room.observe(1.2 + 0.1 * k, 1.5, 0.7 * k, size=size) for k, size in enumerate((16, 64, 24, 64, 96, 32))]
    limit = 7000 * PIXEL.itemsize
    stores = [KeyframeStore(limit, 1.0, make_memory) for make_memory in (HostPixels, on_device)]
    generators = [np.random.default_rng(3) for _ in stores]
    thinned = False
    for view in views:
        for store, rng in zip(stores, generators, strict=True):
            store.add(view, rng)
        batches = [list(store.batches(3, 200, view, 17, rng)) for store, rng in zip(stores, generators, strict=True)]
        assert [len(rays) for rays in batches[1]] == [217] * 3
        for host, device in zip(*batches, strict=True):
            assert isinstance(device, DeviceRays)
            for name in NAMES:
                np.testing.assert_array_equal(getattr(device, name), getattr(host, name))
        np.testing.assert_array_equal(stores[0].num_pixels, stores[1].num_pixels)
        assert stores[1].num_pixels.sum() * PIXEL.itemsize <= limit
        thinned |= stores[1].num_pixels[0] < 16 * 16
    assert thinned
    assert np.isnan(device.depth_m).any()


def test_a_first_frame_is_drawn_from_the_store_alone(room: Room):
    store = KeyframeStore(1_000_000, 1.0, on_device)
    view = room.observe(1.5, 1.5, 0.0, size=16)
    rng = np.random.default_rng(0)
    store.add(view, rng)
    (rays,) = store.batches(1, 50, view, 0, rng)
    points = rays.origin_m + rays.direction * rays.depth_m[:, None]
    assert np.abs(room.sdf(points.astype(float))).max() < 1e-3


def test_a_place_in_a_large_image_comes_back_whole():
    # Beyond 2^31, where a signed word of 32 bits turns negative.
    memory = on_device(1)
    pixel = np.array([(3_000_000_000, (1, 2, 3), 65_535)], PIXEL)
    camera = np.array([60_000, 1, 1, 0, 0, *np.eye(4)[:3].ravel()], np.float32)
    memory.add_keyframe(0, pixel, camera)
    rows = memory._rays(torch.tensor([0]), torch.tensor([0]))
    assert rows[3:5, 0].tolist() == [0.5, 50_000.5]
    assert rows[9, 0].item() == pytest.approx(13.107)


def test_a_batch_on_a_device_says_what_it_has():
    rays = DeviceRays(torch.zeros(10, 4))
    with pytest.raises(AttributeError, match="has no 'colour'"):
        rays.colour  # noqa: B018
