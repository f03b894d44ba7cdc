import io
import struct

import numpy as np
import pytest
from PIL import Image

from anm_mj.errors import RunFolderError
from anm_mj.io.sequence_layouts import SequenceOptions, open_sequence
from tests.io.bags import (
    COLOUR,
    DEPTH,
    calibration,
    changed,
    check,
    compressed,
    image,
    images,
    poses_by_tf,
    seen,
    write_bag,
)


def test_metres_in_floats_and_compressed_images(tmp_path):
    said = poses_by_tf()
    for one in seen():
        t, buffer = one.time_s + 100.0, io.BytesIO()
        Image.fromarray(one.rgb[..., ::-1] + np.uint8(one.step)).save(buffer, "PNG")
        said.append((COLOUR + "/compressed", t, compressed(t, buffer.getvalue(), "bgr8; png compressed bgr8")))
        said.append((DEPTH, t, image(t, one.depth_m.astype(np.float32), "32FC1", big=True)))
        said.append((DEPTH.replace("image_raw", "camera_info"), t, calibration(t)))
    path = write_bag(tmp_path / "bag", said)
    check(open_sequence(path, SequenceOptions(floor_m=0.0))[0], steps=range(6))


@pytest.mark.parametrize("kind", ["16UC1", "32FC1"])
def test_compressed_depth(tmp_path, kind):
    said = [entry for entry in images() if entry[0] != DEPTH] + poses_by_tf()
    a, b = 120.0, -1.5
    for one in seen():
        t, buffer = one.time_s + 100.0, io.BytesIO()
        steps = 1000.0 * one.depth_m if kind == "16UC1" else a / one.depth_m + b
        Image.fromarray(np.rint(steps).astype(np.uint16)).save(buffer, "PNG")
        data = struct.pack("<iff", 0, a, b) + buffer.getvalue()
        said.append((DEPTH + "/compressedDepth", t, compressed(t, data, f"{kind}; compressedDepth png")))
    frames = list(open_sequence(write_bag(tmp_path / "bag", said), SequenceOptions(floor_m=0.0))[0].observations())
    for found, step in zip(frames, (0, 1, 2, 4, 5), strict=True):
        tolerance = 0.0006 if kind == "16UC1" else 0.6 / a * seen()[step].depth_m.max() ** 2
        np.testing.assert_allclose(found.depth_m, seen()[step].depth_m, atol=tolerance)


def test_floats_of_another_unit(tmp_path):
    def in_millimetres(_, k):
        return image(100.0 + seen()[k].time_s, 1000.0 * seen()[k].depth_m.astype(np.float32), "32FC1")

    path = write_bag(tmp_path / "bag", changed(DEPTH, in_millimetres))
    sequence, _ = open_sequence(path, SequenceOptions(depth_unit_m=0.001, floor_m=0.0))
    assert sequence.stated_unit_m == 0.001
    for found, step in zip(sequence.observations(), (0, 1, 2, 4, 5), strict=True):
        np.testing.assert_allclose(found.depth_m, seen()[step].depth_m, rtol=1e-5)


def test_depth_beyond_everything_is_none(tmp_path):
    def far(message, k):
        depth_m = seen()[k].depth_m.copy()
        depth_m[0] = 1e30
        return image(100.0 + seen()[k].time_s, depth_m.astype(np.float32), "32FC1")

    sequence, _ = open_sequence(write_bag(tmp_path / "bag", changed(DEPTH, far)))
    assert np.isnan(next(sequence.observations()).depth_m[0]).all()


@pytest.mark.parametrize(
    ("kind", "words", "fits"),
    [("uint16", "16UC1; png compressed ", True), ("uint16", "png", True), ("uint8", "16UC1; png compressed ", False)],
)
def test_depth_in_a_plain_png_has_16_bits(tmp_path, kind, words, fits):
    said = [entry for entry in images() if entry[0] != DEPTH] + poses_by_tf()
    for one in seen():
        buffer = io.BytesIO()
        Image.fromarray(np.rint(1000.0 * one.depth_m).astype(kind)).save(buffer, "PNG")
        t = one.time_s + 100.0
        said.append((DEPTH + "/compressed", t, compressed(t, buffer.getvalue(), words)))
    sequence, _ = open_sequence(write_bag(tmp_path / "bag", said), SequenceOptions(floor_m=0.0))
    if fits:
        check(sequence)
    else:
        with pytest.raises(RunFolderError, match="its pixels are L, not one number of 16 bits each"):
            list(sequence.observations())
