"""A headless Chromium that says what a page did: a small client of the DevTools protocol."""

from __future__ import annotations

import base64
import contextlib
import http.client
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import websocket

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
NO_CHROMIUM = "no Chromium found: install Debian's package chromium to test pages in a browser"
TIMEOUT = 60.0  # s for whatever the browser is asked for
FLAGS = [
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",  # WebGL without a graphics card
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-extensions",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--remote-debugging-port=0",
    "--remote-allow-origins=*",
]


class Page:
    """One page; `problems` are its console errors and exceptions, `requests` all addresses it asked for."""

    def __init__(self, address: str) -> None:
        self.problems: list[str] = []
        self.requests: list[str] = []
        self._socket = websocket.create_connection(address, timeout=TIMEOUT)
        self._last_id = 0
        self._loaded = False
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def close(self) -> None:
        self._socket.close()

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Result of a DevTools method; events that come before it are noted."""
        self._last_id += 1
        self._socket.send(json.dumps({"id": self._last_id, "method": method, "params": parameters}))
        while (message := json.loads(self._socket.recv())).get("id") != self._last_id:
            self._note(message)
        if "error" in message:
            raise RuntimeError(f"{method}: {message['error']['message']}")
        return message["result"]

    def open(self, path: Path, width: int = 1240, dark: bool = False, webgl: bool = True) -> None:
        """Open a report and wait until all its figures are drawn."""
        self.resize(width)
        self.prefer("dark" if dark else "light")
        script = self.call("Page.addScriptToEvaluateOnNewDocument", source="" if webgl else WITHOUT_WEBGL)
        self._loaded = False
        self.problems.clear()
        self.requests.clear()
        self.call("Page.navigate", url=path.resolve().as_uri())
        while not self._loaded:
            self._note(json.loads(self._socket.recv()))
        self.run(UNTIL_DRAWN)
        self.call("Page.removeScriptToEvaluateOnNewDocument", **script)

    def resize(self, width: int) -> None:
        """Set the width of the window, px."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)

    def prefer(self, scheme: str) -> None:
        """Set the system's colour scheme, "light" or "dark"."""
        self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])

    def run(self, script: str) -> Any:
        """Value of a JavaScript expression; a promise is awaited.

        Raises:
            RuntimeError: the script threw.
        """
        answer = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(answer["exceptionDetails"].get("exception", {}).get("description", "script failed"))
        return answer["result"].get("value")

    def screenshot(self, scale: float = 1.0, bottom: float | None = None) -> bytes:
        """PNG of the page from its top to `bottom` (CSS px), or of all of it."""
        size = self.call("Page.getLayoutMetrics")["cssContentSize"]
        clip = {"x": 0, "y": 0, "width": size["width"], "height": bottom or size["height"], "scale": scale}
        shot = self.call("Page.captureScreenshot", format="png", clip=clip, captureBeyondViewport=True)
        return base64.b64decode(shot["data"])

    def _note(self, message: dict[str, Any]) -> None:
        method, parameters = message.get("method"), message.get("params", {})
        if method == "Page.loadEventFired":
            self._loaded = True
        elif method == "Network.requestWillBeSent":
            self.requests.append(parameters["request"]["url"])
        elif method == "Runtime.exceptionThrown":
            self.problems.append(str(parameters["exceptionDetails"]))
        elif method == "Runtime.consoleAPICalled" and parameters["type"] in ("error", "assert"):
            self.problems.append(str(parameters["args"]))
        elif method == "Log.entryAdded" and parameters["entry"]["level"] == "error":
            self.problems.append(parameters["entry"]["text"])


UNTIL_DRAWN = """
new Promise((done) => {
  const drawn = () => document.documentElement.dataset.drawn;
  const look = () => drawn() ? requestAnimationFrame(() => done()) : setTimeout(look, 20);
  look();
})
"""
WITHOUT_WEBGL = """
const original = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
  return /webgl/.test(kind) ? null : original.call(this, kind, ...rest);
};
"""


@contextlib.contextmanager
def browser() -> Iterator[int]:
    """Run Chromium with an empty profile; the port of its DevTools."""
    if CHROMIUM is None:
        raise RuntimeError("no Chromium found: install Debian's package chromium")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        process = subprocess.Popen(
            [CHROMIUM, *FLAGS, f"--user-data-dir={profile}", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            yield _devtools_port(Path(profile) / "DevToolsActivePort", process)
        finally:
            process.terminate()
            process.wait(timeout=TIMEOUT)


@contextlib.contextmanager
def new_page(port: int) -> Iterator[Page]:
    """A new page of the browser whose DevTools are at `port` of this machine."""
    devtools = http.client.HTTPConnection("127.0.0.1", port, timeout=TIMEOUT)
    devtools.request("PUT", "/json/new?about:blank")
    target = json.loads(devtools.getresponse().read())
    page = Page(target["webSocketDebuggerUrl"])
    try:
        yield page
    finally:
        page.close()
        devtools.request("GET", f"/json/close/{target['id']}")
        devtools.close()


def _devtools_port(port_file: Path, process: subprocess.Popen) -> int:
    """Wait for the file in which Chromium tells its port."""
    deadline = time.monotonic() + TIMEOUT
    while time.monotonic() < deadline:
        if process.poll() is not None:
            raise RuntimeError(f"Chromium ended at once with exit code {process.returncode}")
        with contextlib.suppress(FileNotFoundError):
            lines = port_file.read_text().splitlines()
            if len(lines) == 2:
                return int(lines[0])
        time.sleep(0.05)
    raise RuntimeError("Chromium did not open its DevTools port")
