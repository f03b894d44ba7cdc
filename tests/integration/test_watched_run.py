"""The live page changes nothing: a run that is watched writes the same bytes as one that is not."""

import asyncio
import threading

import pytest
from tornado.websocket import websocket_connect

from anm_mj.config import make_config
from anm_mj.run import run
from anm_mj.viz.live_view import LiveView
from tests.integration.test_small_scene import without_times
from tests.scene.small import make_small_scene

STEPS = 15


class Watcher:
    """Reads everything that the page is told, as a browser does."""

    def __init__(self, port: int):
        self.meshes = 0
        self._open = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._watch(port)))
        self._thread.start()
        assert self._open.wait(20)

    async def _watch(self, port: int) -> None:
        page = await websocket_connect(f"ws://127.0.0.1:{port}/", max_message_size=1 << 28)
        self._open.set()
        while (message := await page.read_message()) is not None:
            self.meshes += isinstance(message, bytes) and b"/meshcat/mesh" in message
        page.close()
        await asyncio.sleep(0.05)

    def join(self) -> None:
        self._thread.join(20)


@pytest.mark.slow
def test_a_watched_run_writes_the_same_bytes(tmp_path):
    make_small_scene(tmp_path / "small")
    config = make_config("quick", [], scene=str(tmp_path / "small"), steps=STEPS, seed=2, device="cpu")
    run(config, out=tmp_path / "alone")
    viewer = LiveView(port=0)
    watcher = Watcher(int(viewer.url.split(":")[2].split("/")[0]))
    try:
        run(config, out=tmp_path / "watched", observers=(viewer,))
    finally:
        viewer.close()
        watcher.join()
    assert watcher.meshes >= 1
    alone, watched = tmp_path / "alone", tmp_path / "watched"
    for name in ("mesh.ply", "map.safetensors", "trajectory.tum", "frames.jsonl", "curve.csv"):
        assert (watched / name).read_bytes() == (alone / name).read_bytes(), name
    for name in ("steps.jsonl", "plans.jsonl"):
        assert without_times(watched / name) == without_times(alone / name), name
