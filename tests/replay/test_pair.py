"""Two replays beside each other: step and view move together."""

import pytest

from anm_mj.cli.main import main
from tests.replay.conftest import box_run
from tests.viz.chromium import PROGRAM, Chromium

pytestmark = pytest.mark.skipif(PROGRAM is None, reason="no chromium on this machine")
LEFT, RIGHT = "pair.replays[0]", "pair.replays[1]"
EYE = "{0}.viewer.camera.position.toArray()"


def test_step_and_view_move_together(run_folder, tmp_path):
    path = tmp_path / "pair.html"
    assert main(["view", str(run_folder), str(box_run(tmp_path / "short", 20)), "--export-html", str(path)]) == 0
    with Chromium(tmp_path) as browser:
        browser.open(path.as_uri(), "window.pair")
        assert browser.evaluate(f"[{LEFT}.num, {RIGHT}.num]") == [41, 21]
        for leading, step, shown in ((LEFT, 12, [12, 12]), (RIGHT, 7, [7, 7]), (LEFT, 33, [33, 20])):
            browser.evaluate(f"{leading}.show({step})")
            assert browser.evaluate(f"[{LEFT}.state().frame, {RIGHT}.state().frame]") == shown
        assert browser.evaluate(EYE.format(LEFT)) == pytest.approx(browser.evaluate(EYE.format(RIGHT)))
        before = browser.evaluate(EYE.format(LEFT))
        browser.evaluate(f"{RIGHT}.view.look('top')")
        after = browser.evaluate(EYE.format(LEFT))
        assert after != pytest.approx(before, abs=0.1)
        assert after == pytest.approx(browser.evaluate(EYE.format(RIGHT)))
        for width, height, across in ((1280, 800, True), (390, 844, False)):
            browser.resize(width, height)
            (left, top), (x, y) = browser.evaluate(
                "['left', 'right'].map(id => document.getElementById(id).getBoundingClientRect()).map(b => [b.x, b.y])"
            )
            browser.keep(f"pair_{width}x{height}")
            assert (x > left and y == top) if across else (x == left and y > top)
        assert browser.problems == []
        assert not [url for url in browser.requests if url.startswith("http")]
