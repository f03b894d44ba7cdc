"""Serves one page to the browsers of this machine."""

from __future__ import annotations

import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TypeVar

from anm_mj.errors import RenderError

T = TypeVar("T")

ADDRESS = "127.0.0.1"
FIRST_PORT = 7000
PORTS_TRIED = 100
IDLE_S = 10.0
"""Longest wait for a request on an open connection [s]."""
HOSTS = (ADDRESS, "localhost")


class FileServer:
    """A thread that answers every request for ``/`` with the same page. ``first_port`` 0 = any. Raises RenderError if
    no port is free.
    """

    def __init__(self, page: bytes, first_port: int = FIRST_PORT) -> None:
        handler = _handler(page)
        self._server = first_free(first_port, lambda port: ThreadingHTTPServer((ADDRESS, port), handler))
        self._thread = threading.Thread(target=self._server.serve_forever, name="replay", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{ADDRESS}:{self._server.server_address[1]}/"

    def wait(self) -> None:
        """Wait until the server is closed, or for Ctrl-C."""
        while self._thread.is_alive():
            self._thread.join(0.5)

    def close(self) -> None:
        """End the thread and free the port."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def __enter__(self) -> FileServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _handler(page: bytes) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        timeout = IDLE_S

        def do_GET(self) -> None:
            # A foreign name that resolves to this machine is refused (DNS rebinding).
            host = self.headers.get("Host", "").rpartition(":")[0]
            if self.path != "/" or host not in HOSTS:
                self.send_error(404)
                return
            self.send_response(200)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(page)))
            self.end_headers()
            self.wfile.write(page)

        def log_message(self, format: str, *args: object) -> None:
            """Say nothing."""

    return Handler


def first_free(first_port: int, listen: Callable[[int], T]) -> T:
    """What listens on the first port that is free. ``listen`` listens on a port of ``ADDRESS``, and raises OSError
    where it is taken. Raises RenderError if none of ``PORTS_TRIED`` ports is free.
    """
    for port in range(first_port, first_port + PORTS_TRIED):
        try:
            return listen(port)
        except (OSError, OverflowError):
            continue
    last = first_port + PORTS_TRIED - 1
    raise RenderError(f"None of the ports {first_port} to {last} is free on {ADDRESS}; choose another with --port.")
