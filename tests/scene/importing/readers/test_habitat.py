import json
import os
import re
import tomllib

import numpy as np
import pytest
import trimesh

from anm_mj.errors import SceneError
from anm_mj.scene.importing.import_scene import import_scene
from anm_mj.scene.importing.readers import import_limits as limits
from anm_mj.scene.importing.readers.habitat import DATASETS, read_scene_instance
from anm_mj.scene.importing.readers.import_report import ImportReport
from anm_mj.scene.importing.readers.source_formats import find_format
from anm_mj.scene.importing.readers.urdf import read_urdf
from anm_mj.scene.submesh import merge_geometry
from tests.scene.furnished import BOUNDS_M, looks_at_the_poster, poster, write_glb
from tests.scene.shapes import box, room

# (x, y, z) of the world is (x, z, -y) here.
STAGE = "frl_apartment_stage"


def _write(path, entries) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(entries))


def _bounds(parts):
    vertices, faces = merge_geometry(parts)
    used = vertices[faces].reshape(-1, 3)
    return np.stack([used.min(axis=0), used.max(axis=0)])


def _hung_poster():
    """The poster about the middle of its lower edge, facing +z of glTF."""
    mesh = poster()
    mesh.apply_translation([-3.0, -3.99, -0.5])
    return mesh


def _replica_cad(root, scene: dict):
    """A dataset with a room, a poster and a cube of 1 m whose corner is its origin, and one scene."""
    _write(root / "replicaCAD.scene_dataset_config.json", {"stages": {"paths": {".json": ["configs/stages"]}}})
    write_glb(root / "stages" / f"{STAGE}.glb", room(), y_up=True)
    stage = {"render_asset": f"../../stages/{STAGE}.glb", "up": [0, 1, 0], "front": [0, 0, -1]}
    _write(root / "configs" / "stages" / f"{STAGE}.stage_config.json", stage)
    for name, mesh in (("poster", _hung_poster()), ("cube", box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)))):
        write_glb(root / "objects" / f"{name}.glb", mesh, y_up=True)
        config = {"render_asset": f"../../objects/{name}.glb", "mass": 1.0}
        _write(root / "configs" / "objects" / f"{name}.object_config.json", config)
    src = root / "configs" / "scenes" / "apt_0.scene_instance.json"
    _write(src, {"stage_instance": {"template_name": f"stages/{STAGE}"}, **scene})
    return src


POSTER = {"template_name": "objects/poster", "translation": [3.0, 0.5, -3.99], "translation_origin": "asset_local"}


def test_a_replicacad_scene_is_put_together(tmp_path):
    cube = {"template_name": "cube", "translation": [0.5, 0.5, -0.5], "rotation": [1, 0, 0, 0]}
    src = _replica_cad(tmp_path / "cad", {"object_instances": [POSTER, cube]})
    assert find_format(src).name == "replicacad"
    scene = import_scene(src, tmp_path / "out")
    assert np.allclose(scene.bounds_m, BOUNDS_M, atol=2e-3)
    assert looks_at_the_poster(scene)
    assert (scene.licence, scene.source) == ("CC BY 4.0", "ReplicaCAD, scene apt_0")
    entries = tomllib.loads((scene.folder / "scene.toml").read_text())
    assert (entries["up"], entries["up_how"], entries["scale_how"]) == ("y", "known", "known")


def _one(tmp_path, **instance):
    """Bounds of one cube in an otherwise empty scene, in the scene's axes."""
    src = _replica_cad(tmp_path, {"stage_instance": None, "object_instances": [{"template_name": "cube", **instance}]})
    return _bounds(read_scene_instance(DATASETS[1], src, [], ImportReport()).submeshes)


def test_an_object_stands_by_its_origin_or_by_its_middle(tmp_path):
    # The cube's corner is the origin: it reaches from 0 to 1 along x and y and to -1 along z.
    at = {"translation": [10.0, 0.0, 0.0]}
    by_origin = _one(tmp_path / "a", translation_origin="asset_local", **at)
    assert np.allclose(by_origin, [[10, 0, -1], [11, 1, 0]], atol=1e-6)
    assert np.allclose(_one(tmp_path / "b", **at), [[9.5, -0.5, -0.5], [10.5, 0.5, 0.5]], atol=1e-6)


@pytest.mark.parametrize(("usual", "own", "low"), [("asset_local", "com", 9.5), ("com", "asset_local", 10.0)])
def test_the_origin_that_an_object_states_goes_before_that_of_the_scene(tmp_path, usual, own, low):
    cube = {"template_name": "cube", "translation": [10.0, 0.0, 0.0], "translation_origin": own}
    scene = {"stage_instance": None, "translation_origin": usual, "object_instances": [cube]}
    parsed = read_scene_instance(DATASETS[1], _replica_cad(tmp_path, scene), [], ImportReport())
    assert _bounds(parsed.submeshes)[0, 0] == pytest.approx(low)


@pytest.mark.parametrize(
    ("stated", "low"),
    [
        ([0.0, 0.0, 0.0], (10, 0, -2)),
        ([1.0, 0.5, 0.25], (8, -1, -2.5)),
        ([1.0, 2.0], (9, -1, -1)),
        ("1 2 3", (9, -1, -1)),
    ],
)
def test_an_object_stands_by_the_centre_of_mass_that_its_template_states(tmp_path, stated, low):
    instance = {"template_name": "cube", "translation": [10.0, 0.0, 0.0], "uniform_scale": 2.0}
    src = _replica_cad(tmp_path, {"stage_instance": None, "object_instances": [instance]})
    config = {"render_asset": "../../objects/cube.glb", "COM": stated}
    _write(tmp_path / "configs" / "objects" / "cube.object_config.json", config)
    bounds = _bounds(read_scene_instance(DATASETS[1], src, [], ImportReport()).submeshes)
    # The cube reaches from 0 to 2 along x and y and to -2 along z.
    assert np.allclose(bounds, [low, np.add(low, 2.0)], atol=1e-6)


def test_rotations_have_w_first_and_scales_apply_before_them(tmp_path):
    half = np.sqrt(0.5)
    bounds = _one(
        tmp_path,
        translation_origin="asset_local",
        rotation=[half, 0.0, half, 0.0],
        non_uniform_scale=[2.0, 3.0, 1.0],
        translation=[0.0, 0.0, 0.0],
    )
    # A quarter turn about y takes x to -z and z to x.
    assert np.allclose(bounds, [[-1, 0, -2], [0, 3, 0]], atol=1e-6)


def test_an_hssd_scene_finds_its_templates_by_hash(tmp_path):
    root = tmp_path / "hssd-hab"
    _write(root / "hssd-hab.scene_dataset_config.json", {})
    stage, thing = "102343992", "0f58bea68d073b81deb36a8339cd9cac77094ffc"
    write_glb(root / "stages" / f"{stage}.glb", room(), y_up=True)
    _write(root / "stages" / f"{stage}.stage_config.json", {"render_asset": f"{stage}.glb", "up": [0, 1, 0]})
    write_glb(root / "objects" / "0" / f"{thing}.glb", _hung_poster(), y_up=True)
    _write(root / "objects" / "0" / f"{thing}.object_config.json", {"render_asset": f"{thing}.glb"})
    scene = {
        "stage_instance": {"template_name": f"stages/{stage}"},
        "translation_origin": "asset_local",
        "object_instances": [{"template_name": thing, "translation": [3, 0.5, -3.99], "motion_type": "STATIC"}],
    }
    src = root / "scenes" / f"{stage}.scene_instance.json"
    _write(src, scene)
    assert find_format(src).name == "hssd"
    imported = import_scene(src, tmp_path / "out")
    assert looks_at_the_poster(imported)
    assert np.allclose(imported.bounds_m, BOUNDS_M, atol=2e-3)
    assert imported.licence == "CC BY-NC 4.0"


def test_a_stage_that_states_another_up_axis_is_turned(tmp_path):
    src = _replica_cad(tmp_path / "cad", {"object_instances": [POSTER]})
    write_glb(tmp_path / "cad" / "stages" / f"{STAGE}.glb", room())
    stage = {"render_asset": f"../../stages/{STAGE}.glb", "up": [0, 0, 1], "front": [0, 1, 0]}
    _write(tmp_path / "cad" / "configs" / "stages" / f"{STAGE}.stage_config.json", stage)
    scene = import_scene(src, tmp_path / "out")
    assert np.allclose(scene.bounds_m, BOUNDS_M, atol=2e-3)
    assert looks_at_the_poster(scene)


URDF = """<robot name="cupboard">
  <link name="root"/>
  <link name="body"><visual><origin xyz="0 1 0"/>
    <geometry><mesh filename="body.glb" scale="2 2 2"/></geometry></visual></link>
  <link name="door"><visual><origin rpy="0 0 1.5707963"/><geometry><box size="2 0.1 1"/></geometry>
    <material><color rgba="1 0 0 1"/></material></visual></link>
  <joint name="a" type="fixed"><parent link="root"/><child link="body"/><origin xyz="5 0 0"/></joint>
  <joint name="b" type="revolute"><parent link="body"/><child link="door"/><origin xyz="0 0 3" rpy="0 0 0"/></joint>
</robot>"""


def _write_urdf(folder):
    write_glb(folder / "body.glb", box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)))
    (folder / "cupboard.urdf").write_text(URDF)
    return folder / "cupboard.urdf"


def test_a_urdf_stands_in_its_rest_pose(tmp_path):
    body, door = read_urdf(_write_urdf(tmp_path), ImportReport())
    assert np.allclose(_bounds([body]), [[5, 1, 0], [7, 3, 2]], atol=1e-6)
    assert np.allclose(_bounds([door]), [[4.95, -1, 2.5], [5.05, 1, 3.5]], atol=1e-6)
    assert door.rgb == (1.0, 0.0, 0.0)


def test_a_colour_of_a_urdf_may_be_named_where_it_is_used(tmp_path):
    src = _write_urdf(tmp_path)
    named = src.read_text().replace("</robot>", '<material name="own"><color rgba="0 1 0 1"/></material></robot>')
    src.write_text(re.sub(r"<material>.*?</material>", '<material name="own"/>', named))
    assert read_urdf(src, ImportReport())[1].rgb == (0.0, 1.0, 0.0)


def test_articulated_objects_are_part_of_the_scene(tmp_path):
    root = tmp_path / "cad"
    placed = {"template_name": "cupboard", "translation": [0, 0, 0], "uniform_scale": 0.5, "fixed_base": True}
    scene = {"stage_instance": None, "articulated_object_instances": [placed]}
    src = _replica_cad(root, scene)
    _write_urdf(root / "urdf" / "cupboard")
    parts = read_scene_instance(DATASETS[1], src, [], ImportReport()).submeshes
    assert np.allclose(_bounds(parts), [[2.475, -0.5, 0], [3.5, 1.5, 1.75]], atol=1e-6)


def test_what_is_missing_is_said_once_and_left_out(tmp_path):
    gone = [{"template_name": "sofa"}, {"template_name": "sofa"}, {"template_name": "lamp"}]
    src = _replica_cad(tmp_path, {"object_instances": [*gone, {"template_name": "broken"}]})
    (tmp_path / "objects" / "broken.glb").write_bytes(b"no glb at all, but long enough for a header")
    report = ImportReport()
    parts = read_scene_instance(DATASETS[1], src, [], report).submeshes
    assert len(parts) == 1
    missing, broken = report.sentences()
    assert missing == "Not found in the dataset's folder: sofa, lamp, which are left out."
    assert broken.startswith("Left out, because they cannot be read: broken (")


def test_what_is_too_large_is_refused_and_not_left_out(tmp_path, monkeypatch):
    src = _replica_cad(tmp_path / "cad", {"articulated_object_instances": [{"template_name": "cupboard"}]})
    _write_urdf(tmp_path / "cad" / "urdf" / "cupboard")
    monkeypatch.setattr(limits, "MAX_TRIANGLES", 900)
    with pytest.raises(SceneError, match=r"cupboard\.urdf places more than 900 triangles"):
        read_scene_instance(DATASETS[1], src, [], ImportReport())


def _with_thing(tmp_path, config):
    """A dataset three folders below ``tmp_path``, with a room and a thing of that configuration, and its scene."""
    root = tmp_path / "a" / "b" / "cad"
    src = _replica_cad(root, {"object_instances": [{"template_name": "thing"}]})
    if config is not None:
        _write(root / "configs" / "objects" / "thing.object_config.json", config)
    return src, root


def _said(src, *model_paths):
    report = ImportReport()
    parts = read_scene_instance(DATASETS[1], src, list(model_paths), report).submeshes
    return len(parts), report.sentences()


@pytest.mark.parametrize("asset", ["../../../../../{}", "{}"])
def test_an_asset_from_elsewhere_is_not_read(tmp_path, asset):
    write_glb(tmp_path / "secret.glb", box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)))
    name = asset.format("secret.glb") if asset[0] == "." else str(tmp_path / "secret.glb")
    src, _ = _with_thing(tmp_path, {"render_asset": name})
    count, said = _said(src)
    assert count == 1
    assert said[0].startswith("Not read, because they lie elsewhere")
    # The folder that the user gives is one that may be read.
    assert _said(src, tmp_path)[0] == 2


def test_a_mesh_of_a_urdf_from_elsewhere_is_not_read(tmp_path):
    write_glb(tmp_path / "secret.glb", box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)))
    src, root = _with_thing(tmp_path, None)
    mesh = f'<mesh filename="{tmp_path}/secret.glb"/>'
    urdf = f'<robot><link name="l"><visual><geometry>{mesh}</geometry></visual></link></robot>'
    (root / "objects" / "thing.urdf").write_text(urdf)
    count, said = _said(src)
    assert count == 1
    assert said[0].startswith("Not read, because they lie elsewhere")


@pytest.mark.parametrize("make", [os.mkfifo, lambda path: path.symlink_to("/dev/zero")])
def test_a_urdf_that_is_no_file_is_not_waited_for(tmp_path, make):
    src, root = _with_thing(tmp_path, None)
    make(root / "objects" / "thing.urdf")
    count, said = _said(src)
    assert count == 1
    assert "thing" in said[0]
    with pytest.raises(SceneError, match="no regular file"):
        read_urdf(root / "objects" / "thing.urdf", ImportReport())


def test_an_asset_whose_name_no_file_can_have_is_not_found(tmp_path):
    src, _ = _with_thing(tmp_path, {"render_asset": "x" * 5000})
    assert _said(src)[1][0].startswith("Not found in the dataset's folder")


def test_shapes_of_a_urdf_that_cannot_be_drawn_are_said(tmp_path):
    visual = '<visual><geometry><sphere radius="0"/></geometry></visual>'
    (tmp_path / "a.urdf").write_text(f'<robot><link name="l">{visual}</link></robot>')
    report = ImportReport()
    assert not read_urdf(tmp_path / "a.urdf", report)
    assert report.sentences() == ["Left out, because such shapes cannot be imported: <sphere> of a.urdf."]


def test_a_scene_that_was_taken_out_of_its_dataset_asks_for_it(tmp_path):
    src = _replica_cad(tmp_path / "cad", {"object_instances": [POSTER]})
    alone = tmp_path / "apt_0.scene_instance.json"
    alone.write_bytes(src.read_bytes())
    with pytest.raises(SceneError, match="--model-path"):
        import_scene(alone, tmp_path / "out")
    scene = import_scene(alone, tmp_path / "out", source_format="replicacad", model_paths=[tmp_path / "cad"])
    assert looks_at_the_poster(scene)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("{", "cannot be read"),
        ('{"a":' * 50_000 + "1" + "}" * 50_000, "nested too deeply"),
        ("[]", "not an object"),
        ('{"object_instances": [{}]}', "damaged"),
        ('{"object_instances": [{"template_name": "cube", "rotation": [0, 0, 0, 0]}]}', "no rotation"),
        ('{"object_instances": [{"template_name": "cube", "translation": [0, 1]}]}', "no proper translation"),
        ("{}", "Nothing that"),
    ],
    ids=lambda value: value[:30],
)
def test_broken_scenes_are_refused_in_one_sentence(tmp_path, text, reason):
    src = _replica_cad(tmp_path / "cad", {})
    src.write_text(text)
    with pytest.raises(SceneError, match=reason) as caught:
        import_scene(src, tmp_path / "out")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_a_house_of_many_instances_is_drawn_as_few_meshes(tmp_path):
    cubes = [{"template_name": "cube", "translation": [1.0 + 0.5 * i, 0.5, -1.0]} for i in range(8)]
    src = _replica_cad(tmp_path / "cad", {"object_instances": cubes})
    scene = import_scene(src, tmp_path / "out")
    # One for each of the six directions.
    assert len(list((scene.folder / "assets").glob("*.msh"))) == 6
    assert scene.num_triangles == len(room().faces) + 8 * len(trimesh.creation.box().faces)
