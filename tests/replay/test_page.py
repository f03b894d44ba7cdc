import shutil
import threading
import urllib.error
import urllib.request
from contextlib import closing

import numpy as np
import pytest
from PIL import Image

from anm_mj.cli.main import main
from anm_mj.io.run_folder import RunFolder
from anm_mj.io.to_json import write_json
from anm_mj.replay.page import _mesh, levels, replay_page
from anm_mj.replay.surface import GrowingMesh
from anm_mj.replay.timeline import read_timeline
from anm_mj.viz.page_server import PageServer
from tests.viz.chromium import PROGRAM, Chromium

needs_chromium = pytest.mark.skipif(PROGRAM is None, reason="no chromium on this machine")


def colours(path):
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB")).astype(int)


@needs_chromium
def test_the_page_replays_the_run_from_disk_without_a_network(page, run_folder, tmp_path):
    timeline = read_timeline(run_folder)
    with Chromium(tmp_path) as browser:
        browser.open(page.as_uri(), "window.replay")
        assert browser.evaluate("replay.num") == timeline.num_frames == 41
        assert browser.evaluate("replay.state().frame") == 40
        browser.evaluate("new Promise(done => setTimeout(done, 300)); replay.show(0)")
        first = colours(browser.picture(tmp_path / "first.png"))

        browser.evaluate("slider.value = 30; slider.dispatchEvent(new Event('input'))")
        state = browser.evaluate("replay.state()")
        assert state["frame"] == 30
        np.testing.assert_allclose([state["x"], state["y"]], timeline.xy_m[30], atol=1e-5)
        assert browser.evaluate("document.getElementById('step').textContent") == "30 of 40"
        assert browser.evaluate("document.getElementById('reason').textContent") == timeline.run.plans[0]["reason"]
        browser.wait("document.getElementById('picture').naturalWidth == 128")
        later = colours(browser.picture(tmp_path / "later.png"))
        # The canvas between the cards: not blank, and another picture than at the start.
        middle = np.s_[150:700, 320:1050]
        assert later[middle].std() > 10.0
        assert (np.abs(later[middle] - first[middle]).max(axis=2) > 30).mean() > 0.05

        browser.evaluate("colouring.value = 1; colouring.dispatchEvent(new Event('change'))")
        coloured = colours(browser.picture(tmp_path / "coloured.png"))
        assert (np.abs(coloured[middle] - later[middle]).max(axis=2) > 30).mean() > 0.1

        browser.evaluate("replay.show(0); document.getElementById('play').click()")
        browser.wait("replay.state().frame >= 2")
        browser.evaluate("document.getElementById('play').click()")
        assert not browser.evaluate("replay.state().playing")
        assert browser.problems == []
        assert [url for url in browser.requests if not url.startswith("data:")] == [page.as_uri()]


def test_the_robot_is_drawn_as_wide_as_it_is(run_folder, tmp_path):
    wide = shutil.copytree(run_folder, tmp_path / "wide")
    assert '"radius":0.18' in replay_page(read_timeline(wide))
    write_json(RunFolder(wide).manifest, {"footprint": {"radius_m": 0.3, "z_min_m": 0.02, "z_max_m": 0.9}})
    assert '"radius":0.3' in replay_page(read_timeline(wide))


def test_a_run_that_was_killed_is_shown_as_far_as_it_came(run_folder, tmp_path):
    folder = tmp_path / "killed"
    folder.mkdir()
    for name in ("steps.jsonl", "frames.jsonl", "camera.json", "depth", "rgb"):
        (folder / name).symlink_to(run_folder / name)
    text = replay_page(read_timeline(folder))
    assert '"mesh":null' in text
    assert "<h1>killed</h1>" in text


def test_a_text_of_the_run_cannot_leave_its_place(run_folder, tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    for path in run_folder.iterdir():
        if path.name not in ("plans.jsonl", "manifest.json"):
            (folder / path.name).symlink_to(path)
    (folder / "manifest.json").write_text('{"scene": "<b>@DATA@"}')
    line = (run_folder / "plans.jsonl").read_text().splitlines()[0]
    (folder / "plans.jsonl").write_text(line.replace("the nearest place", "</script><b>") + "\n")
    text = replay_page(read_timeline(folder))
    assert "<b>" not in text
    assert "&lt;b&gt;@DATA@</h1>" in text


def test_a_folder_that_is_no_run_is_one_sentence(tmp_path, capsys):
    assert main(["view", str(tmp_path)]) == 2
    assert "is not the folder of a run" in capsys.readouterr().err


@pytest.mark.parametrize(("option", "said"), [(["--port", "7001"], "7001"), (["--no-browser"], "given")])
def test_a_page_in_a_file_is_not_served(run_folder, tmp_path, capsys, option, said):
    assert main(["view", str(run_folder), "--export-html", str(tmp_path / "x.html"), *option]) == 2
    assert f"{option[0]} is {said}, but the page becomes a file; leave out" in capsys.readouterr().err


def test_a_scene_is_refused_where_all_images_were_kept(run_folder, tmp_path, capsys):
    words = ["--export-html", str(tmp_path / "x.html"), "--scene", "home"]
    for runs in ([str(run_folder)], [str(run_folder)] * 2):
        assert main(["view", *runs, *words]) == 2
        assert "--scene is home, but the images that were kept are shown" in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("true_m", [None, np.full(101, 0.05, np.float32)])
def test_errors_have_a_unit_and_one_scale(true_m):
    mesh = GrowingMesh(
        np.zeros((101, 3), np.float32), np.zeros((1, 3), int), np.zeros((101, 3), np.uint8), np.zeros(101, int),
        np.ones(1, int), np.linspace(0.002, 0.012, 101, dtype=np.float32), true_m,
    )  # fmt: skip
    found = _mesh(mesh, 1)["errors"]
    assert [one["name"] for one in found] == ["expected error", "true error"][: len(found)]
    ends = ("≤ 2.2 mm", "≥ 12 mm") if true_m is None else ("≤ 2.4 mm", "≥ 50 mm")
    assert {(one["low"], one["high"]) for one in found} == {ends}
    assert len(found) == 1 + (true_m is not None)


def test_levels_are_even_in_the_logarithm():
    found = levels(np.geomspace(1e-5, 10.0, 1001), 1e-4, 1.0).astype(int)
    assert found[0] == found[160] == 0
    assert found[-1] == found[840] == 255
    assert abs(found[500] - 127.5) < 2
    assert levels(np.ones(5), 1.0, 1.0).tolist() == [0] * 5


def test_the_page_is_served_to_this_machine_only():
    with closing(PageServer(0, "page")) as server:
        with urllib.request.urlopen(server.url, timeout=10) as answer:
            assert answer.read() == b"page"
        for request in (
            server.url + "other",
            urllib.request.Request(server.url, headers={"Host": "evil.example:7000"}),
        ):
            with pytest.raises(urllib.error.HTTPError, match="404"):
                urllib.request.urlopen(request, timeout=10)
        waiting = threading.Thread(target=server.wait)
        waiting.start()
    waiting.join(10)
    assert not waiting.is_alive()
