import subprocess
import sys
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from PIL import Image
from PIL.ImageColor import getrgb

from anm_mj.localisation.localiser import PoseEstimate, RegistrationQuality, TrackingState
from anm_mj.recording.results import write_results
from anm_mj.types import OCCUPIED, UNKNOWN, Pose2, StopReason, TopDownMap
from anm_mj.viz import palette, plots
from anm_mj.viz.figure_file import KINDS, plain, save_figure
from anm_mj.viz.plots import curve_figure, topdown_figure
from tests.box_room import FakeMap, ended, new_recorder, observe, room_plan


def draw(path, **changes):
    plan = room_plan()
    poses = changes.pop("poses", [Pose2(0.1 * k, 0.0, 0.5) for k in range(9)])
    target, kinds = changes.pop("target_xy_m", plan.target_xy_m), changes.pop("kinds", ("png",))
    title = "box, 85.8 % complete, 60 steps"
    save_figure(topdown_figure(replace(plan, **changes), poses, target_xy_m=target, title=title), path, kinds)
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB")).astype(int)


def centre_of(picture, colour):
    close = np.abs(picture - colour).max(axis=2) < 8
    assert close.any()
    rows, cols = np.nonzero(close)
    return np.median(rows), np.median(cols)


def test_world_x_points_right_and_world_y_up(tmp_path):
    target_row, target_col = centre_of(draw(tmp_path / "a.png"), getrgb(palette.TARGET))
    moved = np.array([-1.0, -1.0])
    moved_row, moved_col = centre_of(draw(tmp_path / "b.png", target_xy_m=moved), getrgb(palette.TARGET))
    assert moved_col < target_col - 100
    assert moved_row > target_row + 100


def test_a_metre_is_as_long_along_x_as_along_y(tmp_path):
    picture = draw(tmp_path / "a.png", graph=None, regions=(), poses=[], target_xy_m=None)
    walls = np.abs(picture - [0x3A, 0x3A, 0x3F]).max(axis=2) < 4
    # Long runs only, so that letters and ticks do not count.
    rows = np.flatnonzero(walls.sum(axis=1) > 300)
    cols = np.flatnonzero(walls.sum(axis=0) > 300)
    assert np.ptp(cols) / np.ptp(rows) == pytest.approx(4.0 / 3.0, rel=0.01)


CURVE = ("step", "completion_ratio", "observable_ratio", "completion_cm")


@pytest.mark.parametrize(
    "missing",
    [
        {"graph": None},
        {"regions": ()},
        {"poses": []},
        {"poses": [Pose2(0.0, 0.0, 0.0)]},
        {"poses": [None, None]},
        {"target_xy_m": None},
    ],
)
def test_topdown_without_graph_and_poses(tmp_path, missing):
    assert draw(tmp_path / "a.png", **missing).shape[0] > 500


def test_no_line_leads_to_where_the_robot_was_found_again(tmp_path):
    known = [Pose2(-1.5 + 0.1 * k, -0.5, 0.0) for k in range(6)], [Pose2(1.0 + 0.1 * k, -0.5, 0.0) for k in range(6)]
    plan = replace(room_plan(), graph=None, regions=())
    figure = topdown_figure(plan, [None, *known[0], None, *known[1], None], target_xy_m=None, title="box")
    (line,) = [each for each in figure.axes[0].collections if isinstance(each, LineCollection)]
    ends = np.array(line.get_segments())
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max() < 0.11
    steps = line.get_array()
    assert steps is not None
    assert steps.tolist() == [*range(1, 6), *range(8, 13)]
    assert line.get_clim() == (0.0, 14.0)
    at = {str(each.get_label()): np.ravel(each.get_xydata()).tolist() for each in figure.axes[0].get_lines()}
    assert (at["start"], at["end"]) == ([-1.5, -0.5], [1.5, -0.5])


def test_the_picture_of_a_run_knows_where_the_robot_was_lost(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(
        plots, "topdown_figure", lambda plan, poses, **said: drawn.extend(poses) or topdown_figure(plan, poses, **said)
    )
    with new_recorder(tmp_path / "run") as recorder:
        for step in range(6):
            seen = observe(step, Pose2(0.1 * step, 0.0, 0.0))
            state = TrackingState.LOST if step in (2, 3) else TrackingState.TRACKING
            quality = RegistrationQuality(1.0, 1.0, 6)
            recorder.observation(seen, PoseEstimate(seen, 1e-4 * np.eye(6), quality, state, usable=True))
        write_results(recorder, ended(StopReason.BUDGET, 1.0), FakeMap(), room_plan(), wall_s=1.0)
    assert [None if pose is None else round(pose.x_m, 1) for pose in drawn] == [0.0, 0.1, None, None, 0.4, 0.5]


@pytest.mark.parametrize("num_rows", [0, 1, 40])
def test_curve_is_drawn_however_short(tmp_path, num_rows):
    steps = 10.0 * np.arange(num_rows)
    ratio = 95.0 * (1.0 - np.exp(-steps / 100.0))
    columns = dict(zip(CURVE, (steps, ratio, ratio + 5.0, 100.0 - ratio), strict=True))
    save_figure(curve_figure(columns, title="box"), tmp_path / "curve.png")
    with Image.open(tmp_path / "curve.png") as picture:
        assert min(picture.size) > 500


@pytest.mark.slow
def test_print_and_vector_figures_have_the_same_bytes_every_time(tmp_path):
    for name in ("a", "b"):
        draw(tmp_path / f"{name}.png", kinds=KINDS)
    for kind in KINDS:
        assert (tmp_path / f"b.{kind}").read_bytes() == (tmp_path / f"a.{kind}").read_bytes()
    printed, vector = (tmp_path / "a.pdf").read_bytes(), (tmp_path / "a.svg").read_text()
    assert printed.startswith(b"%PDF")
    # Publishers refuse fonts of type 3.
    assert b"/TrueType" in printed or b"/CIDFontType2" in printed
    assert b"/Type3" not in printed
    assert ElementTree.fromstring(vector).tag.endswith("svg")
    assert "dc:date" not in vector


def test_free_and_unknown_space_differ_in_grey():
    colours = [palette.WALL, palette.UNKNOWN, palette.NEAR, palette.CLEAR]
    grey = [float(np.dot(getrgb(colour), [0.299, 0.587, 0.114])) for colour in colours]
    assert np.diff(grey).min() > 20.0


def test_a_drop_is_no_wall_in_the_picture():
    state = np.full((1, 3), OCCUPIED, np.int8)
    state[0, 2] = UNKNOWN
    no_floor = np.array([[True, False, False]])
    image = palette.tint(TopDownMap(np.zeros((1, 3), np.float32), state, 0.05, np.zeros(2), no_floor=no_floor))
    assert [tuple(pixel) for pixel in image[0]] == [
        getrgb(colour) for colour in (palette.NO_FLOOR, palette.WALL, palette.UNKNOWN)
    ]


def test_the_legend_shows_the_gradient_of_free_space(tmp_path):
    picture = draw(tmp_path / "a.png", graph=None, regions=(), poses=[], target_xy_m=None)
    below = picture[int(0.9 * len(picture)) :]
    for share in (0.05, 0.5):
        assert (np.abs(below - palette.free_tint(np.array(share)).astype(int)).max(axis=2) < 4).sum() > 8


@pytest.mark.parametrize("known", [True, False])
def test_the_headline_metric_is_drawn_where_it_is_known(known):
    steps, ratio = 10.0 * np.arange(20), np.linspace(0.0, 60.0, 20)
    observable = ratio + 30.0 if known else np.full(20, np.nan)
    columns = dict(zip(CURVE, (steps, ratio, observable, 100.0 - ratio), strict=True))
    axes = curve_figure(columns, title="box").axes[0]
    assert any("observable" in str(line.get_label()) for line in axes.get_lines()) == known
    # The axis ends above the highest curve.
    assert axes.get_ylim() == (0.0, 100.0 if known else 70.0)


def test_matplotlib_state_is_unchanged():
    program = "import anm_mj.viz.plots, sys; assert 'matplotlib.pyplot' not in sys.modules"
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.mark.parametrize("text", ["$\\frac{1$", "a$b", "\\$x$", "$$", "5 $ and $ 6"])
def test_a_name_is_drawn_as_it_stands(text):
    figure = Figure()
    drawn = figure.suptitle(plain(text))
    shown, is_math = drawn._preprocess_math(drawn.get_text())
    assert (shown, is_math) == (text, False)
    FigureCanvasAgg(figure).draw()
