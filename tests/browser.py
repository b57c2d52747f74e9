"""A page in headless Chromium, spoken to over a pipe: its console, its width, its picture."""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.conftest import require_tool

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")


class Browser:
    """One tab; messages of the DevTools protocol end with a zero byte."""

    def __init__(self, to: int, back: int) -> None:
        self._to, self._back = to, os.fdopen(back, "rb")
        self._number, self._session = 0, ""
        self._rest: list[dict[str, Any]] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def _read(self) -> dict[str, Any]:
        data = bytearray()
        while (byte := self._back.read(1)) != b"\0":
            assert byte, "the browser has gone"
            data += byte
        found: dict[str, Any] = json.loads(data)
        return found

    def call(self, method: str, **params: Any) -> Any:
        """A method's result; events that come before it are kept."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while (answer := self._read()).get("id") != self._number:
            self._rest.append(answer)
        assert "error" not in answer, answer
        return answer["result"]

    def opened(self, page: Path | str, width: int, scheme: str, height: int = 900) -> list[str]:
        """Open a file or URL and return what its console complained of."""
        self._rest.clear()
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": True}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        feature = {"name": "prefers-color-scheme", "value": scheme}
        self.call("Emulation.setEmulatedMedia", features=[feature])
        url = page if isinstance(page, str) else page.absolute().as_uri()
        self.call("Page.navigate", url=url)
        while not any(m.get("method") == "Page.loadEventFired" for m in self._rest):
            self._rest.append(self._read())
        self.evaluate("new Promise(r => requestAnimationFrame(() => setTimeout(r, 50)))")
        return [json.dumps(m["params"]) for m in self._rest if _complaint(m)]

    def evaluate(self, script: str) -> Any:
        """The value of an expression on the page."""
        found = self.call(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def picture(self, path: Path) -> None:
        """The whole page as PNG."""
        shot = self.call("Page.captureScreenshot", captureBeyondViewport=True)
        path.write_bytes(base64.b64decode(shot["data"]))


def _complaint(message: dict[str, Any]) -> bool:
    method, params = message.get("method"), message.get("params", {})
    if method == "Runtime.consoleAPICalled":
        return params["type"] in ("error", "warning", "assert")
    if method == "Log.entryAdded":
        return params["entry"]["level"] in ("error", "warning")
    return method == "Runtime.exceptionThrown"


@contextmanager
def browser(folder: Path) -> Iterator[Browser]:
    """Headless Chromium with a profile of its own."""
    program = next(filter(None, map(shutil.which, PROGRAMS)), None) or require_tool("chromium")
    (theirs, ours), (back, theirs_back) = os.pipe(), os.pipe()
    # It reads at 3 and writes at 4.
    line = f'exec "$0" "$@" 3<&{theirs} 4>&{theirs_back}'
    words = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
    words += ["--no-first-run", f"--user-data-dir={folder}", "--remote-debugging-pipe"]
    running = subprocess.Popen(
        ["bash", "-c", line, program, *words],
        pass_fds=(theirs, theirs_back),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(theirs)
    os.close(theirs_back)
    try:
        yield Browser(ours, back)
    finally:
        running.terminate()
        running.wait(20)
        os.close(ours)


def readable(b: Browser, text: str, folder: Path, width: int = 400) -> None:
    """A page is whole on a telephone, by day and by night, and its console is silent."""
    page = folder / "page.html"
    page.write_text(text, encoding="utf-8")
    for scheme in ("light", "dark"):
        assert b.opened(page, width, scheme) == []
        assert b.evaluate("document.documentElement.scrollWidth") == width
        found = b.evaluate(
            "['background-color', 'color'].map("
            "k => getComputedStyle(document.body).getPropertyValue(k))"
        )
        back, ink = (sum(map(int, re.findall(r"\d+", c)[:3])) / 3 for c in found)
        assert (ink > back + 100) if scheme == "dark" else (back > ink + 100)
        # So are the figures: their ground is the page's, their words are told from it.
        kept = "getComputedStyle(document.querySelector('figure svg text')).fill"
        if b.evaluate("document.querySelector('figure svg text') !== null"):
            words = sum(map(int, re.findall(r"\d+", b.evaluate(kept))[:3])) / 3
            assert abs(words - back) > 100


def dragged(b: Browser, box: tuple[float, ...], start: tuple[float, ...], end: tuple[float, ...]):
    """The mouse pressed, moved and let go; places as shares of a box on the screen, downward."""
    x, y, width, height = box
    for kind, (right, down) in zip(
        ("mousePressed", "mouseMoved", "mouseReleased"), (start, end, end), strict=True
    ):
        facts = {"x": x + right * width, "y": y + down * height, "button": "left", "clickCount": 1}
        b.call("Input.dispatchMouseEvent", type=kind, **facts)
