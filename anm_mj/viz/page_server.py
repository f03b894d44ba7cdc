"""Local web server of the live view and of a replay: serves a page beside meshcat's files and sends it updates.

meshcat's own server listens on all network interfaces, needs a process and a second port, and queues without bound for
a slow browser. This one is a thread: it listens on 127.0.0.1 only and keeps the last state of every object, so a late
or slow browser gets the present state. Page and message format are meshcat's.
"""

from __future__ import annotations

import asyncio
import json
import socket
import threading
from collections.abc import Callable
from typing import Any

import umsgpack
from meshcat.commands import SetObject, SetProperty, SetTransform
from tornado.httpserver import HTTPServer
from tornado.iostream import IOStream
from tornado.web import Application, RequestHandler, StaticFileHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from anm_mj.errors import RenderError
from anm_mj.viz.assets import bundle_folder

ADDRESS = "127.0.0.1"
FIRST_PORT = 7000
"""The live view is on this port, or on the next one that is free."""
PORTS_TRIED = 100
HOSTS = r"(127\.0\.0\.1|localhost)"
"""Accepted host names; the server rejects foreign names that resolve to this machine (DNS rebinding)."""
LAST_WORDS_S = 1.0
"""Longest wait for a browser that still has to be sent something when the server ends [s]."""
TIMEOUT_S = 10.0
"""Longest wait for the start or end of the thread [s]; both take milliseconds."""

MAX_CONNECTIONS = 64
"""Connections at a time: an open page has one, and a few more for some milliseconds while it loads."""
BURST = 32
"""Connections that are taken at once; a page that loads opens a few."""
TAKEN_PER_S = 25.0
"""Connections a second that are taken after that: what a flood of them costs the run stays small."""
MAX_BROWSERS = 16
"""Open pages at a time."""
IDLE_S = 10.0
"""Longest wait for the head of a request, and for its body [s]."""
MAX_HEAD_BYTES = 16384
MAX_BODY_BYTES = 4096
"""The page sends nothing as large."""

Key = tuple[str, str]
"""Path of an object, and the kind of update: the object itself, its transform, or a property."""


class PageServer:
    """A web page with a 3D scene that this process controls. It takes ``first_port`` or the next free one. The files of
    meshcat's bundle lie beside the page; ``on_word`` is called with what a page sends, in the server's thread. Raises
    RenderError if no port is free.
    """

    def __init__(
        self, first_port: int = FIRST_PORT, page: str = "", on_word: Callable[[str], object] = lambda word: None
    ) -> None:
        self._page = page
        self.on_word = on_word
        listening = _listen(first_port)
        listening.setblocking(False)
        self.port: int = listening.getsockname()[1]
        self._lock = threading.Lock()
        self._outbox: dict[Key, bytes | str] = {}
        self._state: dict[Key, bytes | str] = {}
        self._browsers: set[_Browser] = set()
        self._started = threading.Event()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve(listening)), name="viewer", daemon=True)
        self._thread.start()
        self._started.wait(TIMEOUT_S)

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{ADDRESS}:{self.port}/static/"

    @property
    def num_browsers(self) -> int:
        """Number of connected browsers."""
        return len(self._browsers)

    def publish(self, command: SetObject | SetTransform | SetProperty) -> None:
        """Update the scene; returns at once, whatever the browsers do."""
        message: dict[str, Any] = command.lower()
        self._put((message["path"], message.get("property", message["type"])), umsgpack.packb(message))

    def _put(self, key: Key, data: bytes | str) -> None:
        with self._lock:
            waiting = bool(self._outbox)
            self._outbox[key] = data
        if not waiting and self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._broadcast)

    def say(self, topic: str, status: dict[str, Any]) -> None:
        """Tell the page something for its card; what was said before on the same topic is forgotten."""
        self._put((topic, "text"), json.dumps(status))

    def close(self) -> None:
        """End the thread and free the port; may be called again."""
        if self._loop is not None and self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(TIMEOUT_S)

    def wait(self) -> None:
        """Wait until the server is closed, or for Ctrl-C."""
        while self._thread.is_alive():
            self._thread.join(0.5)

    def join(self, browser: _Browser) -> None:
        """Send the whole scene to a new browser; called in the server's thread."""
        self._browsers.add(browser)
        browser.send(self._state)

    def leave(self, browser: _Browser) -> None:
        """Remove a disconnected browser; called in the server's thread."""
        self._browsers.discard(browser)

    def _broadcast(self) -> None:
        with self._lock:
            updates, self._outbox = self._outbox, {}
        self._state.update(updates)
        for browser in self._browsers:
            browser.send(updates)

    async def _serve(self, listening: socket.socket) -> None:
        self._stop = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        application = Application(
            log_function=lambda handler: None,
            websocket_max_message_size=MAX_BODY_BYTES,
            # A page whose machine has gone is noticed.
            websocket_ping_interval=30.0,
        )
        application.add_handlers(
            HOSTS,
            [
                (r"/static/", _Index, {"page": self._page}),
                (r"/static/(.*)", _Page, {"path": str(bundle_folder()), "default_filename": "index.html"}),
                (r"/", _Browser, {"server": self, "keep": lambda stream: server.keep(stream)}),
            ],
        )
        server = _Server(
            application,
            idle_connection_timeout=IDLE_S,
            body_timeout=IDLE_S,
            max_header_size=MAX_HEAD_BYTES,
            max_body_size=MAX_BODY_BYTES,
        )
        taking = asyncio.create_task(_take_connections(listening, server))
        self._broadcast()
        self._started.set()
        await self._stop.wait()
        taking.cancel()
        await asyncio.gather(taking, return_exceptions=True)
        listening.close()
        await asyncio.gather(*(browser.end() for browser in tuple(self._browsers)))
        await server.close_all_connections()


def _listen(first_port: int) -> socket.socket:
    """Listen on the first port that is free. Raises RenderError if none of ``PORTS_TRIED`` is."""
    for port in range(first_port, first_port + PORTS_TRIED):
        try:
            return socket.create_server((ADDRESS, port))
        except (OSError, OverflowError):
            continue
    last = first_port + PORTS_TRIED - 1
    raise RenderError(f"None of the ports {first_port} to {last} is free on {ADDRESS}; choose another with --port.")


async def _take_connections(listening: socket.socket, server: _Server) -> None:
    """Hand connections to the server, no faster than allowed; those that come meanwhile wait in the kernel's queue."""
    loop = asyncio.get_running_loop()
    allowed, then_s = float(BURST), loop.time()
    while True:
        # Accepted and handed on without a wait in between: whoever cancels this loses no connection.
        try:
            connection, address = listening.accept()
        except BlockingIOError:
            await _until_readable(listening)
            continue
        except OSError:
            # It has gone already, or no file descriptor is left at the moment.
            await asyncio.sleep(1.0 / TAKEN_PER_S)
            continue
        server.handle_stream(IOStream(connection), address)
        now_s = loop.time()
        allowed = min(allowed + TAKEN_PER_S * (now_s - then_s), BURST) - 1.0
        then_s = now_s
        if allowed < 1.0:
            await asyncio.sleep((1.0 - allowed) / TAKEN_PER_S)


async def _until_readable(listening: socket.socket) -> None:
    """Wait for a connection."""
    loop, readable = asyncio.get_running_loop(), asyncio.Event()
    loop.add_reader(listening, readable.set)
    try:
        await readable.wait()
    finally:
        loop.remove_reader(listening)


class _Server(HTTPServer):
    """Holds few connections at a time: a thousand that are left open must not take the run's file descriptors."""

    def initialize(self, *args: Any, **kwargs: Any) -> None:
        """Begin without connections; tornado calls this instead of a constructor."""
        super().initialize(*args, **kwargs)
        self._streams: list[IOStream] = []
        """Those that are no open pages, oldest first."""

    def handle_stream(self, stream: IOStream, address: tuple[str, int]) -> None:
        """Take a connection; where there are too many, the oldest that is no page gives way."""
        self._streams = [each for each in self._streams if not each.closed()]
        if len(self._streams) >= MAX_CONNECTIONS:
            self._streams.pop(0).close()
        self._streams.append(stream)
        super().handle_stream(stream, address)

    def keep(self, stream: IOStream) -> None:
        """Close the connection of an open page for no other one."""
        self._streams = [each for each in self._streams if each is not stream]


class _Index(RequestHandler):
    """The page itself."""

    def initialize(self, page: str) -> None:
        self._html = page

    def get(self) -> None:
        self.set_header("Cache-Control", "no-store")
        self.write(self._html)


class _Page(StaticFileHandler):
    """The files of the page, without browser cache, so that an upgrade of meshcat takes effect at once."""

    def set_extra_headers(self, path: str) -> None:
        self.set_header("Cache-Control", "no-store")


class _Browser(WebSocketHandler):
    """One open page; newer updates replace unsent ones."""

    def initialize(self, server: PageServer, keep: Callable[[IOStream], None]) -> None:
        self._server = server
        self._keep = keep
        self._updates: dict[Key, bytes | str] = {}
        self._sending: asyncio.Task[None] | None = None

    def prepare(self) -> None:
        connection: Any = self.request.connection
        self._stream: IOStream = connection.stream

    def open(self, *args: str, **kwargs: str) -> None:
        if self._server.num_browsers >= MAX_BROWSERS:
            self.close(1013, "too many pages are open")
            return
        self._keep(self._stream)
        self._server.join(self)

    def on_message(self, message: str | bytes) -> None:
        """Hand on what the page asks for."""
        if isinstance(message, str):
            self._server.on_word(message)

    def on_close(self) -> None:
        self._server.leave(self)

    def send(self, updates: dict[Key, bytes | str]) -> None:
        self._updates.update(updates)
        if self._updates and (self._sending is None or self._sending.done()):
            self._sending = asyncio.create_task(self._send())

    async def end(self) -> None:
        # The last words, unless the browser is too slow for them.
        if self._sending is not None:
            await asyncio.wait({self._sending}, timeout=LAST_WORDS_S)
        self.close()
        if self._sending is not None:
            self._sending.cancel()
            await asyncio.gather(self._sending, return_exceptions=True)

    async def _send(self) -> None:
        try:
            while self._updates:
                data = self._updates.pop(next(iter(self._updates)))
                await self.write_message(data, binary=isinstance(data, bytes))
        except WebSocketClosedError:
            self._server.leave(self)
