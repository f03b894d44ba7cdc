"""Rectangles packed into an image."""

import numpy as np

from anm_mj.scene.generation.atlas import pack


def test_packed_rectangles_do_not_overlap():
    sizes = np.random.default_rng(3).integers(2, 40, (300, 2))

    corners, (width, height) = pack(sizes)

    taken = np.zeros((height, width), np.int64)
    for (x, y), (w, h) in zip(corners, sizes, strict=True):
        taken[y : y + h, x : x + w] += 1
    assert taken.max() == 1
    assert taken.sum() == sizes.prod(axis=1).sum()
