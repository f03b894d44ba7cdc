"""A headless Chromium, driven over its DevTools protocol."""

import asyncio
import base64
import json
import os
import shutil
import subprocess
import time
import urllib.request
from pathlib import Path
from typing import Any

from tornado.websocket import websocket_connect

PROGRAM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
DEADLINE_S = 60.0


class Chromium:
    """A browser with one page; ``problems`` collects what the console and the page complain about."""

    def __init__(self, folder: Path, width: int = 1280, height: int = 800):
        assert PROGRAM is not None
        words = [PROGRAM, "--headless=new", "--no-sandbox", "--disable-gpu-sandbox", "--use-angle=swiftshader"]
        words += ["--enable-unsafe-swiftshader", "--remote-debugging-port=0", "--no-first-run", "--mute-audio"]
        words += [f"--user-data-dir={folder / 'profile'}", f"--window-size={width},{height}", "about:blank"]
        # Nothing but this machine can be reached: the page has to do with what it holds.
        words.insert(-1, "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1")
        self.problems: list[str] = []
        self.requests: list[str] = []
        self._count = 0
        self._process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self._loop = asyncio.new_event_loop()
        port = self._port(folder / "profile" / "DevToolsActivePort")
        pages = json.load(urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list", timeout=10))
        address = next(page["webSocketDebuggerUrl"] for page in pages if page["type"] == "page")

        async def connect():
            return await websocket_connect(address, max_message_size=1 << 28)

        self._socket = self._loop.run_until_complete(connect())
        for domain in ("Runtime", "Log", "Network", "Page"):
            self.call(f"{domain}.enable")
        self.resize(width, height)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        async def leave():
            self._socket.close()
            await asyncio.sleep(0.05)

        self._loop.run_until_complete(leave())
        self._loop.close()
        self._process.terminate()
        self._process.wait(20)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Give a command and wait for its answer."""
        self._count += 1
        number = self._count

        async def answer():
            await self._socket.write_message(json.dumps({"id": number, "method": method, "params": parameters}))
            while True:
                message = json.loads(await asyncio.wait_for(self._socket.read_message(), DEADLINE_S))
                if message.get("id") == number:
                    assert "error" not in message, message
                    return message["result"]
                self._note(message)

        return self._loop.run_until_complete(answer())

    def resize(self, width: int, height: int) -> None:
        """Give the page a size."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def open(self, url: str, ready: str) -> None:
        """Open a page and wait until an expression is true in it."""
        self.call("Page.navigate", url=url)
        self.wait(ready)

    def wait(self, expression: str) -> None:
        """Wait until an expression is true in the page."""
        end = time.monotonic() + DEADLINE_S
        while not self.evaluate(f"!!({expression})"):
            assert time.monotonic() < end, (expression, self.problems)
            time.sleep(0.05)

    def evaluate(self, expression: str) -> Any:
        """The value of an expression in the page; a promise is awaited."""
        found = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, (expression, found)
        return found["result"].get("value")

    def picture(self, path: Path) -> Path:
        """Write what the page shows as a PNG."""
        # Two frames, so that what was asked for has been drawn.
        self.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))
        return path

    def keep(self, name: str) -> None:
        """Write what the page shows into the folder of screenshots, where ``make test-browser`` asks for them."""
        if folder := os.environ.get("SCREENSHOTS"):
            Path(folder).mkdir(parents=True, exist_ok=True)
            self.picture(Path(folder) / f"{name}.png")

    def _note(self, message: dict[str, Any]) -> None:
        found = message.get("params", {})
        match message.get("method"):
            case "Runtime.consoleAPICalled" if found["type"] in ("error", "warning", "assert"):
                self.problems.append(f"{found['type']}: {[one.get('value') for one in found['args']]}")
            case "Runtime.exceptionThrown":
                self.problems.append(str(found["exceptionDetails"]))
            case "Log.entryAdded" if found["entry"]["level"] == "error":
                self.problems.append(found["entry"]["text"] + " " + found["entry"].get("url", ""))
            case "Network.requestWillBeSent":
                self.requests.append(found["request"]["url"])

    def _port(self, file: Path) -> int:
        end = time.monotonic() + DEADLINE_S
        while time.monotonic() < end:
            if file.is_file() and file.read_text().strip():
                return int(file.read_text().split()[0])
            assert self._process.poll() is None, "the browser ended at its start"
            time.sleep(0.05)
        raise AssertionError("the browser opened no port")
