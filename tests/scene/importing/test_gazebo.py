import math
import os
import tomllib

import numpy as np
import pytest
import trimesh

from anm_mj.errors import SceneError
from anm_mj.scene.importing.import_scene import import_scene
from anm_mj.scene.importing.readers.formats import find_format
from anm_mj.scene.importing.readers.gazebo import read_gazebo
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.sdf_material import read_script
from anm_mj.scene.submesh import merge_geometry
from tests.scene.furnished import looks_at_the_poster, picture, poster
from tests.scene.view import look

WALLS = {"a": (-0.05, 2, 0.1, 4), "b": (6.05, 2, 0.1, 4), "c": (3, -0.05, 6, 0.1), "d": (3, 4.05, 6, 0.1)}
GROUND = (
    "<model name='ground'><link name='l'><visual name='v'><geometry><plane><size>100 100</size></plane></geometry>"
    "<material><diffuse>0 0.5 0 1</diffuse></material></visual></link></model>"
)
ROOM = "".join(
    f"<model name='wall_{name}'><pose>{x} {y} 0 0 0 0</pose><link name='l'><visual name='v'><pose>0 0 1.25 0 0 0</pose>"
    f"<geometry><box><size>{sx} {sy} 2.5</size></box></geometry></visual></link></model>"
    for name, (x, y, sx, sy) in WALLS.items()
)


def _world(path, content: str, version: str = "1.9"):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"<?xml version='1.0'?><sdf version='{version}'><world name='w'>{content}</world></sdf>")
    return path


def _box(name: str, pose: str = "", size: str = "1 2 3", more: str = "") -> str:
    return (
        f"<model name='{name}'>{pose}<link name='l'><visual name='v'><geometry><box><size>{size}</size></box>"
        f"</geometry>{more}</visual></link></model>"
    )


def _model(folder, name: str, content: str, files: dict[str, bytes] | None = None):
    (folder / name).mkdir(parents=True)
    (folder / name / "model.config").write_text("<model><sdf version='1.6'>model.sdf</sdf></model>")
    (folder / name / "model.sdf").write_text(f"<sdf version='1.6'><model name='{name}'>{content}</model></sdf>")
    for file, data in (files or {}).items():
        (folder / name / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / name / file).write_bytes(data)


def _read(src, *model_paths):
    report = ImportReport()
    return read_gazebo(src, list(model_paths), report).submeshes, report.sentences()


def _bounds(parts):
    vertices, faces = merge_geometry(parts)
    used = vertices[faces].reshape(-1, 3)
    return np.stack([used.min(axis=0), used.max(axis=0)])


def test_a_room_of_boxes_on_a_ground_plane_becomes_a_scene(tmp_path):
    src = _world(tmp_path / "room.world", GROUND + ROOM)
    assert find_format(src).name == "gazebo"
    scene = import_scene(src, tmp_path / "out")
    # The plane of 100 m is cut to the building on it.
    assert np.allclose(scene.bounds_m, [[-0.1, -0.1, 0.0], [6.1, 4.1, 2.5]], atol=1e-4)
    assert "Gazebo world room.world" in scene.source
    seen = look(scene, (3.0, 2.0, 0.5), (1.0, 0.0, 0.0))
    assert np.abs(seen[60, 32].astype(int) - (0, 128, 0)).max() <= 2
    assert (seen[25, 32] == 178).all()


def test_poses_are_nested_and_angles_are_roll_pitch_yaw(tmp_path):
    pose = f"<pose>10 0 0 0 0 {math.pi / 2}</pose>"
    inner = "<pose>1 0 0 0 0 0</pose><link name='l'><pose>0 1 0 0 0 0</pose><visual name='v'><pose>0 0 5 0 0 0</pose>"
    shape = "<geometry><box><size>2 1 1</size></box></geometry></visual></link>"
    src = _world(tmp_path / "w.sdf", f"<model name='a'>{pose}<model name='b'>{inner}{shape}</model></model>")
    parts, _ = _read(src)
    # (1, 1, 5) turned left by 90 degrees about z, then moved by 10 m; the box lies along y now.
    assert np.allclose(_bounds(parts), [[8.5, 0.0, 4.5], [9.5, 2.0, 5.5]])


@pytest.mark.parametrize(
    ("pose", "bounds"),
    [
        ("<pose degrees='true'>0 0 0 0 90 0</pose>", [[-1.5, -1, -0.5], [1.5, 1, 0.5]]),
        ("<pose rotation_format='quat_xyzw'>0 0 1 0 0 0.70710678 0.70710678</pose>", [[-1, -0.5, -0.5], [1, 0.5, 2.5]]),
        ("<pose>0 0 0 1.57079633 0 0</pose>", [[-0.5, -1.5, -1], [0.5, 1.5, 1]]),
        ("<pose></pose>", [[-0.5, -1, -1.5], [0.5, 1, 1.5]]),
    ],
)
def test_all_ways_to_write_a_pose_are_read(tmp_path, pose, bounds):
    parts, _ = _read(_world(tmp_path / "w.sdf", _box("a", pose)))
    assert np.allclose(_bounds(parts), bounds, atol=1e-6)


def test_a_pose_may_be_relative_to_any_frame(tmp_path):
    frames = (
        "<frame name='corner'><pose>5 0 0 0 0 0</pose></frame>"
        "<frame name='edge' attached_to='corner'><pose>0 5 0 0 0 0</pose></frame>"
    )
    boxes = (
        _box("on_edge", "<pose relative_to='edge'>0 0 1 0 0 0</pose>", "1 1 1")
        + _box("on_link", "<pose relative_to='on_edge::l'>0 0 1 0 0 0</pose>", "1 1 1")
        + "<model name='placed' placement_frame='far'><pose>-5 0 0 0 0 0</pose><link name='l'><visual name='v'>"
        "<geometry><box><size>1 1 1</size></box></geometry></visual></link>"
        "<link name='far'><pose>0 0 -7 0 0 0</pose></link></model>"
    )
    parts, _ = _read(_world(tmp_path / "w.sdf", frames + boxes))
    centres = [part.vertices_m.mean(axis=0) for part in parts]
    assert np.allclose(centres, [[5, 5, 1], [5, 5, 2], [-5, 0, 7]])


def test_the_saved_state_of_a_world_goes_before_its_poses(tmp_path):
    state = (
        "<state world_name='w'><model name='a'><pose>3 0 0 0 0 0</pose><link name='l'><pose>3 0 1 0 0 0</pose></link>"
        "</model><model name='b'><pose>0 0 -7.6e8 0 0 0</pose></model>"
        f"<insertions>{_box('late', '<pose>0 9 0 0 0 0</pose>', '1 1 1')}</insertions></state>"
    )
    parts, said = _read(_world(tmp_path / "w.world", _box("a", size="1 1 1") + _box("b") + state))
    assert np.allclose([part.vertices_m.mean(axis=0) for part in parts], [[3, 0, 1], [0, 9, 0]])
    assert said == ["Left out, because they lie more than 1 km away: b."]


@pytest.mark.parametrize(
    ("shape", "bounds", "volume"),
    [
        ("<sphere><radius>2</radius></sphere>", [[-2, -2, -2], [2, 2, 2]], 4 / 3 * math.pi * 8),
        ("<cylinder><radius>1</radius><length>4</length></cylinder>", [[-1, -1, -2], [1, 1, 2]], math.pi * 4),
        ("<capsule><radius>1</radius><length>4</length></capsule>", [[-1, -1, -3], [1, 1, 3]], math.pi * (4 + 4 / 3)),
        ("<cone><radius>1</radius><length>3</length></cone>", [[-1, -1, -1.5], [1, 1, 1.5]], math.pi),
        ("<ellipsoid><radii>1 2 3</radii></ellipsoid>", [[-1, -2, -3], [1, 2, 3]], 4 / 3 * math.pi * 6),
        ("<box><size>1 2 3</size></box>", [[-0.5, -1, -1.5], [0.5, 1, 1.5]], 6.0),
        (
            "<polyline><height>2</height><point>0 0</point><point>3 0</point><point>0 3</point></polyline>",
            [[0, 0, 0], [3, 3, 2]],
            9.0,
        ),
    ],
)
def test_simple_shapes_have_their_size_and_face_outwards(tmp_path, shape, bounds, volume):
    content = f"<model name='a'><link name='l'><visual name='v'><geometry>{shape}</geometry></visual></link></model>"
    (part,), said = _read(_world(tmp_path / "w.sdf", content))
    mesh = trimesh.Trimesh(part.vertices_m, part.faces)
    assert not said
    assert np.allclose(_bounds([part]), bounds, atol=0.02)
    assert mesh.volume == pytest.approx(volume, rel=0.03)


def _poster_files() -> dict[str, bytes]:
    """The poster's mesh as COLLADA in inches, about the middle of its lower edge, and its picture."""
    mesh = poster()
    mesh.apply_translation([-3.0, -3.99, -0.5])
    mesh.apply_scale(1 / 0.0254)
    mesh.visual.material = trimesh.visual.material.SimpleMaterial(diffuse=[255, 255, 255, 255])
    text = trimesh.exchange.dae.export_collada(mesh).decode()
    text = text.replace("<up_axis>Y_UP", '<unit name="inch" meter="0.0254"/><up_axis>Y_UP')
    corner = "\n".join(f"v {x} {y} {z}" for x, y, z in mesh.vertices)
    obj = f"mtllib p.mtl\n{corner}\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl p\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"
    return {"meshes/p.dae": text.encode(), "meshes/p.obj": obj.encode(), "meshes/p.mtl": b"newmtl p\nmap_Kd p.png\n"}


def _with_picture(folder):
    folder.mkdir(parents=True, exist_ok=True)
    picture().save(folder / "p.png")


@pytest.mark.parametrize("how", ["uri", "relative", "environment", "fuel", "given"])
def test_an_included_model_is_found_named_and_placed(tmp_path, monkeypatch, how):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    visual = (
        "<pose>9 9 9 0 0 0</pose><link name='l'><visual name='v'><geometry><mesh><uri>{uri}</uri>"
        "<scale>0.0254 0.0254 0.0254</scale></mesh></geometry></visual></link>"
    )
    models = tmp_path / ("models" if how in ("uri", "relative") else "elsewhere")
    if how == "fuel":
        models = tmp_path / "home" / ".gz" / "fuel" / "fuel.gazebosim.org" / "owner" / "models"
    mesh = (
        "https://fuel.gazebosim.org/1.0/Owner/models/Poster/2/files/meshes/p.obj" if how == "fuel" else "meshes/p.obj"
    )
    name = "poster/2" if how == "fuel" else "poster"
    _model(models, name, visual.format(uri="model://poster/meshes/p.obj" if how == "uri" else mesh), _poster_files())
    _with_picture(models / name / "materials" / "textures")
    if how == "environment":
        monkeypatch.setenv("GZ_SIM_RESOURCE_PATH", f"{tmp_path / 'nowhere'}:{models}")
    uri = {"relative": "../../models/poster", "fuel": "https://fuel.gazebosim.org/1.0/Owner/models/Poster"}
    include = (
        f"<include><uri>{uri.get(how, 'model://poster')}</uri><name>p</name><pose>3 3.99 0.5 0 0 0</pose></include>"
    )
    src = _world(tmp_path / "pkg" / "worlds" / "w.world", GROUND + ROOM + include)
    scene = import_scene(src, tmp_path / "out", model_paths=[models] if how == "given" else [])
    assert looks_at_the_poster(scene)


def test_the_unit_of_a_collada_mesh_counts_and_its_up_axis_does_not(tmp_path):
    content = (
        "<link name='l'><visual name='v'><geometry><mesh><uri>meshes/p.dae</uri></mesh></geometry></visual></link>"
    )
    _model(tmp_path / "models", "poster", content, _poster_files())
    src = _world(tmp_path / "worlds" / "w.world", "<include><uri>model://poster</uri></include>")
    parts, said = _read(src)
    assert not said
    assert np.allclose(_bounds(parts), [[-1, 0, 0], [1, 0, 2]], atol=1e-4)


def test_materials_give_colours_and_textures(tmp_path):
    def coloured(name, material):
        return _box(name, more=f"<material>{material}</material>")

    script = "<script><uri>model://look/materials/scripts</uri><name>{}</name></script>"
    material = b"""material Own/Plain // a comment
    { technique { pass { diffuse 0.25 0.5 0.75 1 } } }
    material Own/Picture : Own/Plain { technique { pass { texture_unit { texture p.png
      scale 0.5 0.25 } } } }"""
    files = {"materials/scripts/own.material": material}
    _model(tmp_path / "models", "look", "", files)
    _with_picture(tmp_path / "models" / "look" / "materials" / "textures")
    content = (
        coloured("a", "<ambient>1 0 0 1</ambient><diffuse>0 1 0 1</diffuse>")
        + coloured("b", "<ambient>1 0 0 1</ambient>")
        + coloured("c", "<script><name>Gazebo/BlueGlow</name></script>")
        + coloured("d", script.format("Own/Plain"))
        + coloured("e", script.format("Own/Picture"))
        + coloured("f", "<pbr><metal><albedo_map>model://look/materials/textures/p.png</albedo_map></metal></pbr>")
        + coloured("g", script.format("Own/Gone"))
        + _box("h", more="<transparency>1</transparency>")
    )
    parts, said = _read(_world(tmp_path / "worlds" / "w.sdf", content))
    assert [part.rgb for part in parts] == [
        (0, 1, 0),
        (1, 0, 0),
        (0, 0, 1),
        (0.25, 0.5, 0.75),
        (1, 1, 1),
        (1, 1, 1),
        (0.7, 0.7, 0.7),
    ]
    for part, repeats in ((parts[4], (2.0, 4.0)), (parts[5], (1.0, 1.0))):
        assert part.texture is not None
        assert part.uv is not None
        assert np.allclose(part.uv.max(axis=0), repeats)
    assert parts[4].texture is parts[5].texture
    assert said == ["Not found: the materials Own/Gone; what is made of them comes out grey."]


def test_a_texture_on_a_box_stands_upright_on_every_wall(tmp_path):
    _with_picture(tmp_path)
    material = "<material><pbr><metal><albedo_map>p.png</albedo_map></metal></pbr></material>"
    easel = _box("easel", "<pose>3 3.95 1.5 0 0 0</pose>", "2 0.08 2", material)
    scene = import_scene(_world(tmp_path / "w.sdf", GROUND + ROOM + easel), tmp_path / "out")
    assert looks_at_the_poster(scene)


def test_what_is_missing_is_said_once_and_left_out(tmp_path):
    mesh = "<geometry><mesh><uri>model://dog/dog.obj</uri></mesh></geometry>"
    dogs = "".join(
        f"<model name='dog{i}'><link name='l'><visual name='v'>{mesh}</visual></link></model>" for i in range(3)
    )
    cats = "<include><uri>model://cat</uri></include>" * 2 + "<include><uri>model://sun</uri></include>"
    odd = "<model name='hill'><link name='l'><visual name='v'><geometry><heightmap/></geometry></visual></link></model>"
    src = _world(tmp_path / "w.sdf", GROUND + ROOM + dogs + cats + odd + "<actor name='walker'/>")
    parts, said = _read(src)
    assert len(parts) == 5
    assert len(said) == 3
    assert said[0].startswith("Not found: the models cat, which are left out; give the folders")
    assert "Not found: the meshes dog/dog.obj, which are left out." in said
    assert "Left out, because such shapes cannot be imported: <heightmap> of hill_v, <actor> walker." in said


def test_the_ground_is_left_out_of_the_way_of_a_floor(tmp_path):
    tiles = _box("tiles", "<pose>3 2 -0.05 0 0 0</pose>", "6.2 4.2 0.1")
    parts, _ = _read(_world(tmp_path / "w.sdf", "<include><uri>model://ground_plane</uri></include>" + ROOM + tiles))
    assert np.allclose(parts[-1].vertices_m[:, 2], -0.02)


_NOTHING = (
    '<model name="a"><link name="l"><visual name="v"><geometry>'
    "<box><size>0 0 0</size></box></geometry></visual></link></model>"
)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("<sdf version='1.6'><world>", "damaged"),
        ("<robot name='r'/>", "no SDF"),
        ("<sdf version='1.6'><world name='w'/></sdf>", "nothing that can be drawn"),
        ("<sdf version='1.6'>" + _box("a", "<pose>1 2</pose>") + "</sdf>", "6 numbers"),
        ("<sdf version='1.6'>" + _box("a", "<pose relative_to='b'>0 0 0 0 0 0</pose>") + "</sdf>", "'b', which is not"),
        ("<sdf version='1.6'>" + _box("a", "<pose relative_to='a'>0 0 0 0 0 0</pose>") + "</sdf>", "in a circle"),
        ("<sdf version='1.6'>" + _box("a", size="1 two 3") + "</sdf>", "3 numbers"),
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
    _model(tmp_path / "models", "snake", "<include><uri>model://snake</uri></include>")
    src = _world(tmp_path / "worlds" / "w.world", "<include><uri>model://snake</uri></include>")
    with pytest.raises(SceneError, match="include itself"):
        import_scene(src, tmp_path / "out")


def test_a_world_that_includes_itself_is_refused(tmp_path):
    content = GROUND + ROOM + "<include><uri>w.world</uri></include>"
    src = _world(tmp_path / "w.world", content)
    with pytest.raises(SceneError, match="includes itself"):
        import_scene(src, tmp_path / "out")


def test_models_that_a_saved_state_has_deleted_are_left_out(tmp_path):
    deleted = "<state world_name='w'><deletions><name>gone</name></deletions></state>"
    kept = _box("kept", "<pose>5 0 0 0 0 0</pose>")
    parts, _ = _read(_world(tmp_path / "w.world", _box("gone") + kept + deleted))
    assert np.allclose([part.vertices_m.mean(axis=0) for part in parts], [[5, 0, 0]])


@pytest.mark.parametrize("name", ["gone", "x" * 5000])
def test_a_model_path_that_is_no_folder_is_refused(tmp_path, name):
    src = _world(tmp_path / "w.world", GROUND + ROOM)
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
    src = _world(tmp_path / "a" / "b" / "c" / "d" / "w.world", _box("a") + _mesh(where.format(tmp_path)))
    (src.parent / "link.obj").symlink_to(tmp_path / "secret.obj")
    parts, said = _read(src)
    assert len(parts) == 1
    assert said[0].startswith("Not read, because they lie elsewhere")
    assert "secret.obj" in said[0] or "link.obj" in said[0]
    # The folder that the user gives is one that may be read.
    assert len(_read(src, tmp_path)[0]) == 2


def test_a_mesh_up_to_three_folders_above_is_read(tmp_path):
    (tmp_path / "a").mkdir()
    trimesh.creation.box().export(tmp_path / "a" / "near.obj")
    parts, said = _read(_world(tmp_path / "a" / "b" / "c" / "d" / "w.world", _mesh("../../../near.obj")))
    assert len(parts) == 1
    assert not said


def test_a_texture_or_model_from_elsewhere_is_not_read(tmp_path):
    _with_picture(tmp_path)
    _model(tmp_path, "far", _box("b"))
    map_ = f"<material><pbr><metal><albedo_map>file://{tmp_path}/p.png</albedo_map></metal></pbr></material>"
    # The configuration of a model names no file elsewhere, either.
    near = tmp_path / "a" / "b" / "c" / "d"
    (near / "near").mkdir(parents=True)
    (near / "near" / "model.config").write_text("<model><sdf>../../../../../far/model.sdf</sdf></model>")
    includes = f"<include><uri>file://{tmp_path}/far</uri></include><include><uri>near</uri></include>"
    parts, said = _read(_world(near / "w.world", _box("a", more=map_) + includes))
    assert [part.texture for part in parts] == [None]
    assert said[0].startswith("Not read, because they lie elsewhere")
    assert f"{tmp_path}/p.png" in said[0] or f"{tmp_path}/far" in said[0]


def _scripted(tmp_path):
    """A world with one box, and the folder of its material scripts."""
    more = "<material><script><uri>file://scripts</uri><name>A</name></script></material>"
    src = _world(tmp_path / "in" / "w.world", _box("a", more=more))
    (src.parent / "scripts").mkdir()
    return src, src.parent / "scripts"


def test_a_fifo_for_a_material_script_is_not_waited_for(tmp_path):
    src, scripts = _scripted(tmp_path)
    os.mkfifo(scripts / "a.material")
    (scripts / "b.material").symlink_to("/dev/zero")
    _, said = _read(src)
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
    parts, said = _read(_world(tmp_path / "w.sdf", _box("a") + hollow))
    assert len(parts) == 1
    assert said == [f"Left out, because such shapes cannot be imported: <{shape[1:].partition('>')[0]}> of n_v."]


def test_all_outlines_of_a_polyline_count_and_the_inner_is_a_hole(tmp_path):
    def outline(x, y, side):
        corners = ((x, y), (x + side, y), (x + side, y + side), (x, y + side))
        return f"<polyline><height>2</height>{''.join(f'<point>{a} {b}</point>' for a, b in corners)}</polyline>"

    shapes = outline(0, 0, 4) + outline(1, 1, 2) + outline(9, 0, 1)
    content = f"<model name='a'><link name='l'><visual name='v'><geometry>{shapes}</geometry></visual></link></model>"
    (part,), said = _read(_world(tmp_path / "w.sdf", content))
    assert not said
    assert np.allclose(_bounds([part]), [[0, 0, 0], [10, 4, 2]])
    assert trimesh.Trimesh(part.vertices_m, part.faces).volume == pytest.approx(2 * (16 - 4 + 1))


def test_a_chain_of_thousands_of_frames_is_followed(tmp_path):
    pose = "<pose>0 0 0.001 0 0 0</pose>"
    frames = "".join(f"<frame name='f{i}' attached_to='f{i + 1}'>{pose}</frame>" for i in range(3000))
    on_chain = _box("b", "<pose relative_to='f0'>0 0 0 0 0 0</pose>", "1 1 1")
    (part,), _ = _read(_world(tmp_path / "w.sdf", frames + "<frame name='f3000'/>" + on_chain))
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
        _box("b", more=f"<material><script><uri>{'x' * 5000}</uri><name>A</name></script></material>"),
    ],
    ids=range(7),
)
def test_names_that_no_file_can_have_are_not_found(tmp_path, content):
    _, said = _read(_world(tmp_path / "w.sdf", _box("a") + content))
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
    _model(tmp_path / "models", "thing", _box("b"))
    (tmp_path / "models" / "thing" / "model.config").write_text(config)
    parts, _ = _read(_world(tmp_path / "w.sdf", "<include><uri>model://thing</uri></include>"))
    assert len(parts) == 1


def test_a_real_apartment_looks_as_the_same_apartment_in_one_file(dev_scenes, tmp_path, caplog):
    world = dev_scenes / "gazebo_small_apartment" / "src" / "self_drive_sim" / "worlds" / "map1.world"
    if not world.is_file():
        pytest.skip("no Gazebo world beside the scenes")
    ours = import_scene(world, tmp_path / "world")
    said = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert [("Dog/meshes/model.obj" in sentence, "foldable_chair.png" in sentence) for sentence in said] == [
        (True, False),
        (False, True),
    ]
    theirs = import_scene(dev_scenes / "small_apartment.glb", tmp_path / "glb")
    assert np.allclose(ours.bounds_m, theirs.bounds_m, atol=1e-3)
    assert tomllib.loads((ours.folder / "scene.toml").read_text())["floor_removed"] == 0.0
    for x, y in ((0.05, -0.33), (4.3, 3.2), (-3.2, 3.7)):
        for right in ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0)):
            mine, other = (look(scene, (x, y, 1.25), right, depth=True) for scene in (ours, theirs))
            # Another tessellation of round legs, at most.
            assert np.mean(np.abs(mine - other) > 0.02) < 0.01


def test_what_a_world_says_beside_its_models_is_said_to_be_left_out(tmp_path):
    (tmp_path / "robot.urdf").write_text("<robot name='r'/>")
    (tmp_path / "sun.sdf").write_text("<sdf version='1.9'><light name='l'/></sdf>")
    includes = "".join(f"<include><uri>{name}</uri></include>" for name in ("robot.urdf", "sun.sdf"))
    src = _world(tmp_path / "a.world", GROUND + ROOM + includes + _box("inside_out", size="1 -1 1"))
    src.write_text(src.read_text().replace("</sdf>", "<world name='other'/></sdf>"))
    _, said = _read(src)
    assert said == [
        "Of several worlds the first is taken; left out: other.",
        "Left out, because such shapes cannot be imported: <robot> of robot.urdf, <box> of inside_out_v.",
    ]


def test_a_mesh_without_area_is_named_also_beside_others_of_its_colour(tmp_path, caplog):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    flat = "<model name='m'><link name='l'><visual name='v'><geometry><mesh><uri>a.obj</uri><scale>{}</scale></mesh>"
    flat += "</geometry></visual></link></model>"
    src = _world(tmp_path / "a.world", GROUND + ROOM + flat.format("1 1 1") + flat.format("0 0 0"))
    import_scene(src, tmp_path / "out")
    assert "Left out, because none of their triangles has an area: a.obj." in caplog.text


def test_a_rotation_of_another_format_is_refused(tmp_path):
    src = _world(tmp_path / "a.world", _box("a", "<pose rotation_format='axis'>0 0 0 1 0 0 0</pose>"))
    with pytest.raises(SceneError, match="rotation_format 'axis'"):
        _read(src)
