import contextlib
import os
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from anm_mj.io.run_shapes import FrameShape
from anm_mj.scene.folder import SceneShape
from anm_mj.utils.picture import open_picture
from anm_mj.utils.read_file import convert, is_below, parse_json, read_bytes, read_npy, read_npz
from tests.corpus.hostile import fifo, npz_bomb, pickled_npz, png

ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=20,
)


@pytest.mark.parametrize("make", [fifo, os.mkdir, lambda path: path.symlink_to("/dev/zero")])
def test_what_is_no_file_is_refused_without_waiting(make, tmp_path):
    make(tmp_path / "x")
    with pytest.raises(OSError, match=r"regular|directory"):
        read_bytes(tmp_path / "x")


def test_larger_files_are_refused(tmp_path):
    with (tmp_path / "x").open("wb") as file:
        file.truncate(3 << 20)
    with pytest.raises(ValueError, match="3 MiB are more than the 2 MiB"):
        read_bytes(tmp_path / "x", max_mib=2)


@pytest.mark.parametrize("content", [b"[" * 100_000, b'{"a":' * 50_000, b"\xff", b"", b"{"])
def test_no_json_is_a_value_error(content):
    with pytest.raises(ValueError):  # noqa: PT011
        parse_json(content)


def test_arrays_come_back(tmp_path):
    arrays = {"a": np.arange(6.0).reshape(2, 3), "b": np.array([True, False])}
    np.savez_compressed(tmp_path / "x.npz", **arrays)
    for name, array in read_npz(tmp_path / "x.npz").items():
        assert np.array_equal(array, arrays[name])


@pytest.mark.parametrize(("make", "says"), [(npz_bomb, "more than"), (pickled_npz, "(?i)object arrays|pickle")])
def test_bombs_and_pickles_are_refused(make, says, tmp_path):
    make(tmp_path / "x.npz", ("a",))
    with pytest.raises(ValueError, match=says):
        read_npz(tmp_path / "x.npz")


def test_a_damaged_header_of_an_array_is_an_error_of_the_file(tmp_path):
    header = b"{'descr': '<f8', ((( '".ljust(118)
    array = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header
    (tmp_path / "x.npy").write_bytes(array)
    with zipfile.ZipFile(tmp_path / "x.npz", "w") as archive:
        archive.writestr("a.npy", array)
    for read, name in ((read_npy, "x.npy"), (read_npz, "x.npz")):
        with pytest.raises(ValueError, match="header"):
            read(tmp_path / name)


def test_an_archive_without_arrays_holds_none(tmp_path):
    with zipfile.ZipFile(tmp_path / "x.npz", "w") as archive:
        archive.writestr("note.txt", "no array")
    assert read_npz(tmp_path / "x.npz") == {}


@settings(max_examples=200, deadline=None)
@given(ANYTHING, st.sampled_from([FrameShape, SceneShape]))
def test_any_value_has_a_shape_or_a_value_error(value, shape):
    with contextlib.suppress(ValueError):
        assert isinstance(convert(value, shape), shape)


def test_the_place_of_a_wrong_value_is_named():
    with pytest.raises(ValueError, match=r"^x_m: expected float <= 1000000.0"):
        convert({"x_m": 1e9}, FrameShape)


@pytest.mark.parametrize(
    ("content", "says"),
    [(png(60_000, 60_000), "pixels"), (png(20_000, 6_000), "pixels"), (b"%!PS-Adobe-3.0 EPSF-3.0\n", "no image")],
)
def test_huge_pictures_and_programs_are_refused(content, says, tmp_path):
    (tmp_path / "x.png").write_bytes(content)
    with pytest.raises((OSError, ValueError), match=says), open_picture(tmp_path / "x.png"):
        pass


def test_a_picture_opens(tmp_path):
    Image.new("RGB", (4, 3), (1, 2, 3)).save(tmp_path / "x.webp", lossless=True)
    with open_picture(tmp_path / "x.webp") as image:
        assert image.convert("RGB").getpixel((0, 0)) == (1, 2, 3)


def test_a_name_with_nul_lies_below_no_folder(tmp_path):
    assert not is_below(tmp_path / "a\0b", tmp_path)
