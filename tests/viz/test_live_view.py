import asyncio
import contextlib
import json
import logging
import os
import socket
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import umsgpack
from tornado.websocket import websocket_connect

from anm_mj.errors import RenderError
from anm_mj.events import Ended, Observed
from anm_mj.io.run_events import Mapped, Started
from anm_mj.localisation.localiser import PoseEstimate, RegistrationQuality, TrackingState
from anm_mj.types import Footprint, MapUpdate, Pose2, StopReason
from anm_mj.viz import live_view, page_server
from anm_mj.viz.live_view import FIRST_MESH_STEP, MESH_EVERY_STEPS, LiveView
from tests.box_room import observe
from tests.viz.shown_run import CountingMap, completed, mapped, show


@pytest.fixture
def viewer():
    viewer = LiveView(port=0)
    yield viewer
    viewer.close()


def port_of(viewer) -> int:
    return int(viewer.url.split(":")[2].split("/")[0])


async def leave(page) -> None:
    page.close()
    while await page.read_message() is not None:
        pass


async def drawn(page) -> dict:
    """The next message that draws something; what stands in the card comes as text."""
    while True:
        message = await asyncio.wait_for(page.read_message(), 20)
        if isinstance(message, bytes):
            return umsgpack.unpackb(message)


def watch(viewer, enough: Callable[[dict], bool]) -> dict:
    """What an open page is told, by path, until it is enough."""
    told = {}

    async def listen():
        page = await websocket_connect(f"ws://127.0.0.1:{port_of(viewer)}/")
        while not enough(told):
            message = await drawn(page)
            told[message["path"], message.get("property", message["type"])] = message
        await leave(page)

    asyncio.run(listen())
    return told


def test_page_is_served_to_this_machine_only(viewer):
    with urllib.request.urlopen(viewer.url, timeout=10) as answer:
        assert b"MeshCat" in answer.read()
    listening = viewer._server
    others = [str(info[4][0]) for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)]
    for address in {address for address in others if not address.startswith("127.")}:
        with pytest.raises(OSError, match="refused"):
            socket.create_connection((address, listening.port), timeout=2).close()
    # All of 127/8 is this machine: a server on all interfaces would answer here too.
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.2", listening.port), timeout=2).close()


def test_foreign_host_name(viewer):
    request = urllib.request.Request(viewer.url, headers={"Host": "evil.example"})
    with pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(request, timeout=10)


def test_no_mesh_without_a_browser(viewer):
    mapper = CountingMap()
    show(viewer, 3 * MESH_EVERY_STEPS, mapper)
    assert mapper.num_meshes == 0


def test_late_browser(viewer):
    show(viewer, 60)
    names = ("robot", "camera", "graph", "regions", "path", "target/pin", "trajectory/0", "trajectory/1")
    wanted = {(f"/meshcat/{name}", "set_object") for name in names}
    wanted |= {("/meshcat/robot", "set_transform"), ("/meshcat/target", "set_transform")}
    told = watch(viewer, lambda told: wanted <= told.keys())
    # Column-major, as three.js has it: the translation stands last.
    assert told["/meshcat/robot", "set_transform"]["matrix"][12:15] == pytest.approx([0.59, 0.0, 0.0])
    assert told["/meshcat/target", "set_transform"]["matrix"][12:15] == pytest.approx([1.5, 1.0, 0.0])


def test_the_check_box_of_the_target_stays_the_users(viewer):
    """What says whether there is a target is a property of the pin in it."""
    show(viewer, 2)
    told = watch(viewer, lambda told: ("/meshcat/target/pin", "visible") in told and len(told) > 8)
    assert told["/meshcat/target/pin", "visible"]["value"] is True
    assert [path for path, name in told if name == "visible" and "<object>" not in path] == ["/meshcat/target/pin"]


def test_mesh_rate(viewer):
    mapper = CountingMap()
    show(viewer, 1)

    async def look():
        page = await websocket_connect(f"ws://127.0.0.1:{port_of(viewer)}/")
        await asyncio.to_thread(show, viewer, MESH_EVERY_STEPS, mapper, 1)
        paths = set()
        while "/meshcat/mesh" not in paths:
            paths.add((await drawn(page))["path"])
        await leave(page)

    asyncio.run(look())
    assert mapper.num_meshes == 1


def test_the_mesh_is_made_as_a_whole_when_the_run_has_doubled(viewer, monkeypatch):
    """Parts that are kept since the map was young would stand in shreds."""
    monkeypatch.setattr(live_view, "MESH_TIME_FRACTION", 1e9)
    mapper = CountingMap()

    async def look():
        page = await websocket_connect(f"ws://127.0.0.1:{port_of(viewer)}/")
        while viewer._server.num_browsers == 0:
            await asyncio.sleep(0.01)
        await asyncio.to_thread(show, viewer, 131, mapper)
        await leave(page)

    asyncio.run(look())
    # At steps 10, 30, 50, 70, 90, 110, 130.
    assert mapper.reused == [False, False, True, False, True, True, True]


def test_run_goes_on_when_a_browser_leaves(viewer):
    show(viewer, 2)
    watch(viewer, lambda told: len(told) > 3)
    show(viewer, 5, first=2)
    assert watch(viewer, lambda told: ("/meshcat/robot", "set_transform") in told)


def test_browser_that_never_reads(viewer):
    with socket.create_connection(("127.0.0.1", port_of(viewer))) as lazy:
        head = f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port_of(viewer)}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        lazy.sendall(f"{head}Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode())
        while viewer._server.num_browsers == 0:
            time.sleep(0.01)
        show(viewer, 200)
        (browser,) = viewer._server._browsers
        # One state per object at most, however many steps it has missed.
        assert len(browser._updates) < 40


def upgrade(port, origin):
    return (
        f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nOrigin: {origin}\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    ).encode()


def test_a_page_of_another_origin_reads_nothing(viewer):
    show(viewer, 1)
    port = port_of(viewer)
    for origin, status in (("http://evil.example", b"403"), (f"http://127.0.0.1:{port}", b"101")):
        with socket.create_connection(("127.0.0.1", port), timeout=10) as page:
            page.sendall(upgrade(port, origin))
            assert page.recv(4096).split()[1] == status


@pytest.mark.slow
def test_a_thousand_connections_that_say_nothing(viewer):
    """Half-open, malformed and oversized ones: an open page stays, a new one is served, and few files are open."""
    port, held = port_of(viewer), []
    words = (
        b"",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" * 50,
        b"GET /" + b"a" * 100_000,
        b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1000000000000\r\n\r\n",
        b"GET / HTTP/1.1\r\nContent-Length: -1\r\n\r\n",
        b"\x00" * 1000,
    )

    async def flood():
        page = await websocket_connect(f"ws://127.0.0.1:{port}/")
        for number in range(1000):
            client = socket.socket()
            client.setblocking(False)
            client.connect_ex(("127.0.0.1", port))
            held.append(client)
            if number % 20 == 0:
                await asyncio.sleep(0.01)
            with contextlib.suppress(OSError):
                client.send(words[number % len(words)])
        await asyncio.to_thread(show, viewer, 3)
        assert await drawn(page)
        await leave(page)

    files = len(os.listdir("/proc/self/fd"))
    try:
        asyncio.run(flood())
        assert len(os.listdir("/proc/self/fd")) - files - len(held) < page_server.MAX_CONNECTIONS + 20
        with urllib.request.urlopen(viewer.url, timeout=10) as answer:
            assert b"MeshCat" in answer.read()
    finally:
        for client in held:
            client.close()
    viewer.close()
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", port), timeout=2).close()


def test_a_flood_of_connections_is_taken_slowly(monkeypatch):
    """The first few at once; the next ones wait for their turns, and are served then."""
    monkeypatch.setattr(page_server, "BURST", 3)
    monkeypatch.setattr(page_server, "TAKEN_PER_S", 2.0)
    server, begin_s = page_server.PageServer(page="hello"), time.monotonic()
    clients = [socket.create_connection(("127.0.0.1", server.port), timeout=60) for _ in range(6)]
    try:
        for number, client in enumerate(clients):
            client.sendall(b"GET /static/ HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
            assert b"hello" in client.recv(4096)
            assert time.monotonic() - begin_s >= max(number - 2, 0) / 2.0 - 0.05
    finally:
        for client in clients:
            client.close()
        server.close()


def test_no_more_pages_than_a_few(viewer, monkeypatch):
    monkeypatch.setattr(page_server, "MAX_BROWSERS", 2)
    show(viewer, 1)

    async def look():
        pages = [await websocket_connect(f"ws://127.0.0.1:{port_of(viewer)}/") for _ in range(3)]
        assert await drawn(pages[0])
        assert await asyncio.wait_for(pages[2].read_message(), 10) is None
        pages[2].close()
        for page in pages[:2]:
            await leave(page)

    asyncio.run(look())


def test_broken_map(viewer, caplog):
    class Broken(CountingMap):
        def mesh(self, resolution_m: float, *, reuse: bool = False) -> trimesh.Trimesh:
            raise RuntimeError("no mesh today")

    show(viewer, 1)

    async def look():
        page = await websocket_connect(f"ws://127.0.0.1:{port_of(viewer)}/")
        await asyncio.to_thread(show, viewer, FIRST_MESH_STEP + 3, Broken(), 1)
        await leave(page)

    asyncio.run(look())
    assert caplog.text.count("An error disabled the live view") == 1


def test_close_frees_the_port():
    viewer = LiveView(port=0)
    port = port_of(viewer)
    show(viewer, 1)
    with socket.create_connection(("127.0.0.1", port)):
        viewer.close()
    viewer.close()
    assert not viewer._server._thread.is_alive()
    again = LiveView(port=port)
    assert port_of(again) == port
    again.close()


def test_next_free_port_is_taken_and_named(caplog):
    caplog.set_level(logging.INFO)
    first, second = LiveView(port=7360), LiveView(port=7360)
    assert port_of(second) > port_of(first) >= 7360
    assert f"ssh -L {port_of(second)}:127.0.0.1:{port_of(second)}" in caplog.text
    first.close()
    second.close()


def test_no_free_port_is_one_sentence(monkeypatch):
    monkeypatch.setattr(page_server, "PORTS_TRIED", 1)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(RenderError, match=f"None of the ports {port} to {port} is free .* --port"):
            LiveView(port=port)


def test_showing_after_the_close_does_nothing():
    viewer = LiveView(port=0)
    viewer.close()
    show(viewer, 2)


@pytest.mark.parametrize("ends", ["nobody looks", "Ctrl-C"])
def test_a_paused_run_waits_neither_for_a_page_that_is_closed_nor_at_ctrl_c(ends, monkeypatch):
    monkeypatch.setattr(live_view, "UNSEEN_S", 0.2 if ends == "nobody looks" else 1e9)
    viewer = LiveView(port=0, is_ending=lambda: ends == "Ctrl-C")
    viewer._on_word("pause")
    assert viewer.on_event(mapped(0)) is False
    viewer.close()


def test_the_robot_is_drawn_as_wide_as_it_is(viewer):
    viewer.on_event(Started(Path("runs/a"), 500, lambda: None, Footprint(0.3, 0.02, 0.9)))
    show(viewer, 1)
    told = watch(viewer, lambda told: ("/meshcat/robot", "set_object") in told)
    (geometry,) = told["/meshcat/robot", "set_object"]["object"]["geometries"]
    xyz = np.frombuffer(geometry["data"]["attributes"]["position"]["array"].data, np.float32).reshape(-1, 3)
    assert np.hypot(xyz[:, 0], xyz[:, 1]).max() == pytest.approx(0.3, abs=1e-4)


def test_the_last_figure_of_a_run_is_shown(viewer):
    rows = [completed(10, 12.0), completed(23, 41.5)]
    viewer.on_event(Started(Path("runs/a b"), 500, lambda: rows[-1]))
    viewer.on_event(Ended(StopReason.BUDGET, 23, 1.0, observe(23, Pose2(0.5, 0.5, 0.0))))
    viewer.close()
    said = {key: json.loads(text) for (key, kind), text in viewer._server._state.items() if kind == "text"}
    assert said["progress"]["completed"] == "41.5 % of the observable surface"
    assert said["curve"]["curve"] == [[23, 41.5]]
    assert said["ended"]["ended"] == "Done after 23 steps. Replay it: anm-mj view 'runs/a b'"


def test_a_lost_robot_is_not_drawn_and_its_trajectory_has_a_gap(viewer):
    """The pose of a lost camera may be of another world: here 9 m beside the room."""
    mapper: Any = CountingMap()
    shown: dict = {}
    for step in range(9):
        is_lost = 3 <= step < 6
        seen = observe(step, Pose2(0.1 * step, 9.0 if is_lost else 0.0, 0.0))
        state = TrackingState.LOST if is_lost else TrackingState.TRACKING
        estimate = PoseEstimate(seen, np.eye(6), RegistrationQuality(1.0, 1.0, 6), state, usable=not is_lost)
        viewer.on_event(Observed(seen, MapUpdate(0.0, 0, 0), estimate))
        viewer.on_event(Mapped(seen, mapper, None))
        shown = watch(viewer, lambda told: ("/meshcat/trajectory/0", "set_object") in told)
        assert {shown[f"/meshcat/{name}/<object>", "visible"]["value"] for name in ("robot", "camera")} == {not is_lost}
    (geometry,) = shown["/meshcat/trajectory/0", "set_object"]["object"]["geometries"]
    xyz = np.frombuffer(geometry["data"]["attributes"]["position"]["array"].data, np.float32).reshape(-1, 4, 3)
    # Bands from 0.0 to 0.2 m and from 0.6 to 0.8 m.
    np.testing.assert_allclose(xyz[:, :, 0].mean(axis=1), [0.05, 0.15, 0.65, 0.75], atol=1e-6)
    assert np.abs(xyz[:, :, 1]).max() < 0.1


def test_a_user_whom_the_system_does_not_know_watches_too(monkeypatch, caplog):
    def unknown() -> str:
        raise KeyError("getpwuid(): uid not found: 1234")

    monkeypatch.setattr("getpass.getuser", unknown)
    caplog.set_level("INFO")
    LiveView(port=0).close()
    said = next(record.getMessage() for record in caplog.records if "ssh -L" in record.getMessage())
    assert "@" not in said
