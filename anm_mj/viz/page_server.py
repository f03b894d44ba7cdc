"""Serves meshcat's page to browsers on this machine alone, and tells them what to show.

meshcat brings a server of its own, but that listens on all network interfaces, needs a process and a second port, and
queues without bound for a browser that does not keep up. This one is a thread: it answers on 127.0.0.1 only and keeps
the last state of every object, which is what a browser that joins late, or reads slowly, gets to see. Page and message
format are meshcat's.
"""

from __future__ import annotations

import asyncio
import socket
import threading
from pathlib import Path
from typing import Any

import meshcat
import umsgpack
from meshcat.commands import SetObject, SetProperty, SetTransform
from tornado.httpserver import HTTPServer
from tornado.web import Application, StaticFileHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from anm_mj.errors import RenderError

ADDRESS = "127.0.0.1"
FIRST_PORT = 7000
"""The port that meshcat's users expect."""
PORTS_TRIED = 100
HOSTS = r"(127\.0\.0\.1|localhost)"
"""Names a browser may know us by; any other would be a foreign site that has its name lead here."""
TIMEOUT_S = 10.0
"""Longest wait for the thread to start or to end [s]; both take milliseconds."""

Key = tuple[str, str]
"""Path of an object, and what of it: the object itself, its transform, or a property."""


class PageServer:
    """A web page with a three-dimensional scene that this process sets.

    Args:
        first_port: The first port to try; the next free one is taken.

    Raises:
        RenderError: No port is free.
    """

    def __init__(self, first_port: int = FIRST_PORT) -> None:
        listening = _free_socket(first_port)
        self.port: int = listening.getsockname()[1]
        self._lock = threading.Lock()
        self._outbox: dict[Key, bytes] = {}
        self._state: dict[Key, bytes] = {}
        self._browsers: set[_Browser] = set()
        self._started = threading.Event()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve(listening)), name="viewer", daemon=True)
        self._thread.start()
        self._started.wait(TIMEOUT_S)

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://{ADDRESS}:{self.port}/static/"

    @property
    def num_browsers(self) -> int:
        """How many browsers show the page now."""
        return len(self._browsers)

    def publish(self, command: SetObject | SetTransform | SetProperty) -> None:
        """Show something from now on; returns at once, whoever listens."""
        message: dict[str, Any] = command.lower()
        data: bytes = umsgpack.packb(message)
        with self._lock:
            waiting = bool(self._outbox)
            self._outbox[message["path"], message.get("property", message["type"])] = data
        if not waiting and self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._hand_out)

    def close(self) -> None:
        """End the thread and free the port; a second time does nothing."""
        if self._loop is not None and self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(TIMEOUT_S)

    def join(self, browser: _Browser) -> None:
        """Show all there is to a browser that has come; called in the server's thread."""
        self._browsers.add(browser)
        browser.tell(self._state)

    def leave(self, browser: _Browser) -> None:
        """Forget a browser that has gone; called in the server's thread."""
        self._browsers.discard(browser)

    def _hand_out(self) -> None:
        with self._lock:
            news, self._outbox = self._outbox, {}
        self._state.update(news)
        for browser in self._browsers:
            browser.tell(news)

    async def _serve(self, listening: socket.socket) -> None:
        self._stop = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        page = Path(meshcat.__file__).parent / "viewer" / "dist"
        application = Application(log_function=lambda handler: None)
        application.add_handlers(
            HOSTS,
            [
                (r"/static/(.*)", _Page, {"path": str(page), "default_filename": "index.html"}),
                (r"/", _Browser, {"server": self}),
            ],
        )
        server = HTTPServer(application)
        server.add_sockets([listening])
        self._hand_out()
        self._started.set()
        await self._stop.wait()
        server.stop()
        await asyncio.gather(*(browser.end() for browser in tuple(self._browsers)))
        await server.close_all_connections()


class _Page(StaticFileHandler):
    """The files of the page, never kept by the browser, so that an upgrade of meshcat shows at once."""

    def set_extra_headers(self, path: str) -> None:
        self.set_header("Cache-Control", "no-store")


class _Browser(WebSocketHandler):
    """One open page. News that it has not yet been sent are replaced by newer ones."""

    def initialize(self, server: PageServer) -> None:
        self._server = server
        self._news: dict[Key, bytes] = {}
        self._sending: asyncio.Task[None] | None = None

    def open(self, *args: str, **kwargs: str) -> None:
        self._server.join(self)

    def on_message(self, message: str | bytes) -> None:
        """The page has nothing to say that is asked for."""

    def on_close(self) -> None:
        self._server.leave(self)

    def tell(self, news: dict[Key, bytes]) -> None:
        self._news.update(news)
        if self._news and (self._sending is None or self._sending.done()):
            self._sending = asyncio.create_task(self._send())

    async def end(self) -> None:
        self.close()
        if self._sending is not None:
            self._sending.cancel()
            await asyncio.gather(self._sending, return_exceptions=True)

    async def _send(self) -> None:
        try:
            while self._news:
                await self.write_message(self._news.pop(next(iter(self._news))), binary=True)
        except WebSocketClosedError:
            self._server.leave(self)


def _free_socket(first_port: int) -> socket.socket:
    for port in range(first_port, first_port + PORTS_TRIED):
        try:
            listening = socket.create_server((ADDRESS, port))
        except (OSError, OverflowError):
            continue
        listening.setblocking(False)
        return listening
    last = first_port + PORTS_TRIED - 1
    raise RenderError(f"None of the ports {first_port} to {last} is free on {ADDRESS}; choose another with --port.")
