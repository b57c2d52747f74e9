"""The live view in a browser, with STOP; nothing else can be asked for there."""

from __future__ import annotations

import asyncio
import json
import math
import secrets
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from tornado.httpserver import HTTPServer
from tornado.httputil import split_host_and_port
from tornado.iostream import IOStream
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler, StaticFileHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from esea_gen.errors import UserError
from esea_gen.files import plain
from esea_host.windows import theme
from esea_host.windows.feed import Floats, LiveFeed, Stretch, board_alarms, link_text
from esea_host.windows.meanings import MOTOR_OFF, ROLES, state_text
from esea_host.windows.signals import LIT_S, READOUTS, AxisColumns, ShownSignal

PORT, MOST_BROWSERS, MOST_LINES = 8766, 8, 64
KEPT_S, BIN_S, PICTURE_S, LATE_BINS = 10.0, 0.02, 0.1, 2
FOLDER = Path(__file__).parent / "page"


class _Style(RequestHandler):
    def get(self) -> None:
        self.set_header("Content-Type", "text/css")
        self.finish(self.render_string(str(FOLDER / "page.css"), theme=theme))


class _Server(HTTPServer):
    def handle_stream(self, stream: IOStream, address: tuple[str, int]) -> None:
        if len(self._connections) < MOST_LINES:  # a recording needs files, too
            super().handle_stream(stream, address)
        else:
            stream.close()


class _Live(WebSocketHandler):
    def prepare(self) -> None:
        self.view: BrowserView = self.settings["view"]
        # Tornado refuses pages of another origin; here ends one that has renamed this computer.
        if split_host_and_port(self.request.host.lower())[0] not in self.view.names:
            raise HTTPError(403)

    def open(self, *_: str) -> None:
        self._last, self._asked = -1, True
        if not secrets.compare_digest(self.get_query_argument("key", "").encode(), self.view.key):
            self.close(1008, "The key is not valid: open the address that was printed last.")
        elif len(self.view.browsers) >= MOST_BROWSERS:
            self.close(1013, "Too many browsers are connected: close one.")
        else:
            self.view.browsers.add(self)
            self._tell()

    def _tell(self) -> None:
        with suppress(WebSocketClosedError):
            message, self._last = self.view.picture(self._last)
            self.write_message(message)
            self._asked = False

    def on_message(self, message: str | bytes) -> None:
        if self not in self.view.browsers:
            return
        if message == "stop":
            self.view.feed.stop()
            who = self.request.remote_ip
            self.view.feed.news.said = f"STOP was pressed in the browser at {who}."
        elif message == "drawn" and not self._asked:  # a slow browser leaves pictures out
            self._asked = True
            asyncio.get_running_loop().call_later(PICTURE_S, self._tell)
        else:
            self.close(1008, "unknown message")

    def on_close(self) -> None:
        self.view.browsers.discard(self)


class BrowserView:
    """Content and commands of a feed's pages; key: opens them."""

    def __init__(self, feed: LiveFeed) -> None:
        self.feed, self.columns = feed, AxisColumns(feed)
        self.key, self.names = secrets.token_urlsafe(16).encode(), set[str]()
        self.browsers = set[_Live]()
        axes = [(axis, f"{axis} ".lstrip()) for axis in self.columns.axes]
        flags = ((x, s, f) for a, x in axes for s, f in self.columns.flags(a))
        self._flags = [flag for flag in flags if flag[2].name != MOTOR_OFF]
        panels = ((x, *p) for a, x in axes for p in self.columns.panels(a))
        shown = [(f"{x}{h[0]} [{h[1]}]", h, own) for x, h, own in panels if h[0] in READOUTS]
        self._signals = [s for *_, signals in shown for s in signals]
        self._heads = [h for _, h, _ in shown]
        self._bin_s = max(BIN_S, 2 * max(feed.period_s[s.stream] for s in self._signals))
        self._head = {
            "who": feed.device.identity.who,
            "simulated": feed.device.simulated,
            "drives": self.columns.drives,
            "panels": [(title, h[1], [s.label for s in own]) for title, h, own in shown],
        }

    def picture(self, last: int) -> tuple[str, int]:
        """Data for a page that has all bins up to the last one, and its last one then."""
        feed, now_s = self.feed, self.feed.now_s()
        newest = max(last, math.floor(now_s / self._bin_s) - LATE_BINS)
        first = max(last + 1, newest + 1 - round(KEPT_S / self._bin_s), 0)
        count = newest + 1 - first
        rows, lit = feed.latest(now_s - first * self._bin_s), feed.latest(LIT_S)
        acting = [] if feed.silent else self._flags
        word, _, rest = feed.news.state.partition(": ")
        told = {
            "head": self._head if last < 0 else None,
            "state": "NO LINK" if feed.silent else word,
            "role": "alarm" if feed.silent else ROLES.get(word, "rest"),
            "words": rest or state_text(feed.device.session.dialect, word),
            "silent": feed.silent,
            "alarms": board_alarms(feed),
            "said": [link_text(feed), feed.news.said],
            "known": [self.columns.known(head) for head in self._heads],
            "acting": [x + f.name for x, s, f in acting if f.held(lit[s].rows).any()]
            + list(feed.unzeroed),
            "x": np.round((first + np.arange(2 * count) / 2 + 0.25) * self._bin_s, 4),
            "y": [self._ends(s, rows[s.stream], first, count) for s in self._signals],
        }
        return json.dumps(plain(told, null=True)), newest

    def _ends(self, signal: ShownSignal, rows: Stretch, first: int, count: int) -> Floats:
        # Smallest and largest value of each bin, as it rises or falls; a gap, or no rows: NaN.
        place = np.floor(rows.time_s / self._bin_s).astype(int) - first
        inside = (place >= 0) & (place < count)
        values, place = signal.values({signal.stream: rows})[inside], place[inside]
        low, high, start, end = np.full((4, count), math.nan)
        np.fmin.at(low, place, values)
        np.fmax.at(high, place, values)
        start[place[::-1]], end[place] = values[::-1], values
        low[place[rows.after_gap[inside]]] = math.nan
        return np.where(end < start, [high, low], [low, high]).T.round(4).ravel()


@contextmanager
def browser_view(feed: LiveFeed, listen: str, port: int | None = None) -> Iterator[str]:
    """Serve a feed in a thread of its own; gives the URL.  Its key is behind #, in no request."""
    view, port = BrowserView(feed), PORT if port is None else port
    try:
        sockets = bind_sockets(port, listen)
    except (OSError, UnicodeError) as error:
        fix = "Name another port (0: any), and an address of this computer."
        why = getattr(error, "strerror", None) or "no address of a computer"
        raise UserError(f"{listen}, port {port}: {why}.", fix) from None
    address, port = sockets[0].getsockname()[:2]
    if address in ("0.0.0.0", "::"):
        raise UserError(f"'{listen}' is every network of this computer.", "Name an address.")
    host = f"[{listen}]" if ":" in listen else listen.lower()
    view.names |= {host, "localhost"} if address in ("127.0.0.1", "::1") else {host}
    view.names.add(address.lower())
    loop, ended = asyncio.new_event_loop(), asyncio.Event()

    async def serve() -> None:
        files = {"path": FOLDER, "default_filename": "index.html"}
        page = r"/([a-zA-Z][\w.-]*|)", StaticFileHandler, files
        application = Application(
            [("/live", _Live), ("/page.css", _Style), page],
            view=view,
            log_function=lambda _: None,
            websocket_max_message_size=64,
            websocket_ping_interval=5,
        )
        limits = {"max_header_size": 8192, "max_body_size": 64, "idle_connection_timeout": 10}
        server = _Server(application, **limits)
        server.add_sockets(sockets)
        await ended.wait()
        server.stop()
        for browser in list(view.browsers):
            browser.close(1001, "It has ended.")
        await asyncio.sleep(PICTURE_S)

    thread = threading.Thread(target=loop.run_until_complete, args=[serve()], daemon=True)
    thread.start()
    try:
        yield f"http://{host}:{port}/#{view.key.decode()}"
    finally:
        loop.call_soon_threadsafe(ended.set)
        thread.join()
        loop.close()
