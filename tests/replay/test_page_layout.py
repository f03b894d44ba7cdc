"""The replay in a browser: where everything stands at each size, and what keys, buttons and the curve do."""

import base64
import json
import re
import time
from itertools import combinations

import numpy as np
import pytest

from tests.viz.chromium import PROGRAM, Chromium

pytestmark = pytest.mark.skipif(PROGRAM is None, reason="no chromium on this machine")

SIZES = [(1280, 800), (390, 844), (844, 390), (900, 500)]
BOXES = """Object.fromEntries(["status", "legend", "ruler", "bar"].map(id => {
  const box = document.getElementById(id).getBoundingClientRect();
  return [id, [box.left, box.top, box.right, box.bottom]];
}))"""
SCENE = """(() => {
  const box = new MeshCat.THREE.Box3().setFromBufferAttribute(replay.surface.geometry.attributes.position);
  const found = [Infinity, Infinity, -Infinity, -Infinity];
  replay.viewer.camera.updateMatrixWorld();
  for (let i = 0; i < 8; i++) {
    const [x, y, z] = [1, 2, 4].map((bit, axis) => (i & bit ? box.max : box.min).getComponent(axis));
    const at = new MeshCat.THREE.Vector3(x, z, -y).project(replay.viewer.camera);
    const px = [(at.x + 1) / 2 * innerWidth, (1 - at.y) / 2 * innerHeight];
    for (let k = 0; k < 2; k++) { found[k] = Math.min(found[k], px[k]); found[k + 2] = Math.max(found[k + 2], px[k]); }
  }
  return found;
})()"""


@pytest.fixture(scope="module")
def browser(page, tmp_path_factory):
    with Chromium(tmp_path_factory.mktemp("chromium")) as browser:
        browser.open(page.as_uri(), "window.replay && document.readyState == 'complete'")
        yield browser
        assert browser.problems == []
        assert [url for url in browser.requests if not url.startswith("data:")] == [page.as_uri()]


def press(browser, key):
    code = {"windowsVirtualKeyCode": 27} if key == "Escape" else {}
    for kind in ("keyDown", "keyUp"):
        browser.call("Input.dispatchKeyEvent", type=kind, key=key, text=key if len(key) == 1 else "", **code)


def click(browser, x, y):
    for kind in ("mousePressed", "mouseReleased"):
        browser.call(
            "Input.dispatchMouseEvent",
            type=kind,
            x=x,
            y=y,
            button="left",
            buttons=int(kind == "mousePressed"),
            clickCount=1,
        )


def click_on(browser, name, along=0.5):
    x, y = browser.evaluate(
        f"(box => [box.left + {along} * box.width, box.top + box.height / 2])(document.getElementById('{name}')"
        ".getBoundingClientRect())"
    )
    click(browser, x, y)


def frame(browser):
    return browser.evaluate("replay.state().frame")


def apart(one, other):
    return one[2] <= other[0] or other[2] <= one[0] or one[3] <= other[1] or other[3] <= one[1]


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_nothing_overlaps_and_the_scene_is_in_view(browser, width, height):
    browser.resize(width, height)
    for is_open in ("true", "false"):
        browser.evaluate(f"legend.open = {is_open}; new Promise(done => setTimeout(done, 50))")
        for view in ("home", "top"):
            browser.evaluate(f"replay.view.look('{view}')")
            browser.keep(f"replay_{width}x{height}_{view}_{'open' if is_open == 'true' else 'closed'}")
            boxes = browser.evaluate(BOXES) | {"scene": browser.evaluate(SCENE)}
            for (name, one), (other_name, other) in combinations(boxes.items(), 2):
                assert apart(one, other), (name, one, other_name, other)
            for name, (left, top, right, bottom) in boxes.items():
                assert left >= 0, name
                assert top >= 0, name
                assert right <= width, name
                assert bottom <= height, name
    # No button is cut off.
    assert browser.evaluate("[...document.querySelectorAll('#bar button')].every(one => one.scrollWidth > 0 &&"
                            "one.getBoundingClientRect().right <= bar.getBoundingClientRect().right)")  # fmt: skip


def test_keys_work_wherever_the_focus_is(browser):
    browser.resize(1280, 800)
    for name in ("play", "slider", "colouring", "home"):
        browser.evaluate("replay.show(20)")
        click_on(browser, name)
        if name == "colouring":
            press(browser, "Escape")
        browser.evaluate("replay.play(false); replay.show(20)")
        press(browser, "ArrowRight")
        assert frame(browser) == 21, name
        press(browser, "ArrowLeft")
        assert frame(browser) == 20, name
        press(browser, "End")
        assert frame(browser) == 40, name
        press(browser, "Home")
        assert frame(browser) == 0, name
        press(browser, " ")
        assert browser.evaluate("replay.state().playing"), name
        press(browser, " ")
        assert not browser.evaluate("replay.state().playing"), name
    press(browser, "?")
    assert browser.evaluate("document.getElementById('keys').open")
    press(browser, "Escape")
    assert not browser.evaluate("document.getElementById('keys').open")


def test_a_click_on_the_curve_goes_to_that_step(browser):
    browser.resize(1280, 800)
    browser.evaluate("replay.show(0)")
    click_on(browser, "curve", along=0.99)
    assert frame(browser) == 40
    click_on(browser, "curve", along=0.56)
    assert 18 <= frame(browser) <= 23


def test_the_view_follows_the_robot_and_zoom_ends(browser):
    browser.resize(1280, 800)
    click_on(browser, "follow")
    target = "[replay.viewer.controls.target.x, -replay.viewer.controls.target.z]"
    for step in (0, 40):
        browser.evaluate(f"replay.show({step})")
        state = browser.evaluate("replay.state()")
        assert browser.evaluate(target) == pytest.approx([state["x"], state["y"]], abs=1e-6)
    click_on(browser, "home")
    whole = browser.evaluate("replay.view.distance()")
    for turns, low, high in ((200, 1.5, 3.0), (-200, 0.0, 0.5)):
        browser.evaluate(f"for (let i = 0; i < 100; i++) replay.viewer.renderer.domElement.dispatchEvent("
                         f"new WheelEvent('wheel', {{deltaY: {turns}, bubbles: true, cancelable: true}}))")  # fmt: skip
        assert low * whole < browser.evaluate("replay.view.distance()") <= max(high * whole, 0.5 + 1e-6)
    click_on(browser, "home")
    assert browser.evaluate("replay.view.distance()") == pytest.approx(whole)


AXIS = "['x2', 'y2'].map(end => Number(document.querySelector('[data-axis={}] line').getAttribute(end)))"


def test_the_scale_bar_and_the_axes_are_those_of_the_view(browser):
    browser.resize(1280, 800)
    click_on(browser, "top")
    assert browser.evaluate("document.getElementById('top').getAttribute('aria-pressed')") == "true"
    # On the screen y is down: from above, x is right, y up and z towards the eye.
    for axis, end in (("x", [10, 0]), ("y", [0, -10]), ("z", [0, 0])):
        assert browser.evaluate(AXIS.format(axis)) == pytest.approx(end, abs=0.05)
    text = browser.evaluate("document.getElementById('length').textContent")
    width = browser.evaluate("document.querySelector('#ruler i').getBoundingClientRect().width")
    number, unit = text.split()
    left, right = browser.evaluate(
        "[0, 1].map(x => (new MeshCat.THREE.Vector3(x, 0, 0).project(replay.viewer.camera).x + 1) / 2 * innerWidth)"
    )
    assert width / (right - left) == pytest.approx(float(number) * {"m": 1.0, "cm": 0.01}[unit], rel=0.02)
    click_on(browser, "home")


def test_a_colouring_has_a_scale_with_units(browser):
    scale = "[...document.querySelectorAll('#scale span')].map(one => one.textContent)"
    shown = "document.getElementById('scale').getBoundingClientRect().height > 0"
    names = browser.evaluate("[...colouring.options].map(one => one.textContent)")
    assert names == ["surface as seen", "true error", "first seen"]
    browser.evaluate("legend.open = true")
    for index, ends in ((0, None), (1, r"≤ [\d.]+ mm"), (2, "step 0")):
        browser.evaluate(f"colouring.value = {index}; colouring.dispatchEvent(new Event('change'))")
        assert browser.evaluate(shown) == (index > 0)
        assert ends is None or re.fullmatch(ends, browser.evaluate(scale)[0])
        browser.keep(f"replay_{names[index].replace(' ', '_')}")
    browser.evaluate("colouring.value = 0; colouring.dispatchEvent(new Event('change'))")


def changed(page, path, change):
    """The page with other data."""
    head, rest = page.read_text().split('<script id="data" type="application/json">')
    text, tail = rest.split("</script>", 1)
    data = json.loads(text)
    change(data)
    path.write_text(f'{head}<script id="data" type="application/json">{json.dumps(data)}</script>{tail}')
    return path


def encoded(values):
    return base64.b64encode(values.astype("<f4").tobytes()).decode()


def test_the_legend_names_what_is_drawn(browser, page, tmp_path):
    words = "[...document.querySelectorAll('#layers label')].map(one => one.textContent)"
    shown = browser.evaluate(words)
    assert shown[-3:] == ["regions of interest", "planned path", "target"]
    assert browser.evaluate("document.getElementById('pose').hidden")

    def localised(data):
        for graph in data["graphs"]:
            graph["regions"] = []
        for plan in data["plans"]:
            plan["target"] = None
        places = np.frombuffer(base64.b64decode(data["poses"]), "<f4").reshape(-1, 3)[:, :2]
        data["truth"] = encoded(np.add(places, [0.0, 0.3]))
        data["ellipses"] = encoded(np.tile([0.4, 0.2, 0.0], (len(places), 1)))
        data["lost"] = [3]

    other = changed(page, tmp_path / "other.html", localised)
    shown = [one for one in shown if one not in ("regions of interest", "target")]
    shown += ["true trajectory", "2 sigma of the position"]
    with Chromium(tmp_path) as browser:
        browser.open(other.as_uri(), "window.replay")
        pose = "document.getElementById('pose').textContent"
        assert browser.evaluate(pose) == "30.0 cm off, 2 sigma 40.0 cm"
        picture = (
            "(() => { let found = null; replay.viewer.scene.traverse((one) => { if (one.isMesh && one.material.map) "
            "found = one; }); return found.visible; })()"
        )
        browser.wait(picture)
        assert browser.evaluate(f"replay.show(3); {pose}") == "lost"
        # Neither the picture that was loaded before nor its own is drawn where the camera may never have been.
        time.sleep(0.3)
        assert not browser.evaluate(picture)
        browser.keep("replay_lost")
        browser.evaluate("replay.show(4)")
        browser.wait(picture)
        assert browser.evaluate(words) == shown


def test_the_page_is_dark_where_the_system_is(browser):
    ink = "getComputedStyle(document.body).color"
    light = browser.evaluate(ink)
    browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}])
    browser.wait(f"{ink} != '{light}'")
    sky = "replay.viewer.scene_tree.find(['Background']).object.top_color"
    browser.wait(f"{sky}[0] < 80")
    browser.keep("replay_dark")
    browser.call("Emulation.setEmulatedMedia", features=[])
    browser.wait(f"{ink} == '{light}' && {sky}[0] == 255")
