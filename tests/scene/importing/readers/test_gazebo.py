import math
import re
import sys
import tomllib
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from anm_mj.errors import SceneError
from anm_mj.scene.importing.import_scene import import_scene
from anm_mj.scene.importing.readers.gazebo import read_gazebo
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.source_formats import find_format
from tests.scene.furnished import looks_at_the_poster, poster
from tests.scene.importing.readers.gazebo_worlds import (
    GROUND,
    ROOM,
    bounds_of,
    box,
    read_parts,
    write_model,
    write_picture,
    write_world,
)
from tests.scene.view import is_shade_of, look


def test_a_room_of_boxes_on_a_ground_plane_becomes_a_scene(tmp_path):
    src = write_world(tmp_path / "room.world", GROUND + ROOM)
    assert find_format(src).name == "gazebo"
    scene = import_scene(src, tmp_path / "out")
    # The plane of 100 m is cut to the building on it.
    assert np.allclose(scene.bounds_m, [[-0.1, -0.1, 0.0], [6.1, 4.1, 2.5]], atol=1e-4)
    assert "Gazebo world room.world" in scene.source
    seen = look(scene, (3.0, 2.0, 0.5), (1.0, 0.0, 0.0))
    assert is_shade_of(seen[60, 32], (0, 128, 0))
    assert is_shade_of(seen[25, 32], (178, 178, 178))


def test_poses_are_nested_and_angles_are_roll_pitch_yaw(tmp_path):
    pose = f"<pose>10 0 0 0 0 {math.pi / 2}</pose>"
    inner = "<pose>1 0 0 0 0 0</pose><link name='l'><pose>0 1 0 0 0 0</pose><visual name='v'><pose>0 0 5 0 0 0</pose>"
    shape = "<geometry><box><size>2 1 1</size></box></geometry></visual></link>"
    src = write_world(tmp_path / "w.sdf", f"<model name='a'>{pose}<model name='b'>{inner}{shape}</model></model>")
    parts, _ = read_parts(src)
    # (1, 1, 5) turned left by 90 degrees about z, then moved by 10 m; the box lies along y now.
    assert np.allclose(bounds_of(parts), [[8.5, 0.0, 4.5], [9.5, 2.0, 5.5]])


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
    parts, _ = read_parts(write_world(tmp_path / "w.sdf", box("a", pose)))
    assert np.allclose(bounds_of(parts), bounds, atol=1e-6)


def test_a_pose_may_be_relative_to_any_frame(tmp_path):
    frames = (
        "<frame name='corner'><pose>5 0 0 0 0 0</pose></frame>"
        "<frame name='edge' attached_to='corner'><pose>0 5 0 0 0 0</pose></frame>"
    )
    boxes = (
        box("on_edge", "<pose relative_to='edge'>0 0 1 0 0 0</pose>", "1 1 1")
        + box("on_link", "<pose relative_to='on_edge::l'>0 0 1 0 0 0</pose>", "1 1 1")
        + "<model name='placed' placement_frame='far'><pose>-5 0 0 0 0 0</pose><link name='l'><visual name='v'>"
        "<geometry><box><size>1 1 1</size></box></geometry></visual></link>"
        "<link name='far'><pose>0 0 -7 0 0 0</pose></link></model>"
    )
    parts, _ = read_parts(write_world(tmp_path / "w.sdf", frames + boxes))
    centres = [part.vertices_m.mean(axis=0) for part in parts]
    assert np.allclose(centres, [[5, 5, 1], [5, 5, 2], [-5, 0, 7]])


def test_the_saved_state_of_a_world_goes_before_its_poses(tmp_path):
    state = (
        "<state world_name='w'><model name='a'><pose>3 0 0 0 0 0</pose><link name='l'><pose>3 0 1 0 0 0</pose></link>"
        "</model><model name='b'><pose>0 0 -7.6e8 0 0 0</pose></model>"
        f"<insertions>{box('late', '<pose>0 9 0 0 0 0</pose>', '1 1 1')}</insertions></state>"
    )
    parts, said = read_parts(write_world(tmp_path / "w.world", box("a", size="1 1 1") + box("b") + state))
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
    (part,), said = read_parts(write_world(tmp_path / "w.sdf", content))
    mesh = trimesh.Trimesh(part.vertices_m, part.faces)
    assert not said
    assert np.allclose(bounds_of([part]), bounds, atol=0.02)
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
    write_model(
        models, name, visual.format(uri="model://poster/meshes/p.obj" if how == "uri" else mesh), _poster_files()
    )
    write_picture(models / name / "materials" / "textures")
    if how == "environment":
        monkeypatch.setenv("GZ_SIM_RESOURCE_PATH", f"{tmp_path / 'nowhere'}:{models}")
    uri = {"relative": "../../models/poster", "fuel": "https://fuel.gazebosim.org/1.0/Owner/models/Poster"}
    include = (
        f"<include><uri>{uri.get(how, 'model://poster')}</uri><name>p</name><pose>3 3.99 0.5 0 0 0</pose></include>"
    )
    src = write_world(tmp_path / "pkg" / "worlds" / "w.world", GROUND + ROOM + include)
    scene = import_scene(src, tmp_path / "out", model_paths=[models] if how == "given" else [])
    assert looks_at_the_poster(scene)


def test_the_unit_of_a_collada_mesh_counts_and_its_up_axis_does_not(tmp_path):
    content = (
        "<link name='l'><visual name='v'><geometry><mesh><uri>meshes/p.dae</uri></mesh></geometry></visual></link>"
    )
    write_model(tmp_path / "models", "poster", content, _poster_files())
    src = write_world(tmp_path / "worlds" / "w.world", "<include><uri>model://poster</uri></include>")
    parts, said = read_parts(src)
    assert said == ["No floor lies below what stands in w.world: the file's own z = 0 is taken for the ground."]
    assert np.allclose(bounds_of(parts), [[-1, 0, 0], [1, 0, 2]], atol=1e-4)


def test_materials_give_colours_and_textures(tmp_path):
    def coloured(name, material):
        return box(name, more=f"<material>{material}</material>")

    script = "<script><uri>model://look/materials/scripts</uri><name>{}</name></script>"
    material = b"""material Own/Plain // a comment
    { technique { pass { diffuse 0.25 0.5 0.75 1 } } }
    material Own/Picture : Own/Plain { technique { pass { texture_unit { texture p.png
      scale 0.5 0.25 } } } }"""
    files = {"materials/scripts/own.material": material}
    write_model(tmp_path / "models", "look", "", files)
    write_picture(tmp_path / "models" / "look" / "materials" / "textures")
    content = (
        coloured("a", "<ambient>1 0 0 1</ambient><diffuse>0 1 0 1</diffuse>")
        + coloured("b", "<ambient>1 0 0 1</ambient>")
        + coloured("c", "<script><name>Gazebo/BlueGlow</name></script>")
        + coloured("d", script.format("Own/Plain"))
        + coloured("e", script.format("Own/Picture"))
        + coloured("f", "<pbr><metal><albedo_map>model://look/materials/textures/p.png</albedo_map></metal></pbr>")
        + coloured("g", script.format("Own/Gone"))
        + box("h", more="<transparency>1</transparency>")
    )
    parts, said = read_parts(write_world(tmp_path / "worlds" / "w.sdf", content))
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
    write_picture(tmp_path)
    material = "<material><pbr><metal><albedo_map>p.png</albedo_map></metal></pbr></material>"
    easel = box("easel", "<pose>3 3.95 1.5 0 0 0</pose>", "2 0.08 2", material)
    scene = import_scene(write_world(tmp_path / "w.sdf", GROUND + ROOM + easel), tmp_path / "out")
    assert looks_at_the_poster(scene)


def test_the_ground_is_left_out_of_the_way_of_a_floor(tmp_path):
    tiles = box("tiles", "<pose>3 2 -0.05 0 0 0</pose>", "6.2 4.2 0.1")
    parts, _ = read_parts(
        write_world(tmp_path / "w.sdf", "<include><uri>model://ground_plane</uri></include>" + ROOM + tiles)
    )
    assert np.allclose(parts[-1].vertices_m[:, 2], -0.02)


def test_models_that_a_saved_state_has_deleted_are_left_out_and_stay_frames_of_others(tmp_path):
    write_model(tmp_path / "models", "thing", "<link name='l'/>" + box("inner"))
    included = "<include><uri>model://thing</uri><name>also_gone</name></include>"
    deleted = (
        "<state world_name='w'><model name='gone'><scale>2 2 2</scale></model>"
        "<deletions><name>gone</name><name>also_gone</name></deletions></state>"
    )
    kept = box("kept", "<pose relative_to='gone'>5 0 0 0 0 0</pose>")
    src = write_world(tmp_path / "w.world", box("gone", "<pose>0 1 0 0 0 0</pose>") + included + kept + deleted)
    parts, said = read_parts(src)
    assert np.allclose([part.vertices_m.mean(axis=0) for part in parts], [[5, 1, 0]])
    assert not said


def test_all_outlines_of_a_polyline_count_and_the_inner_is_a_hole(tmp_path):
    def outline(x, y, side):
        corners = ((x, y), (x + side, y), (x + side, y + side), (x, y + side))
        return f"<polyline><height>2</height>{''.join(f'<point>{a} {b}</point>' for a, b in corners)}</polyline>"

    shapes = outline(0, 0, 4) + outline(1, 1, 2) + outline(9, 0, 1)
    content = f"<model name='a'><link name='l'><visual name='v'><geometry>{shapes}</geometry></visual></link></model>"
    (part,), said = read_parts(write_world(tmp_path / "w.sdf", content))
    assert not said
    assert np.allclose(bounds_of([part]), [[0, 0, 0], [10, 4, 2]])
    assert trimesh.Trimesh(part.vertices_m, part.faces).volume == pytest.approx(2 * (16 - 4 + 1))


def test_a_real_apartment_looks_as_the_same_apartment_in_one_file(public_scenes, tmp_path, caplog):
    world = public_scenes / "gazebo_small_apartment" / "src" / "self_drive_sim" / "worlds" / "map1.world"
    if not world.is_file():
        pytest.skip("no Gazebo world beside the scenes")
    ours = import_scene(world, tmp_path / "world")
    said = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert [("Dog/meshes/model.obj" in sentence, "foldable_chair.png" in sentence) for sentence in said] == [
        (True, False),
        (False, True),
    ]
    theirs = import_scene(public_scenes / "small_apartment.glb", tmp_path / "glb")
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
    src = write_world(tmp_path / "a.world", GROUND + ROOM + includes + box("inside_out", size="1 -1 1"))
    src.write_text(src.read_text().replace("</sdf>", "<world name='other'/></sdf>"))
    _, said = read_parts(src)
    assert said == [
        "Of several worlds the first is taken; left out: other.",
        "Left out, because such shapes cannot be imported: <robot> of robot.urdf, <box> of inside_out_v.",
    ]


@pytest.mark.parametrize("name", ["Ground Plane", "ground_plane"])
def test_the_ground_and_the_sun_of_the_fuel_server_are_built_in(tmp_path, name):
    server = "https://fuel.gazebosim.org/1.0/Owner/models"
    include = f"<include><uri>{server}/{name}/2</uri></include><include><uri>{server}/Sun</uri></include>"
    parts, said = read_parts(write_world(tmp_path / "w.sdf", ROOM + include))
    assert not said
    assert np.allclose(bounds_of(parts)[0], [-0.1, -0.1, 0.0])
    assert any(np.ptp(part.vertices_m[:, 2]) == 0.0 for part in parts)


def test_an_address_of_the_fuel_server_means_a_folder_in_any_letters(tmp_path):
    write_model(tmp_path / "models", "Poster Stand", "", _poster_files())
    mesh = "https://fuel.gazebosim.org/1.0/owner/models/poster%20stand/1/files/meshes/p.obj"
    stand = f"<model name='m'><link name='l'><visual name='v'><geometry><mesh><uri>{mesh}</uri></mesh></geometry>"
    parts, _ = read_parts(write_world(tmp_path / "w.sdf", GROUND + stand + "</visual></link></model>"))
    assert [part.name for part in parts] == ["p.obj"]


def test_a_model_without_its_ground_stands_on_z_0(tmp_path):
    low = ROOM.replace("0 0 1.25 0 0 0", "0 0 0.4 0 0 0").replace("2.5</size>", "0.8</size>")
    parts, said = read_parts(
        write_world(tmp_path / "w.sdf", low + box("table", "<pose>3 2 0.35 0 0 0</pose>", "2 2 0.7"))
    )
    assert said == ["No floor lies below what stands in w.sdf: the file's own z = 0 is taken for the ground."]
    assert np.allclose(bounds_of(parts), [[-0.1, -0.1, 0.0], [6.1, 4.1, 0.8]])
    floor = box("floor", "<pose>3 2 -0.05 0 0 0</pose>", "6 4 0.1")
    assert not read_parts(write_world(tmp_path / "w.sdf", low + floor))[1]


def test_macros_are_expanded_where_xacro_is_installed(tmp_path, monkeypatch):
    src = write_world(tmp_path / "w.sdf.xacro", GROUND + ROOM)
    assert find_format(src).name == "gazebo"
    monkeypatch.setitem(sys.modules, "xacro", None)
    with pytest.raises(SceneError, match=r"install xacro .* or expand it with `xacro w.sdf.xacro > w.sdf`"):
        read_parts(src)
    made = SimpleNamespace(toxml=lambda: src.read_text().replace("6 0.1 2.5", "6 0.1 1.5"))
    monkeypatch.setitem(sys.modules, "xacro", SimpleNamespace(process_file=lambda path: made))
    assert len(read_parts(src)[0]) == 5
    monkeypatch.setitem(sys.modules, "xacro", SimpleNamespace(process_file=lambda path: {}["wall"]))
    with pytest.raises(SceneError, match=r"cannot be expanded \('wall'\)"):
        read_parts(src)


@pytest.mark.parametrize("limit", ["inf", "+Infinity", "1e16"])
def test_a_joint_without_an_end_is_unlimited(tmp_path, limit):
    joint = (
        "<joint name='j' type='revolute'><parent>world</parent><child>l</child><axis><xyz>0 0 1</xyz>"
        f"<limit><lower>-{limit.lstrip('+')}</lower><upper>{limit}</upper></limit></axis></joint></model>"
    )
    src = write_world(tmp_path / "w.sdf", GROUND + box("door").replace("</model>", joint))
    assert read_gazebo(src, [], ImportReport()).joints["door/l"].limits is None
    src.write_text(src.read_text().replace(f"<upper>{limit}", "<upper>nan"))
    with pytest.raises(SceneError, match="<upper>nan</upper> should hold 1 numbers"):
        read_parts(src)


def test_a_world_in_map_coordinates_is_moved_to_the_origin(tmp_path):
    def far(text):
        return re.sub(r"</?model[^>]*><pose>(\S+) (\S+)", _moved, text)

    def _moved(found):
        x, y = float(found[1]) + 500_000.0, float(found[2]) + 4_000_000.0
        return found[0].replace(f"{found[1]} {found[2]}", f"{x} {y}")

    fallen = box("fallen", "<pose>500000 4000000 -7.6e8 0 0 0</pose>")
    src = write_world(tmp_path / "w.world", far(ROOM) + fallen)
    parts, said = read_parts(src)
    assert said[0] == "Left out, because they lie more than 1 km away: fallen."
    assert np.allclose(bounds_of(parts), [[499_999.9, 3_999_999.9, 0.0], [500_006.1, 4_000_004.1, 2.5]])
    assert any(np.ptp(part.vertices_m[:, 2]) == 0.0 for part in parts)
    scene = import_scene(src, tmp_path / "out")
    assert np.allclose(np.ptp(scene.bounds_m, axis=0), [6.2, 4.2, 2.5], atol=1e-3)
    assert tomllib.loads((scene.folder / "scene.toml").read_text())["origin"][:2] == pytest.approx(
        [500_003.0, 4_000_002.0], abs=5.0
    )


def test_a_world_of_which_most_has_fallen_stays_where_it_is(tmp_path):
    fallen = "".join(box(f"b{k}", f"<pose>0 0 -{k}e5 0 0 0</pose>") for k in range(1, 6))
    parts, _ = read_parts(write_world(tmp_path / "w.world", box("a", "<pose>3 0 1.5 0 0 0</pose>") + fallen))
    assert [part.part for part in parts][:1] == ["a/l"]


def test_a_world_without_anything_says_what_was_left_out(tmp_path):
    src = write_world(tmp_path / "w.world", "<include><uri>model://cat</uri></include>")
    with pytest.raises(SceneError, match=r"nothing that can be drawn: .*\. Not found: the models cat, which"):
        read_parts(src)


def test_a_black_shape_that_glows_has_the_colour_of_its_light(tmp_path):
    glow = "<material><diffuse>{} 1</diffuse><emissive>1 0.6 0 1</emissive></material>"
    black, red = box("a", more=glow.format("0 0 0")), box("b", more=glow.format("1 0 0"))
    parts, _ = read_parts(write_world(tmp_path / "w.sdf", black + red))
    assert {part.part: part.rgb for part in parts if part.part} == {"a/l": (1.0, 0.6, 0.0), "b/l": (1.0, 0.0, 0.0)}


@pytest.mark.parametrize(("version", "axis"), [("1.4", (1, 0, 0)), ("1.5", (0, 1, 0)), ("1.10", (0, 1, 0))])
def test_the_axis_of_a_joint_is_that_of_the_model_up_to_version_1_4(tmp_path, version, axis):
    joint = (
        "<joint name='j' type='prismatic'><parent>world</parent><child>l</child><axis><xyz>1 0 0</xyz></axis></joint>"
    )
    turned = box("door").replace("<link name='l'>", "<link name='l'><pose>0 0 0 0 0 1.5707963268</pose>")
    src = write_world(tmp_path / "w.sdf", GROUND + turned.replace("</model>", f"{joint}</model>"), version)
    assert np.allclose(read_gazebo(src, [], ImportReport()).joints["door/l"].axis, axis, atol=1e-6)
