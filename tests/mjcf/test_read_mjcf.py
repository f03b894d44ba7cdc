"""What an MJCF file asks for is known before MuJoCo makes it."""

import os
from pathlib import Path

import pytest
from PIL import Image

from anm_mj.mjcf import read_mjcf
from anm_mj.mjcf.read_mjcf import OutsideError, named_files, read_spec, top_folder

BOX = '<geom type="box" size="0.1 0.1 0.1"/>'


def read(folder, text, option="", **others):
    for name, content in others.items():
        (folder / f"{name}.xml").write_text(content)
    path = folder / "world.xml"
    path.write_text(f"<mujoco>{text}</mujoco>")
    return read_spec(path, option=option)


def test_what_mujoco_takes_is_read(tmp_path):
    text = f'<!-- a -- comment --><worldbody><replicate count="3" offset="1 0 0">{BOX}</replicate></worldbody>'
    spec = read(tmp_path, text + '<include file="more.xml"/>', more=f"<mujoco><worldbody>{BOX}</worldbody></mujoco>")
    assert len(spec.compile().geom_size) == 4


def test_nested_copies_count_once_as_copies(tmp_path):
    nested = '<replicate count="12" offset="1 0 0">' * 3 + BOX + "</replicate>" * 3
    assert len(read(tmp_path, f"<worldbody>{nested}</worldbody>").compile().geom_size) == 12**3


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
        (
            "<asset>"
            + "".join(f'<hfield name="h{k}" nrow="4900" ncol="4900" size="1 1 1 1"/>' for k in range(2))
            + "</asset>",
            "cells",
        ),
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


def test_textures_count_together(tmp_path, monkeypatch):
    Image.new("RGB", (1000, 500)).save(tmp_path / "a.png")
    names = "".join(f"<texture name='{k}' type='2d' file='a.png'/>" for k in range(3))
    path = tmp_path / "world.xml"
    path.write_text(f"<mujoco><asset>{names}</asset></mujoco>")
    monkeypatch.setattr(read_mjcf, "MAX_TEXTURE_MEGAPIXELS", 3)
    read_spec(path)
    monkeypatch.setattr(read_mjcf, "MAX_TEXTURE_MEGAPIXELS", 2)
    with pytest.raises(ValueError, match=r"2 megapixels of textures.*ANM_MJ_MAX_TEXTURE_MEGAPIXELS"):
        read_spec(path)


def test_files_may_lie_a_few_folders_above(tmp_path, monkeypatch):
    deep = tmp_path / "sets" / "houses" / "val" / "12"
    deep.mkdir(parents=True)
    for place in (tmp_path / "sets" / "assets", tmp_path / "elsewhere"):
        place.mkdir()
        Image.new("RGB", (4, 4)).save(place / "wood.png")
    texture = '<compiler texturedir="{}"/><asset><texture name="t" type="2d" file="wood.png"/></asset>'
    above, beyond = texture.format("../../../assets"), texture.format("../../../../elsewhere")
    assert len(read(deep, above).textures) == 1
    assert named_files(deep / "world.xml") == [
        deep / "../../../assets/wood.png",
        deep / "world.xml",
    ]
    with pytest.raises(OutsideError, match=f"outside of {tmp_path / 'sets'}: copy it there$"):
        read(deep, beyond)
    spec = read_spec(deep / "world.xml", others=[tmp_path / "elsewhere"])
    assert len(spec.textures) == 1
    # The user's home is no place of one model.
    monkeypatch.setenv("HOME", str(tmp_path / "sets"))
    with pytest.raises(OutsideError, match=f"outside of {tmp_path / 'sets' / 'houses'}: .*, or give its folder by --o"):
        read(deep, above, option="--option")


def test_the_folder_of_all_folders_is_no_place_of_one_model(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path / "me"))
    assert top_folder(Path("/scenes"), 3) == Path("/scenes")
    assert top_folder(Path("/data/sets/a/b/c"), 3) == Path("/data/sets")
    assert top_folder(tmp_path / "me" / "houses", 3) == tmp_path / "me"
    assert top_folder(tmp_path / "me" / "sets" / "houses", 3) == tmp_path / "me" / "sets"


def test_files_may_lie_beside_the_folder(tmp_path):
    (tmp_path / "pictures").mkdir()
    (tmp_path / "mjcf").mkdir()
    Image.new("RGB", (4, 4)).save(tmp_path / "pictures" / "wood.png")
    text = '<asset><texture name="t" type="2d" file="../pictures/wood.png"/></asset>'
    assert read(tmp_path / "mjcf", text).textures[0].file.endswith("wood.png")
    with pytest.raises(ValueError, match="lies outside"):
        read_spec(tmp_path / "mjcf" / "world.xml", levels_up=0)


@pytest.mark.parametrize("compiler", ['meshdir="{}"', 'assetdir="{}" strippath="true"', ""])
@pytest.mark.parametrize("within", ["main", "included", "nested"])
def test_an_attached_model_names_no_files_from_elsewhere(tmp_path, compiler, within):
    deep = tmp_path / "a" / "b" / "c" / "d"
    (deep / "parts").mkdir(parents=True)
    for file in (tmp_path / "secret.obj", tmp_path / "a" / "near.obj"):
        file.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n")

    def model(folder, name):
        name = name if compiler else f"{folder}/{name}"
        text = f'<compiler {compiler.format(folder)}/><asset><mesh name="m" file="{name}"/></asset><worldbody>'
        (deep / "parts" / "thing.xml").write_text(
            f'<mujoco>{text}<body name="b"><geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
        )

    def attach(file):
        asset = f'<asset><model name="t" file="{file}"/></asset>'
        return asset, '<worldbody><frame><attach model="t" body="b" prefix="p"/></frame></worldbody>'

    asset, text = attach("parts/thing.xml")
    if within == "main":
        text = asset + text
    elif within == "included":
        (deep / "more.xml").write_text(f"<mujoco>{asset}</mujoco>")
        text = '<include file="more.xml"/>' + text
    else:
        inner = "".join(attach("thing.xml")).replace("<frame>", '<body name="b">').replace("</frame>", "</body>")
        (deep / "parts" / "outer.xml").write_text(f"<mujoco>{inner}</mujoco>")
        text = "".join(attach("parts/outer.xml"))
    model("../../../..", "near.obj")
    assert read(deep, text).compile().nmesh == 1
    assert deep / "parts/../../../../near.obj" in named_files(deep / "world.xml")
    model("../../../../..", "secret.obj")
    with pytest.raises(OutsideError, match=r"secret\.obj', which lies outside"):
        read(deep, text)


def test_textures_of_attached_models_count(tmp_path, monkeypatch):
    (tmp_path / "parts").mkdir()
    Image.new("RGB", (1000, 1500)).save(tmp_path / "parts" / "a.png")
    texture = '<asset><texture name="t" type="2d" file="a.png"/></asset>'
    (tmp_path / "parts" / "thing.xml").write_text(
        f'<mujoco>{texture}<worldbody><body name="b">{BOX}</body></worldbody></mujoco>'
    )
    asset = '<asset><model name="t" file="parts/thing.xml"/></asset>'
    text = asset + '<worldbody><attach model="t" body="b" prefix="p"/></worldbody>'
    monkeypatch.setattr(read_mjcf, "MAX_TEXTURE_MEGAPIXELS", 3)
    read(tmp_path, text)
    monkeypatch.setattr(read_mjcf, "MAX_TEXTURE_MEGAPIXELS", 2)
    with pytest.raises(ValueError, match="2 megapixels of textures"):
        read(tmp_path, text)


def test_what_two_models_include_is_looked_for_from_each(tmp_path):
    deep = tmp_path / "a" / "b" / "c" / "d"
    (deep / "parts").mkdir(parents=True)
    for folder in (tmp_path, deep):
        (folder / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n")
    (deep / "shared.xml").write_text('<mujoco><asset><mesh name="m" file="m.obj"/></asset></mujoco>')
    (deep / "parts" / "thing.xml").write_text(
        '<mujoco><compiler meshdir="../../../../.."/><include file="../shared.xml"/><worldbody><body name="b">'
        '<geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
    )
    text = '<include file="shared.xml"/><asset><model name="t" file="parts/thing.xml"/></asset>'
    with pytest.raises(OutsideError, match=r"m\.obj', which lies outside"):
        read(deep, text + '<worldbody><frame><attach model="t" body="b" prefix="p"/></frame></worldbody>')
