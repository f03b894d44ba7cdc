from pathlib import Path

import pytest

from anm_mj.cli.main import main
from anm_mj.scene.folder import load_scene
from anm_mj.scene.importing.readers.source_formats import FORMATS
from tests.cli.test_main import fails
from tests.scene.furnished import furnished, write_glb
from tests.scene.importing.readers.gazebo_worlds import GROUND, ROOM, write_model, write_world

_DOCS = Path(__file__).resolve().parents[3] / "docs" / "scenes.md"


def test_all_options_reach_the_importer(tmp_path, capsys):
    src = write_glb(tmp_path / "a.glb", *furnished(), y_up=True)
    options = ["--format", "gibson", "--up", "y", "--scale", "2", "--name", "twice", "--source", "a scan"]
    assert main(["scene", "import", str(src), str(tmp_path / "out"), *options]) == 0
    assert "twice" in capsys.readouterr().out
    scene = load_scene(tmp_path / "out")
    assert scene.bounds_m[1] == pytest.approx([12.2, 8.2, 5.2], abs=1e-3)
    assert (scene.name, scene.source) == ("twice", "a scan")
    assert scene.licence.startswith("Gibson")


def test_folders_of_models_reach_the_importer(tmp_path, capsys):
    box = "<link name='l'><visual name='v'><geometry><box><size>1 1 1</size></box></geometry></visual></link>"
    write_model(tmp_path / "elsewhere", "crate", box)
    include = "<include><uri>model://crate</uri><name>c</name><pose>2 2 0.5 0 0 0</pose></include>"
    src = write_world(tmp_path / "pkg" / "worlds" / "w.world", GROUND + ROOM + include)
    options = ["--model-path", str(tmp_path / "elsewhere")]
    assert main(["scene", "import", str(src), str(tmp_path / "out"), *options]) == 0
    assert "crate" not in capsys.readouterr().err


def test_wrong_options_are_refused_in_one_line(tmp_path, capsys):
    src = write_glb(tmp_path / "a.glb", *furnished())
    assert "gazebo" in fails(capsys, "scene", "import", src, tmp_path / "out", "--format", "unreal")
    assert "invalid choice: 'w'" in fails(capsys, "scene", "import", src, tmp_path / "out", "--up", "w")
    assert "0.01 for cm" in fails(capsys, "scene", "import", src, tmp_path / "out", "--scale", "nan")
    assert "no SDF" in fails(capsys, "scene", "import", src, tmp_path / "out", "--format", "gazebo")
    assert "does not hold" in fails(capsys, "scene", "import", tmp_path, tmp_path / "out", "--format", "hm3d")
    assert "does not exist" in fails(capsys, "scene", "import", tmp_path / "b.glb", tmp_path / "out")
    assert "not a folder" in fails(capsys, "scene", "import", src, tmp_path / "out", "--model-path", tmp_path / "c")
    assert "leave --model-path out" in fails(capsys, "scene", "import", src, tmp_path / "out", "--model-path", tmp_path)
    assert "leave --no-furniture out" in fails(capsys, "scene", "import", src, tmp_path / "out", "--no-furniture")
    plan = ("scene", "import", src, tmp_path / "out", "--format", "floorplan")
    assert "leave --up, --scale and --model-path out" in fails(capsys, *plan, "--scale", "1")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.glb"]


def test_every_kind_is_in_the_help_and_in_the_documentation(capsys):
    assert main(["scene", "import", "--help"]) == 0
    helped, documented = capsys.readouterr().out, _DOCS.read_text()
    for form in FORMATS:
        assert form.name in helped
        assert f"| `{form.name}` |" in documented
