"""What misfits of frames look like."""

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from anm_mj.io.run_folder import RunFolder
from anm_mj.io.run_records import FrameRecord
from anm_mj.localisation.localiser import PoseEstimate, RegistrationQuality, TrackingState
from anm_mj.mapping.mapping_config import MAPPING_PRESETS
from anm_mj.mapping.neural_map import NeuralMap
from anm_mj.mapping_results import frame_metrics
from anm_mj.sequence_check.frame_fit import FrameFit, fit_metrics, frame_fit, jumps, misfits, say_misfits
from anm_mj.types import Pose2
from anm_mj.viz import plots
from tests.box_room import observe

GOOD, BAD, UNKNOWN = FrameFit(0.9, 0.98, 0.01), FrameFit(0.9, 0.2, 0.05), FrameFit(0.1, None, None)
WAY = np.arange(12)[:, None] * np.array([0.1, 0.0, 0.0])


def test_a_single_outlier_is_named(caplog):
    fits = [UNKNOWN] * 3 + [GOOD] * 4 + [BAD] + [GOOD] * 4
    xyz = WAY.copy()
    xyz[7, 1] = 1.8
    assert misfits(fits) == [7]
    assert jumps(xyz, [7]) == [7, 8]
    # An image before it could not be read.
    say_misfits(fits, xyz, range(12), range(1, 13))
    assert "jump: 1.80 m at frame 8 (7.000 s)" in caplog.text
    assert "those before: 8." in caplog.text
    assert "single outliers" in caplog.text


def test_the_picture_numbers_frames_as_the_warning_does(tmp_path, caplog, monkeypatch):
    drawn: list[Figure] = []
    monkeypatch.setattr(plots, "save_figure", lambda figure, path: drawn.append(figure))
    fits, where = [UNKNOWN] * 3 + [GOOD] * 4 + [BAD] + [GOOD] * 4, (Pose2(0.0, 0.0, 0.0), np.eye(4))
    # The images of 20 frames could not be read.
    steps = [step if step < 5 else step + 20 for step in range(12)]
    frame_metrics(RunFolder(tmp_path), fits, [FrameRecord(step, 0.1 * step, *where, *where) for step in steps], None)
    assert "those before: 27." in caplog.text
    values, marks = drawn[0].axes[0].get_lines()
    assert values.get_xdata().tolist() == steps[3:]
    assert marks.get_xdata() == [27, 27]


def test_a_lost_camera_fits_no_map_and_does_not_jump(tmp_path, caplog):
    seen, quality = observe(7, Pose2(0.3, 0.0, 0.2)), RegistrationQuality(1.0, 1.0, 6)
    neural_map = NeuralMap(MAPPING_PRESETS["quick"](), seed=0, device="cpu")
    neural_map.integrate(seen)
    estimate = PoseEstimate(seen, 1e-4 * np.eye(6), quality, TrackingState.TRACKING, usable=True)
    assert frame_fit(seen, neural_map, estimate).known > 0.9
    assert frame_fit(seen, neural_map, replace(estimate, state=TrackingState.LOST)) == FrameFit(0.0, None, None)

    records = []
    for step, xyz in enumerate(WAY):
        T = np.eye(4)
        T[:3, 3] = xyz + (4.0 if step in (5, 6) else 0.0)
        records.append(FrameRecord(step, 0.1 * step, seen.pose, T, seen.pose, T, is_lost=step in (5, 6)))
    frame_metrics(RunFolder(tmp_path), [GOOD] * 12, records, None)
    assert "jump" not in caplog.text


def test_two_interleaved_tracks_are_named(caplog):
    say_misfits([UNKNOWN] * 3 + [GOOD, BAD] * 8 + [GOOD], np.resize(WAY, (20, 3)) * 0, range(20), range(20))
    assert "interleaved" in caplog.text


def test_frames_that_fit_say_nothing(caplog):
    fits = [UNKNOWN] * 3 + [GOOD] * 9
    say_misfits(fits, WAY, range(12), range(12))
    assert not caplog.text
    assert fit_metrics(fits)["fit_percent"] == 98.0
    assert fit_metrics([UNKNOWN])["fit_percent"] is None
