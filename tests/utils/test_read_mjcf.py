"""What an MJCF file asks for is known before MuJoCo makes it."""

import os

import mujoco
import pytest
from PIL import Image

from anm_mj.utils.read_mjcf import read_spec

BOX = '<geom type="box" size="0.1 0.1 0.1"/>'


def read(folder, text, **others):
    for name, content in others.items():
        (folder / f"{name}.xml").write_text(content)
    path = folder / "world.xml"
    path.write_text(f"<mujoco>{text}</mujoco>")
    return read_spec(path, mujoco.MjSpec.from_file)


def test_what_mujoco_takes_is_read(tmp_path):
    text = f'<!-- a -- comment --><worldbody><replicate count="3" offset="1 0 0">{BOX}</replicate></worldbody>'
    spec = read(tmp_path, text + '<include file="more.xml"/>', more=f"<mujoco><worldbody>{BOX}</worldbody></mujoco>")
    assert len(spec.compile().geom_size) == 4


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f'<worldbody><replicate count="1000000000">{BOX}</replicate></worldbody>', "elements"),
        ("<worldbody>" + '<replicate count="20">' * 4 + BOX + "</replicate>" * 4 + "</worldbody>", "elements"),
        ('<worldbody><flexcomp name="f" type="grid" count="1000 1000 1000" dim="3"/></worldbody>', "elements"),
        ('<include file="twice.xml"/>', "elements"),
        ('<asset><texture name="t" type="2d" builtin="flat" width="100000" height="1000"/></asset>', "cells"),
        ('<asset><hfield name="h" nrow="30000" ncol="30000" size="1 1 1 1"/></asset>', "cells"),
        ('<asset><texture name="t" type="cube" builtin="flat" width="20000" height="1"/></asset>', "cells"),
        ('<size nkey="2000000000"/>', "nkey"),
        ('<asset><mesh name="m" file="/etc/passwd"/></asset>', "lies outside"),
        ('<asset><mesh name="m" file="fifo.stl"/></asset>', "no regular file"),
        ('<asset><texture name="t" type="2d" file="text.png"/></asset>', "image"),
        ('<include file="../../../etc/passwd"/>', "lies outside|no file"),
        ("<worldbody>", "well-formed"),
    ],
)  # fmt: skip
def test_what_asks_for_too_much_is_refused(tmp_path, text, said):
    os.mkfifo(tmp_path / "fifo.stl")
    (tmp_path / "text.png").write_text("text")
    twice = f"<mujoco><worldbody>{BOX * 41_000}</worldbody></mujoco>"
    with pytest.raises((OSError, ValueError), match=said):
        read(tmp_path, text, twice=twice)


def test_files_may_lie_beside_the_folder(tmp_path):
    (tmp_path / "pictures").mkdir()
    (tmp_path / "mjcf").mkdir()
    Image.new("RGB", (4, 4)).save(tmp_path / "pictures" / "wood.png")
    text = '<asset><texture name="t" type="2d" file="../pictures/wood.png"/></asset>'
    assert read(tmp_path / "mjcf", text).textures[0].file.endswith("wood.png")
    with pytest.raises(ValueError, match="lies outside"):
        read_spec(tmp_path / "mjcf" / "world.xml", mujoco.MjSpec.from_file, beside=False)
