"""What users import reads a run as arrays and as a data frame, and passes a strict type checker."""

import base64
import inspect
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
from anm_mj.errors import ConfigError
from anm_mj.events import On
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


def test_a_figure_that_a_run_has_not_is_refused(run):
    # Called past the tests' own check of types, which users have not.
    with pytest.raises(ConfigError, match="no figure 'completion'; choose one of topdown, curve"):
        inspect.unwrap(type(run).plot)(run, "completion")


@pytest.mark.parametrize(
    ("answer", "ends"), [(True, True), (np.True_, True), (np.False_, False), (None, False), (1, False), ("yes", False)]
)
def test_a_run_ends_where_on_step_says_true_in_python_or_numpy(answer, ends):
    assert On(int, lambda event: answer).on_event(3) is ends
    assert On(str, lambda event: answer).on_event(3) is False


WRONG = {
    "start=(1, 2)": "start is (1, 2)",
    "start='1,2,3'": "start is '1,2,3'",
    "start=(1, 2, float('nan'))": "start is (1, 2, nan)",
    "steps=2.0": "steps is 2.0",
    "steps='500'": "steps is '500'",
    "seed=1.5": "seed is 1.5",
    "people=1.5": "people.number=1.5",
    "policy=3": "policy is 3",
    "preset=['quick']": "preset is ['quick']",
    "sensor=5": "sensor is 5",
    "reality=3": "reality is 3",
    "robot=3": "robot is 3",
    "device=None": "device is None",
    "return_to_start='yes'": "return_to_start is 'yes'",
    "continue_from=3": "continue_from is 3",
    "record={'images': 'full'}": "record is {'images': 'full'}, but explore_scene has no such option",
    "foo=3": "foo is 3, but explore_scene has no such option",
    "kind=3": "kind is 3, but explore_scene has no such option",
    "settings=[3]": "settings is [3]",
    "settings='planning.margin=0.06'": "--set planning.margin: there is no such setting",
    "out=5": "out is 5",
    "on_step=3": "on_step is 3",
    "observers=[3]": "observers is [3]",
}
"""Options of an exploration that cannot be, and what is said of them."""


def without_type_checks(program, place):
    """What a program prints in an interpreter of its own, where nothing checks the types of arguments."""
    words = [sys.executable, "-c", "import anm_mj\n" + program]
    done = subprocess.run(words, cwd=place, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_a_wrong_option_is_one_sentence_and_leaves_no_folder(tmp_path):
    program = "def refused(**options):\n    try: anm_mj.explore_scene('room', **{'steps': 1, **options})\n"
    program += "    except anm_mj.AnmError as err: print(type(err).__name__, err)\n"
    said = without_type_checks(program + "\n".join(f"refused({options})" for options in WRONG), tmp_path)
    for line, words in zip(said, WRONG.values(), strict=True):
        assert line.startswith("ConfigError")
        assert words in line
    assert list(tmp_path.iterdir()) == []


def test_options_of_an_exploration_may_be_of_numpy_and_one_setting_a_text(tmp_path):
    program = (
        "import numpy as np, pathlib\n"
        "made = anm_mj.explore_scene('room', steps=np.int64(1), seed=np.uint8(2), start=np.array([2.5, 2.4, 15]),\n"
        "    people=1, goal='coverage', return_to_start=np.False_, settings='image_px=32', out=pathlib.Path('run'))\n"
        "config = anm_mj.load_run(made.folder).config\n"
        "print(config['seed'], config['start'], config['people']['number'], config['image_px'])\n"
    )
    assert without_type_checks(program, tmp_path) == ["2 [2.5, 2.4, 15.0] 1 32"]


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
