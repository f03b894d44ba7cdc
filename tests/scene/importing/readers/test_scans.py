import tomllib

import numpy as np
import pytest

from anm_mj.errors import SceneError
from anm_mj.scene.importing.import_scene import import_scene
from anm_mj.scene.importing.readers.source_formats import find_format
from tests.scene.furnished import (
    BLUE,
    BOUNDS_M,
    RED,
    furnished,
    looks_at_the_poster,
    write_glb,
    write_obj,
    write_quad_ply,
)
from tests.scene.view import look

MATTERPORT, HM3D = "17DRP5sb8fy", "TEEsavR23oF"


def _entries(scene):
    return tomllib.loads((scene.folder / "scene.toml").read_text())


def _check(scene, licence: str, source: str, up: str = "z"):
    assert np.allclose(scene.bounds_m, BOUNDS_M, atol=2e-3)
    assert looks_at_the_poster(scene)
    assert licence in scene.licence
    assert source in scene.source
    entries = _entries(scene)
    assert (entries["up"], entries["scale"], entries["scale_how"]) == (up, 1.0, "known")


def test_a_gibson_scene_of_habitat_is_z_up_in_a_glb(tmp_path):
    src = write_glb(tmp_path / "gibson" / "Denmark.glb", *furnished())
    (tmp_path / "gibson" / "Denmark.navmesh").write_bytes(b"recast")
    assert find_format(src).name == "gibson"
    _check(import_scene(src, tmp_path / "out"), "Gibson", "Denmark.glb")


@pytest.mark.parametrize(("name", "y_up"), [("mesh_z_up.obj", False), ("mesh.obj", True)])
def test_the_folder_of_an_original_gibson_scene_is_read(tmp_path, name, y_up):
    write_obj(tmp_path / "Rs" / name, y_up=y_up)
    (tmp_path / "Rs" / "camera_poses.csv").write_text("")
    assert find_format(tmp_path / "Rs").name == "gibson"
    scene = import_scene(tmp_path / "Rs", tmp_path / "out")
    _check(scene, "Gibson", f"Rs/{name}", "y" if y_up else "z")
    assert np.abs(look(scene, (3.0, 1.5, 1.5), (-1.0, 0.0, 0.0))[32, 32].astype(int) - (0, 102, 255)).max() <= 3


def test_of_a_gibson_folder_the_mesh_that_is_z_up_is_taken(tmp_path):
    write_obj(tmp_path / "Rs" / "mesh_z_up.obj")
    write_obj(tmp_path / "Rs" / "mesh.obj", y_up=True)
    _check(import_scene(tmp_path / "Rs", tmp_path / "out"), "Gibson", "Rs/mesh_z_up.obj")


@pytest.mark.parametrize("as_folder", [True, False])
def test_a_matterport3d_scene_of_habitat_is_z_up_in_a_glb(tmp_path, as_folder):
    folder = tmp_path / "v1" / "tasks" / MATTERPORT
    src = write_glb(folder / f"{MATTERPORT}.glb", *furnished())
    (folder / f"{MATTERPORT}.house").write_text("ASCII 1.1")
    write_quad_ply(folder / f"{MATTERPORT}_semantic.ply", object_ids=True)
    src = folder if as_folder else src
    assert find_format(src).name == "matterport3d"
    _check(import_scene(src, tmp_path / "out"), "Matterport3D Terms", f"{MATTERPORT}.glb")


def test_an_original_matterport3d_scan_is_read_with_its_split_textures(tmp_path):
    scan = tmp_path / "v1" / "scans" / MATTERPORT
    write_obj(scan / "matterport_mesh" / "0f3a" / "0f3a.obj")
    assert find_format(scan).name == "matterport3d"
    _check(import_scene(scan, tmp_path / "out"), "Matterport3D Terms", "matterport_mesh/0f3a/0f3a.obj")


def test_the_coloured_mesh_of_a_matterport3d_scan_is_read_where_there_is_no_other(tmp_path):
    scan = tmp_path / MATTERPORT
    write_quad_ply(scan / "poisson_meshes" / f"{MATTERPORT}.ply")
    scene = import_scene(scan, tmp_path / "out")
    assert np.allclose(scene.bounds_m, [[0, 0, 0], [6, 4, 2.5]], atol=1e-4)
    assert "poisson_meshes" in scene.source


@pytest.mark.parametrize("basis", [False, True])
def test_an_hm3d_scene_is_taken_in_the_variant_that_can_be_decoded(tmp_path, basis):
    folder = tmp_path / "val" / f"00800-{HM3D}"
    write_glb(folder / f"{HM3D}.basis.glb", *furnished())
    if not basis:
        write_glb(folder / f"{HM3D}.glb", *furnished())
    assert find_format(folder).name == "hm3d"
    scene = import_scene(folder, tmp_path / "out")
    _check(scene, "Matterport End User License", f"{HM3D}.basis.glb" if basis else f"{HM3D}.glb")


@pytest.mark.parametrize("name", ["mesh.ply", "habitat/mesh_semantic.ply"])
def test_a_replica_scene_has_quads_and_colours_per_vertex(tmp_path, name):
    write_quad_ply(tmp_path / "room_0" / name, object_ids="semantic" in name)
    (tmp_path / "room_0" / "habitat").mkdir(exist_ok=True)
    src = tmp_path / "room_0" if name == "mesh.ply" else tmp_path / "room_0" / name
    assert find_format(src).name == "replica"
    scene = import_scene(src, tmp_path / "out")
    assert np.allclose(scene.bounds_m, [[0, 0, 0], [6, 4, 2.5]], atol=1e-5)
    assert scene.num_triangles == 2 * 2 * 4 * (6 * 4 + 4 * 2.5 + 2.5 * 6)
    assert scene.licence == "Replica Research Terms (non-commercial)"
    seen = look(scene, (3.0, 3.0, 1.25), (1.0, 0.0, 0.0)).astype(int)
    for dv in (-20, 0, 20):
        share = (1.25 - dv / 32.5) / 2.5
        assert np.abs(seen[32 + dv, 32] - ((1 - share) * np.array(RED) + share * np.array(BLUE))).max() <= 5


def test_what_the_user_says_about_a_data_set_wins(tmp_path):
    src = write_glb(tmp_path / "gibson" / "Denmark.glb", *furnished(), y_up=True)
    scene = import_scene(src, tmp_path / "out", up="y", licence="by letter", source="a friend", source_format="hm3d")
    assert np.allclose(scene.bounds_m, BOUNDS_M, atol=2e-3)
    assert (scene.licence, scene.source) == ("by letter", "a friend")
    assert _entries(scene)["up_how"] == "given"


def test_a_layout_is_not_believed_against_overwhelming_evidence(tmp_path):
    src = write_glb(tmp_path / "gibson" / "Denmark.glb", *furnished(), y_up=True)
    scene = import_scene(src, tmp_path / "out")
    assert np.allclose(scene.bounds_m, BOUNDS_M, atol=2e-3)
    assert (_entries(scene)["up"], _entries(scene)["up_how"]) == ("y", "found")


@pytest.mark.parametrize(("y_up", "up"), [(False, "z"), (True, "y")])
def test_a_bare_glb_of_no_data_set_may_be_either_way_up(tmp_path, y_up, up):
    src = write_glb(tmp_path / "house.glb", *furnished(), y_up=y_up)
    assert find_format(src).name == "mesh"
    scene = import_scene(src, tmp_path / "out")
    assert np.allclose(scene.bounds_m, BOUNDS_M, atol=2e-3)
    assert (_entries(scene)["up"], scene.licence) == (up, "unknown")


def test_folders_of_no_known_layout_are_refused_with_advice(tmp_path):
    (tmp_path / "stuff").mkdir()
    with pytest.raises(SceneError, match="folder of no format"):
        import_scene(tmp_path / "stuff", tmp_path / "out")
    with pytest.raises(SceneError, match=r"does not hold a Replica scene.*mesh\.ply"):
        import_scene(tmp_path / "stuff", tmp_path / "out", source_format="replica")
    with pytest.raises(SceneError, match=r"no format 'scannet'.*gibson"):
        import_scene(tmp_path / "stuff", tmp_path / "out", source_format="scannet")
    assert not (tmp_path / "out").exists()
