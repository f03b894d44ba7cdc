"""What is missing, damaged or elsewhere in a Gazebo world."""

import os

import numpy as np
import pytest
import trimesh

from anm_mj.errors import SceneError
from anm_mj.scene.importing.import_scene import import_scene
from anm_mj.scene.importing.readers.sdf_material import read_script
from tests.scene.importing.readers.gazebo_worlds import (
    GROUND,
    ROOM,
    box,
    read_parts,
    write_model,
    write_picture,
    write_world,
)

_NOTHING = (
    '<model name="a"><link name="l"><visual name="v"><geometry>'
    "<box><size>0 0 0</size></box></geometry></visual></link></model>"
)


def test_what_is_missing_is_said_once_and_left_out(tmp_path):
    mesh = "<geometry><mesh><uri>model://dog/dog.obj</uri></mesh></geometry>"
    dogs = "".join(
        f"<model name='dog{i}'><link name='l'><visual name='v'>{mesh}</visual></link></model>" for i in range(3)
    )
    cats = "<include><uri>model://cat</uri></include>" * 2 + "<include><uri>model://sun</uri></include>"
    odd = "<model name='hill'><link name='l'><visual name='v'><geometry><heightmap/></geometry></visual></link></model>"
    src = write_world(tmp_path / "w.sdf", GROUND + ROOM + dogs + cats + odd + "<actor name='walker'/>")
    parts, said = read_parts(src)
    assert len(parts) == 5
    assert len(said) == 3
    assert said[0].startswith("Not found: the models cat, which are left out; give the folders")
    assert "Not found: the meshes dog/dog.obj, which are left out." in said
    assert "Left out, because such shapes cannot be imported: <heightmap> of hill_v, <actor> walker." in said


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("<sdf version='1.6'><world>", "damaged"),
        ("<robot name='r'/>", "no SDF"),
        ("<sdf version='1.6'><world name='w'/></sdf>", "nothing that can be drawn"),
        ("<sdf version='1.6'>" + box("a", "<pose>1 2</pose>") + "</sdf>", "6 numbers"),
        ("<sdf version='1.6'>" + box("a", "<pose relative_to='b'>0 0 0 0 0 0</pose>") + "</sdf>", "'b', which is not"),
        ("<sdf version='1.6'>" + box("a", "<pose relative_to='a'>0 0 0 0 0 0</pose>") + "</sdf>", "in a circle"),
        ("<sdf version='1.6'>" + box("a", size="1 two 3") + "</sdf>", "3 numbers"),
        (f"<sdf version='1.6'>{_NOTHING}</sdf>", "holds no triangles"),
    ],
)
def test_broken_worlds_are_refused_in_one_sentence(tmp_path, content, reason):
    (tmp_path / "w.world").write_text(content)
    with pytest.raises(SceneError, match=reason) as caught:
        import_scene(tmp_path / "w.world", tmp_path / "out")
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["w.world"]


def test_a_model_that_includes_itself_is_refused(tmp_path):
    write_model(tmp_path / "models", "snake", "<include><uri>model://snake</uri></include>")
    src = write_world(tmp_path / "worlds" / "w.world", "<include><uri>model://snake</uri></include>")
    with pytest.raises(SceneError, match="include itself"):
        import_scene(src, tmp_path / "out")


def test_a_world_that_includes_itself_is_refused(tmp_path):
    content = GROUND + ROOM + "<include><uri>w.world</uri></include>"
    src = write_world(tmp_path / "w.world", content)
    with pytest.raises(SceneError, match="includes itself"):
        import_scene(src, tmp_path / "out")


@pytest.mark.parametrize("name", ["gone", "x" * 5000])
def test_a_model_path_that_is_no_folder_is_refused(tmp_path, name):
    src = write_world(tmp_path / "w.world", GROUND + ROOM)
    with pytest.raises(SceneError, match="--model-path"):
        import_scene(src, tmp_path / "out", model_paths=[tmp_path / name])


def _mesh(uri: str) -> str:
    return (
        f"<model name='m'><link name='l'><visual name='v'><geometry><mesh><uri>{uri}</uri></mesh></geometry></visual>"
        "</link></model>"
    )


@pytest.mark.parametrize("where", ["{0}/secret.obj", "file://{0}/secret.obj", "../../../../secret.obj", "link.obj"])
def test_a_mesh_from_elsewhere_is_not_read(tmp_path, where):
    trimesh.creation.box().export(tmp_path / "secret.obj")
    src = write_world(tmp_path / "a" / "b" / "c" / "d" / "w.world", box("a") + _mesh(where.format(tmp_path)))
    (src.parent / "link.obj").symlink_to(tmp_path / "secret.obj")
    parts, said = read_parts(src)
    assert len(parts) == 1
    assert said[0].startswith("Not read, because they lie elsewhere")
    assert "secret.obj" in said[0] or "link.obj" in said[0]
    # The folder that the user gives is one that may be read.
    assert len(read_parts(src, tmp_path)[0]) == 2


def test_a_mesh_up_to_three_folders_above_is_read(tmp_path):
    (tmp_path / "a").mkdir()
    trimesh.creation.box().export(tmp_path / "a" / "near.obj")
    parts, said = read_parts(write_world(tmp_path / "a" / "b" / "c" / "d" / "w.world", _mesh("../../../near.obj")))
    assert len(parts) == 1
    assert not said


def test_a_texture_or_model_from_elsewhere_is_not_read(tmp_path):
    write_picture(tmp_path)
    write_model(tmp_path, "far", box("b"))
    map_ = f"<material><pbr><metal><albedo_map>file://{tmp_path}/p.png</albedo_map></metal></pbr></material>"
    # The configuration of a model names no file elsewhere, either.
    near = tmp_path / "a" / "b" / "c" / "d"
    (near / "near").mkdir(parents=True)
    (near / "near" / "model.config").write_text("<model><sdf>../../../../../far/model.sdf</sdf></model>")
    includes = f"<include><uri>file://{tmp_path}/far</uri></include><include><uri>near</uri></include>"
    parts, said = read_parts(write_world(near / "w.world", box("a", more=map_) + includes))
    assert [part.texture for part in parts] == [None]
    assert said[0].startswith("Not read, because they lie elsewhere")
    assert f"{tmp_path}/p.png" in said[0] or f"{tmp_path}/far" in said[0]


def _scripted(tmp_path):
    """A world with one box, and the folder of its material scripts."""
    more = "<material><script><uri>file://scripts</uri><name>A</name></script></material>"
    src = write_world(tmp_path / "in" / "w.world", box("a", more=more))
    (src.parent / "scripts").mkdir()
    return src, src.parent / "scripts"


def test_a_fifo_for_a_material_script_is_not_waited_for(tmp_path):
    src, scripts = _scripted(tmp_path)
    os.mkfifo(scripts / "a.material")
    (scripts / "b.material").symlink_to("/dev/zero")
    _, said = read_parts(src)
    assert any("a.material" in sentence and "no regular file" in sentence for sentence in said)
    assert any("b.material" in sentence for sentence in said)


@pytest.mark.timeout(20)
@pytest.mark.parametrize(
    "text", ["material A {\n" * 100_000, "/* " * 300_000, "material " + ":" * 300_000, "{" * 10**6]
)
def test_an_endless_material_script_is_read_in_one_pass(text):
    assert all(found.diffuse is None for found in read_script(text).values())


def test_a_material_that_is_not_closed_ends_where_the_next_begins():
    script = (
        "material A { pass { diffuse 1 0 0\nmaterial B:A{ }\nmaterial C { diffuse 1 . . } material D { diffuse 9 1 0 }"
    )
    found = read_script(script)
    assert {name: material.diffuse for name, material in found.items()} == {
        "A": (1, 0, 0),
        "B:A": None,
        "C": None,
        "D": (1, 1, 0),
    }


@pytest.mark.parametrize(
    "shape",
    [
        "<capsule><radius>0</radius><length>0</length></capsule>",
        "<sphere><radius>-1</radius></sphere>",
        "<cylinder><radius>0</radius></cylinder>",
        "<polyline><point>0 0</point><point>1 0</point><point>0 1</point><height>0</height></polyline>",
    ],
)
def test_a_shape_without_size_is_left_out_and_said(tmp_path, shape):
    hollow = f"<model name='n'><link name='l'><visual name='v'><geometry>{shape}</geometry></visual></link></model>"
    parts, said = read_parts(write_world(tmp_path / "w.sdf", box("a") + hollow))
    assert len(parts) == 1
    assert said == [f"Left out, because such shapes cannot be imported: <{shape[1:].partition('>')[0]}> of n_v."]


def test_a_chain_of_thousands_of_frames_is_followed(tmp_path):
    pose = "<pose>0 0 0.001 0 0 0</pose>"
    frames = "".join(f"<frame name='f{i}' attached_to='f{i + 1}'>{pose}</frame>" for i in range(3000))
    on_chain = box("b", "<pose relative_to='f0'>0 0 0 0 0 0</pose>", "1 1 1")
    (part,), _ = read_parts(write_world(tmp_path / "w.sdf", frames + "<frame name='f3000'/>" + on_chain))
    assert np.allclose(part.vertices_m.mean(axis=0), [0, 0, 3])


@pytest.mark.parametrize(
    "content",
    [
        _mesh("x" * 5000),
        _mesh("model://" + "x" * 5000),
        _mesh("https://fuel/1.0/o/models/" + "x" * 5000),
        _mesh("https://fuel/1.0/o/models/%2Fetc"),
        _mesh("https://[/models/a"),
        f"<include><uri>{'x' * 5000}</uri></include>",
        box("b", more=f"<material><script><uri>{'x' * 5000}</uri><name>A</name></script></material>"),
    ],
    ids=range(7),
)
def test_names_that_no_file_can_have_are_not_found(tmp_path, content):
    _, said = read_parts(write_world(tmp_path / "w.sdf", box("a") + content))
    assert said[0].startswith("Not found")


@pytest.mark.parametrize(
    "config",
    [
        "<?xml version='1.0' encoding='x-foo'?><model/>",
        f"<model><sdf version='{'9' * 5000}'>gone.sdf</sdf></model>",
        f"<model><sdf version='1'>{'x' * 5000}</sdf></model>",
        "<model>",
    ],
    ids=range(4),
)
def test_a_model_whose_configuration_is_damaged_is_read_from_its_usual_file(tmp_path, config):
    write_model(tmp_path / "models", "thing", box("b"))
    (tmp_path / "models" / "thing" / "model.config").write_text(config)
    parts, _ = read_parts(write_world(tmp_path / "w.sdf", "<include><uri>model://thing</uri></include>"))
    assert len(parts) == 1


def test_a_mesh_without_area_is_named_also_beside_others_of_its_colour(tmp_path, caplog):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    flat = "<model name='m'><link name='l'><visual name='v'><geometry><mesh><uri>a.obj</uri><scale>{}</scale></mesh>"
    flat += "</geometry></visual></link></model>"
    src = write_world(tmp_path / "a.world", GROUND + ROOM + flat.format("1 1 1") + flat.format("0 0 0"))
    import_scene(src, tmp_path / "out")
    assert "Left out, because none of their triangles has an area: a.obj." in caplog.text


def test_a_rotation_of_another_format_is_refused(tmp_path):
    src = write_world(tmp_path / "a.world", box("a", "<pose rotation_format='axis'>0 0 0 1 0 0 0</pose>"))
    with pytest.raises(SceneError, match="rotation_format 'axis'"):
        read_parts(src)
