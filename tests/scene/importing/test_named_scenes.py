"""Scenes by name, found in small copies of the published layouts; scenes given as the file that they come from."""

import os
import sys
import types
from pathlib import Path

import pytest

from anm_mj.cli.main import main
from anm_mj.errors import SceneError
from anm_mj.scene.folder import load_scene
from anm_mj.scene.importing.import_on_demand import folder_of
from anm_mj.scene.importing.import_scene import import_scene
from anm_mj.scene.importing.named_scenes import find_named
from tests.cli.test_main import fails
from tests.scene.importing.readers.mjcf.worlds import room_xml, write_world


@pytest.fixture(autouse=True)
def _nowhere(monkeypatch, tmp_path):
    """No data set of this machine is found."""
    for variable in ("MLSPACES_ASSETS_DIR", "MLSPACES_CACHE_DIR", "ROBOCASA_SCENES", "REPLICA_CAD_ROOT"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("molmospaces:procthor-10k-val/12", "scenes/procthor-10k-val/val_12_ceiling.xml"),
        ("molmospaces:procthor-10k-val/12", "scenes/procthor-10k-val/val_12.xml"),
        ("molmospaces:procthor-10k-train/3", "scenes/procthor-10k-train/20251217/train_3.xml"),
        ("molmospaces:ithor/1", "scenes/ithor/FloorPlan1_physics.xml"),
        ("robocasa:layout1_style2", "layout1_style2.xml"),
        ("robocasa:kitchens/7", "kitchens/7.xml"),
        ("replicacad:apt_0", "configs/scenes/apt_0.scene_instance.json"),
    ],
)
def test_a_name_is_found_in_the_published_layout(tmp_path, monkeypatch, name, file):
    wanted = tmp_path / "set" / file
    wanted.parent.mkdir(parents=True)
    wanted.write_text("")
    assert find_named(name, tmp_path / "set").path == wanted
    with pytest.raises(SceneError, match="here"):
        find_named(name)
    variable = {"m": "MLSPACES_ASSETS_DIR", "rob": "ROBOCASA_SCENES", "rep": "REPLICA_CAD_ROOT"}
    monkeypatch.setenv(next(own for key, own in variable.items() if name.startswith(key)), str(tmp_path / "set"))
    found = find_named(name)
    assert found.path == wanted
    assert name.partition(":")[2] in found.source


def test_the_house_with_a_ceiling_is_preferred(tmp_path):
    folder = tmp_path / "scenes" / "procthor-10k-val"
    for file in ("val_1.xml", "val_1_ceiling.xml", "val_11.xml", "val_1_physics.xml"):
        write_world(folder / file, room_xml())
    assert find_named("molmospaces:procthor-10k-val/1", tmp_path).path.name == "val_1_ceiling.xml"
    assert find_named("molmospaces:procthor-10k-val/11", tmp_path).path.name == "val_11.xml"


def test_a_named_scene_is_imported_with_licence_and_source(tmp_path, capsys):
    write_world(tmp_path / "set" / "scenes" / "procthor-10k-val" / "val_12.xml", room_xml())
    words = ["scene", "import", "molmospaces:procthor-10k-val/12", "house", "--root", str(tmp_path / "set")]
    assert main(words) == 0
    scene = load_scene(Path("house"))
    assert scene.source == "MolmoSpaces, procthor-10k-val/12"
    assert "ODC-BY" in scene.licence
    # A scene is not replaced by mistake.
    capsys.readouterr()
    assert "--force" in fails(capsys, *words)
    assert main([*words, "--force"]) == 0


def test_robocasa_shows_its_visual_groups_only(tmp_path):
    body = room_xml().replace("<geom ", '<geom group="1" contype="0" conaffinity="0" ')
    write_world(tmp_path / "k.xml", body + room_xml().replace('name="', 'name="solid_'))
    named = import_scene(Path("robocasa:k"), tmp_path / "named", root=tmp_path)
    plain = import_scene(tmp_path / "k.xml", tmp_path / "plain")
    assert 2 * named.num_triangles == plain.num_triangles


def test_what_is_missing_says_what_to_download(capsys):
    for name, word in (
        ("molmospaces:procthor-10k-val/12", "pip install molmo-spaces"),
        ("robocasa:layout1_style2", "get_xml()"),
        ("replicacad:apt_0", "datasets_download"),
        ("molmospaces:", "procthor-10k-val/12"),
        ("replicacad:../../etc", "apt_0"),
    ):
        assert word in fails(capsys, "scene", "import", name, "out")
    assert "is not a folder" in fails(capsys, "scene", "import", "robocasa:k", "out", "--root", "gone")
    assert "is not a folder" in fails(capsys, "scene", "import", "robocasa:k", "out", "--root", "x" * 5000)
    assert "has no scene" in fails(capsys, "scene", "import", f"robocasa:{'x' * 5000}", "out", "--root", ".")
    assert list(Path().iterdir()) == []


def test_an_installed_package_is_asked_to_fetch(tmp_path, monkeypatch):
    house = tmp_path / "fetched" / "val_12.xml"
    constants, loading = types.ModuleType("constants"), types.ModuleType("loading")
    constants.get_scenes = lambda dataset, split: {split: {12: str(house)} if dataset == "procthor-10k" else {}}
    loading.install_scene_with_objects_and_grasps_from_path = lambda path: write_world(Path(path), room_xml())
    monkeypatch.setitem(sys.modules, "molmo_spaces", types.ModuleType("molmo_spaces"))
    monkeypatch.setitem(sys.modules, "molmo_spaces.utils", types.ModuleType("utils"))
    monkeypatch.setitem(sys.modules, "molmo_spaces.molmo_spaces_constants", constants)
    monkeypatch.setitem(sys.modules, "molmo_spaces.utils.lazy_loading_utils", loading)
    assert find_named("molmospaces:procthor-10k-val/12").path == house
    with pytest.raises(SceneError, match=r"could not fetch ithor/5 \(KeyError"):
        find_named("molmospaces:ithor/5")


def test_robocasa_composes_a_kitchen_once(monkeypatch):
    made = []

    def make(env, *, robots, layout_ids, style_ids, **_):
        if layout_ids > 9:
            raise FileNotFoundError("fixtures")
        made.append((env, robots, layout_ids, style_ids))
        text = f"<mujoco><worldbody>{room_xml()}</worldbody></mujoco>".replace("<geom ", '<geom group="1" ')
        model = types.SimpleNamespace(get_xml=lambda: text)
        return types.SimpleNamespace(reset=lambda: None, sim=types.SimpleNamespace(model=model))

    robosuite = types.ModuleType("robosuite")
    robosuite.make = make
    monkeypatch.setitem(sys.modules, "robosuite", robosuite)
    monkeypatch.setitem(sys.modules, "robocasa", types.ModuleType("robocasa"))
    scene = import_scene(Path("robocasa:layout1_style2"), Path("kitchen"))
    assert scene.source == "RoboCasa, layout1_style2"
    assert find_named("robocasa:layout1_style2").path.is_file()
    assert made == [("Kitchen", "PandaOmron", 1, 2)]
    with pytest.raises(SceneError, match=r"could not compose layout12_style2 \(FileNotFoundError: fixtures"):
        find_named("robocasa:layout12_style2")
    with pytest.raises(SceneError, match="has no scene 'mine'"):
        find_named("robocasa:mine")


def test_what_decides_over_an_import_on_the_fly_is_a_part_of_its_name(tmp_path, monkeypatch):
    src = write_world(tmp_path / "pkg" / "worlds" / "hut.xml", room_xml(2.0))
    first = folder_of(str(src))
    (src.parent / "runs" / "one").mkdir(parents=True)
    (src.parent / "runs" / "one" / "frames.jsonl").write_text("{}\n")
    assert folder_of(str(src)) == first
    monkeypatch.setenv("GAZEBO_MODEL_PATH", str(tmp_path / "models"))
    with_models = folder_of(str(src))
    (tmp_path / "pkg" / "models").mkdir()
    (tmp_path / "pkg" / "models" / "chair.sdf").write_text("<sdf/>")
    assert len({first, with_models, folder_of(str(src))}) == 3


def test_a_file_is_imported_on_the_fly_and_again_when_it_changes(tmp_path):
    src = write_world(tmp_path / "src" / "hut.xml", room_xml(2.0))
    first = folder_of(str(src))
    assert load_scene(first).name == "hut"
    assert folder_of(str(src)) == first
    write_world(src, room_xml(2.5))
    again = folder_of(str(src))
    assert again != first
    assert load_scene(again).bounds_m[1, 0] > load_scene(first).bounds_m[1, 0]
    assert folder_of("home") == "home"
    assert folder_of(str(Path(first) / "scene.xml")) == first


def test_a_file_is_imported_on_the_fly_whatever_names_the_files_beside_it_have(tmp_path):
    src = write_world(tmp_path / "src" / ("\u5bb6" * 80 + ".xml"), room_xml(2.0))
    (src.parent / os.fsdecode(b"caf\xe9.txt")).touch()
    assert load_scene(folder_of(str(src))).name == src.stem


def test_a_cache_that_cannot_be_written_is_named_with_what_to_do(tmp_path, monkeypatch):
    src = write_world(tmp_path / "a src" / "hut.xml", room_xml(2.0))
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(SceneError, match=r"XDG_CACHE_HOME, or .* anm-mj scene import '.*/a src/hut.xml' DIR"):
        folder_of(str(src))


def test_explore_takes_a_file(tmp_path, monkeypatch):
    src = write_world(tmp_path / "src" / "hut.xml", room_xml(2.0))
    seen = []

    class Stopped(BaseException):
        pass

    def stop(config, **_):
        seen.append(config.scene)
        raise Stopped

    monkeypatch.setattr("anm_mj.run.run", stop)
    with pytest.raises(Stopped):
        main(["explore", str(src)])
    assert load_scene(seen[0]).source == "MuJoCo world hut.xml"


def test_generate_refuses_to_replace_a_scene(tmp_path, capsys):
    words = ("scene", "generate", tmp_path / "g", "--rooms", "1")
    assert main([str(word) for word in words]) == 0
    capsys.readouterr()
    assert "--force" in fails(capsys, *words)
