"""The live view as a browser shows it."""

import re
import threading
import time

import numpy as np
import pytest
from PIL import Image

from anm_mj.events import Ended
from anm_mj.types import Pose2, StopReason
from anm_mj.viz.live_view import LiveView
from tests.box_room import observe, room_plan
from tests.viz.chromium import PROGRAM, Chromium
from tests.viz.shown_run import completed, mapped, show

CALM = "rgb(35, 38, 43)"


@pytest.mark.skipif(PROGRAM is None, reason="no chromium on this machine")
def test_the_page_shows_the_run_and_says_when_it_has_ended(tmp_path):
    viewer = LiveView(port=0, title="box, gvg, seed 0")
    text = "document.getElementById('{}').textContent".format
    with Chromium(tmp_path) as browser:
        browser.open(viewer.url, "window.live")
        while viewer._server.num_browsers == 0:
            time.sleep(0.01)
        # Nothing of meshcat's own look, and no frame around a picture that is not there.
        assert browser.evaluate("getComputedStyle(document.getElementById('meshcat-pane')).visibility") == "hidden"
        assert browser.evaluate("getComputedStyle(document.getElementById('picture')).display") == "none"
        assert browser.evaluate(text("step")) == "starting …"
        browser.keep("live_start")
        show(viewer, 30)
        viewer.progress(9, 500, completed(9, 12.0))
        browser.wait("document.getElementById('step').textContent.startsWith('9 ')")
        browser.evaluate("performance.now = (now => () => now() + 10_000)(performance.now.bind(performance)); 0")
        viewer.progress(29, 500, completed(29, 41.5))
        browser.wait("document.getElementById('step').textContent.startsWith('29')")
        # Twenty steps in ten seconds, and what the test itself has taken.
        assert re.fullmatch(r"(2\.0|1\.\d) steps/s, at most \d:\d\d min left", browser.evaluate(text("pace")))
        assert browser.evaluate(text("title")) == "box, gvg, seed 0"
        assert browser.evaluate(text("step")) == "29 of at most 500"
        assert browser.evaluate(text("coverage")) == "41.5 % of the observable surface"
        assert browser.evaluate(text("reason")) == room_plan().reason
        browser.wait("document.getElementById('picture').naturalWidth == 160")
        assert browser.evaluate("document.querySelectorAll('#layers label').length") == 8
        assert browser.evaluate("document.getElementById('ended').hidden")
        # A check box that was cleared stays so, whatever is planned; the pin is shown again with the box.
        target = "live.viewer.scene_tree.find(['meshcat', 'target']).object.visible"
        browser.evaluate("[...document.querySelectorAll('#layers label')].find(e => e.textContent == 'target').click()")
        show(viewer, 1, first=30)
        viewer.progress(30, 500, None)
        browser.wait("document.getElementById('step').textContent.startsWith('30')")
        assert not browser.evaluate(target)
        browser.evaluate("[...document.querySelectorAll('#layers label')].find(e => e.textContent == 'target').click()")
        assert browser.evaluate(target)
        with Image.open(browser.picture(tmp_path / "live.png")) as picture:
            shown = np.asarray(picture.convert("RGB")).astype(int)[150:700, 320:1050]
        assert not browser.evaluate("document.getElementById('curve').hidden")
        # The robot, its path and the walls, not an empty canvas.
        assert shown.std() > 8.0

        # It waits while the page has paused it, and ends when the page says so.
        follow = threading.Thread(target=lambda: answers.append(viewer.on_event(mapped(31))))
        answers = []
        browser.evaluate("pause.click()")
        browser.wait("pause.textContent == 'Go on'")
        browser.keep("live_paused")
        follow.start()
        follow.join(0.3)
        assert answers == []
        browser.evaluate("pause.click()")
        follow.join(20)
        browser.wait("pause.textContent == 'Pause'")
        browser.evaluate("document.getElementById('stop').click()")
        browser.wait("pause.disabled")
        assert [*answers, viewer.on_event(mapped(32))] == [False, True]

        viewer.on_event(Ended(StopReason.COMPLETE, 30, 1.0, observe(30, Pose2(0.5, 0.5, 0.0))))
        viewer.close()
        browser.wait("!document.getElementById('ended').hidden")
        assert browser.evaluate(text("ended")) == "Complete after 30 steps. Replay it: anm-mj view runs/latest"
        browser.keep("live_ended")
        assert browser.evaluate("getComputedStyle(document.getElementById('ended')).color") == CALM
        assert browser.evaluate(text("step")) == "30 of at most 500"
        assert browser.problems == []
