"""What misfits of frames look like."""

import numpy as np

from anm_mj.sequence_check.frame_fit import FrameFit, fit_metrics, jumps, misfits, say_misfits

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


def test_two_interleaved_tracks_are_named(caplog):
    say_misfits([UNKNOWN] * 3 + [GOOD, BAD] * 8 + [GOOD], np.resize(WAY, (20, 3)) * 0, range(20), range(20))
    assert "interleaved" in caplog.text


def test_frames_that_fit_say_nothing(caplog):
    fits = [UNKNOWN] * 3 + [GOOD] * 9
    say_misfits(fits, WAY, range(12), range(12))
    assert not caplog.text
    assert fit_metrics(fits)["fit_percent"] == 98.0
    assert fit_metrics([UNKNOWN])["fit_percent"] is None
