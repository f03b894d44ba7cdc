"""What users import reads a run as arrays and as a data frame, and passes a strict type checker."""

import base64
import io
import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import anm_mj
from anm_mj.viz.figure_file import save_figure
from tests.replay.conftest import box_run

ROOT = Path(__file__).resolve().parents[1]
USER = '''
"""A user's script."""

from pathlib import Path

import anm_mj


def far(report: anm_mj.Stepped) -> bool:
    return report.step >= 4 and report.observation.pose.x_m > 1.0


def main() -> None:
    made = anm_mj.explore_scene("room", steps=5, seed=0, on_step=far, settings=["image_px=32"])
    folder: Path = made.folder
    run = anm_mj.load_run(folder)
    path_m = float(run.steps["x_m"][-1] - run.poses[0, 0])
    neural_map = anm_mj.load_map(folder)
    distance_m = neural_map.sdf(run.poses)
    robot = anm_mj.make_robot(anm_mj.load_scene("room"), seed=0)
    observation = robot.observe()
    print(path_m, distance_m.min(), observation.depth_m.shape, made.metrics["completion_ratio"], run.config["seed"])

    anm_mj.explore_seen("room")
'''


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return anm_mj.load_run(box_run(tmp_path_factory.mktemp("api") / "box"))


def test_a_data_frame_holds_the_steps(run):
    pandas = pytest.importorskip("pandas")
    frame = run.data_frame()
    assert isinstance(frame, pandas.DataFrame)
    assert len(frame) == len(run.poses) - 1 == 40
    np.testing.assert_allclose(frame[["x_m", "y_m"]].to_numpy(), run.poses[1:, :2])
    assert frame["action"].value_counts().to_dict() == {"TURN_LEFT": 27, "MOVE_FORWARD": 13}
    assert frame["moved_m"].sum() == pytest.approx(13 * 0.065)
    assert set(frame.columns) == set(run.steps)


def test_a_run_describes_itself_in_five_lines_and_to_notebooks_with_its_map(run):
    lines = repr(run).splitlines()
    assert [line.split()[0] for line in lines] == ["run", "folder", "came", "mesh", "more"]
    assert str(run.content.folder.path) in lines[1]
    assert max(map(len, lines)) < 200
    assert "<img" not in run._repr_html_()
    save_figure(run.plot(), run.content.folder.topdown_picture)
    shown = run._repr_html_()
    picture = base64.b64decode(shown.split("base64,")[1].split('"')[0])
    assert picture == run.content.folder.topdown_picture.read_bytes()
    assert repr(anm_mj.Exploration(run.content.folder.path, run.metrics)).count("\n") == 4


def test_only_a_run_that_did_not_end_is_said_not_to_have(run):
    folder = run.content.folder.path
    killed, ended, mapped = {"stop_reason": None}, {"stop_reason": "BUDGET"}, {"frames": 7}
    for metrics, said in (({}, True), (killed, True), (ended, False), (mapped, False)):
        assert ("not ended" in repr(anm_mj.Exploration(folder, metrics))) == said


@pytest.mark.parametrize("what", ["topdown", "curve"])
def test_a_run_is_plotted(run, what):
    with Image.open(io.BytesIO(run.plot(what)._repr_png_())) as picture:
        assert min(picture.size) > 500


def test_without_pandas_it_is_one_sentence(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(anm_mj.AnmError, match="pip install pandas"):
        run.data_frame()


@pytest.mark.slow
def test_a_users_script_passes_a_strict_type_checker(tmp_path):
    pyright = shutil.which("pyright", path=str(Path(sys.executable).parent))
    if pyright is None:
        pytest.skip("no pyright in this environment")
    (tmp_path / "user.py").write_text(USER)
    settings = {"include": ["user.py"], "typeCheckingMode": "strict", "extraPaths": [str(ROOT)]}
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(settings))
    words = [pyright, "--pythonpath", sys.executable, "--outputjson", "--project", str(tmp_path)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=280)
    found = [(one["range"]["start"]["line"], one["message"]) for one in json.loads(done.stdout)["generalDiagnostics"]]
    # A misspelt name, in the last line, is the only thing that it finds, whose type is then unknown.
    assert {line for line, _ in found} == {len(USER.splitlines()) - 1}, found
    assert any('"explore_seen" is not a known attribute' in message for _, message in found)


def test_dir_names_what_is_public():
    assert [name for name in dir(anm_mj) if not name.startswith("__")] == sorted(anm_mj.__all__)
