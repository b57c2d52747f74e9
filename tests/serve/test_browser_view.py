"""Browser view of a simulated board, in Chromium: display, STOP, refused clients."""

from __future__ import annotations

import asyncio
import json
import math
import signal
import socket
import subprocess
import sys
from contextlib import nullcontext
from urllib.error import HTTPError
from urllib.request import urlopen

import pytest
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import WebSocketClosedError, websocket_connect

from esea_gen.errors import UserError
from esea_host.cli.view import view
from esea_host.serve import BrowserView, browser_view
from esea_host.simulated import LockstepDevice
from esea_host.windows.feed import LiveFeed
from tests.browser import browser
from tests.conftest import INTERRUPTIBLE, until

LONG = "A refusal of the board that is as long as such a text can be, and then longer. " * 3
STOP = "(r => [innerWidth - r.right, r.top, r.width, r.height])(page.stop.getBoundingClientRect())"


@pytest.fixture
def feed(simulated_elbow):
    simulated_elbow.restart()
    made = LiveFeed(LockstepDevice(simulated_elbow), None, kept_s=12.0, threaded=False)
    goes_on(made, 1.0)
    yield made
    made.close()


@pytest.fixture
def url(feed):
    with browser_view(feed, "127.0.0.1", 0) as found:
        yield found


@pytest.fixture(scope="module")
def chromium(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("profile") / "profile") as b:
        yield b


@pytest.fixture
def tab(chromium):
    yield chromium
    chromium.opened("about:blank", 1024, "light")  # no page asks for a server that has gone


def goes_on(feed, time_s=0.1):
    feed.device.advance(time_s)
    feed.gather()
    feed.ask()
    feed.came_s = math.inf  # the board's clock stands still, and it is not away


def seen(tab, name):
    return tab.evaluate(f"page.{name}.textContent")


@pytest.mark.parametrize("key", [" ", "Escape", "F12", "touch"])
def test_stop_reaches_the_board_and_only_the_board_confirms_it(feed, url, tab, key, monkeypatch):
    stops = []
    monkeypatch.setattr(feed, "stop", lambda: stops.append(LiveFeed.stop(feed)))
    assert tab.opened(url, 1024, "light") == []
    until(lambda: seen(tab, "state") == "UNREFERENCED")
    assert not tab.evaluate("page.badge.hidden")
    if key == "touch":
        tab.call("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": 940, "y": 50}])
    for held_down in (False, True) if key != "touch" else ():
        tab.call("Input.dispatchKeyEvent", type="keyDown", key=key, autoRepeat=held_down)
    # The board's clock stands still: nothing has been confirmed.
    until(lambda: "has not confirmed" in seen(tab, "alarm"))
    assert "physical stop" in seen(tab, "alarm")
    until(lambda: goes_on(feed) or "board has stopped" in seen(tab, "stop"))
    assert (seen(tab, "state"), seen(tab, "alarm"), len(stops)) == ("STOPPED", "", 1)
    assert "in the browser at 127.0.0.1" in seen(tab, "said")


def test_stop_before_the_first_picture(feed, url, tab, monkeypatch):
    def closed(*_):
        raise WebSocketClosedError

    stops = []
    monkeypatch.setattr(feed, "stop", lambda: stops.append(1))
    monkeypatch.setattr(BrowserView, "picture", closed)
    tab.opened(url, 1024, "light")
    until(lambda: not tab.evaluate("page.stop.disabled"))
    tab.call("Input.dispatchKeyEvent", type="keyDown", key=" ")
    until(lambda: stops == [1])


@pytest.mark.parametrize("size_px", [(1366, 768), (1920, 1080), (1024, 768), (400, 800)])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_everything_fits_and_stop_is_complete(feed, url, tab, size_px, scheme):
    feed.news.error = LONG
    assert tab.opened(url, size_px[0], scheme, size_px[1]) == []
    until(lambda: LONG[:-1] in seen(tab, "alarm"))
    assert tab.evaluate("document.documentElement.scrollWidth") == size_px[0]
    for _ in range(2):
        assert tab.evaluate(STOP) == [10, 6, 150, 92]  # as in the windows
        tab.evaluate("scrollTo(0, 9999)")


def test_a_page_without_its_board_or_server_looks_so(feed, tab):
    with browser_view(feed, "127.0.0.1", 0) as url:
        tab.opened(url, 1024, "dark")
        until(lambda: "no zero" in seen(tab, "acting"))
        assert "measured \u2013" in seen(tab, "plots")
        feed.device.zero()
        goes_on(feed, 1.0)
        until(lambda: goes_on(feed) or "measured 0." in seen(tab, "plots"))
        assert "no zero" not in seen(tab, "acting")
        feed.came_s = 0.0
        until(lambda: seen(tab, "state") == "NO LINK")
        assert "measured \u2013" in seen(tab, "plots")
        assert "press the physical stop" in seen(tab, "alarm")
    until(lambda: seen(tab, "state") == "NO CONNECTION")
    assert "press the physical stop" in seen(tab, "alarm")
    assert "s old. It has ended." in seen(tab, "alarm")
    assert (seen(tab, "stop"), tab.evaluate("page.stop.disabled")) == ("STOP\nnot available", True)
    assert tab.evaluate("getComputedStyle(document.querySelector('main')).opacity") < "0.5"


def test_pictures_have_each_bin_once_with_its_extremes(feed):
    rows, view, last, drawn = feed.device.subscribe(["sense_out"]), BrowserView(feed), -1, {}
    for time_s in (1.0, 0.013, 0.3, 0.007, 0.6):
        goes_on(feed, time_s)
        text, last = view.picture(last)
        told = json.loads(text, parse_constant=pytest.fail)
        measured = told["y"][2]  # of the torques wanted, set and measured
        for x, *pair in zip(told["x"][::2], measured[::2], measured[1::2], strict=True):
            assert drawn.setdefault(math.floor(x / 0.02), pair) is pair
    assert sorted(drawn) == list(range(last + 1))
    binned = {}
    for batch in rows.take(0.0):
        for ns, tau_Nm in zip(batch.board_ns.tolist(), batch.rows["tau_Nm"].tolist(), strict=True):
            binned.setdefault(ns // 20_000_000, []).append(tau_Nm)
    whole = [n for n in drawn if len(binned.get(n, ())) == 20]
    assert len(whole) > 80
    for n in whole:
        assert sorted(drawn[n]) == pytest.approx([min(binned[n]), max(binned[n])], abs=1e-4)


def test_silent_connections_and_odd_paths_leave_the_server_as_it_is(url, caplog):
    port = int(url.partition("/#")[0].rpartition(":")[2])
    for path in ("a%00b", "%2e%2e/__init__.py", "../__init__.py", "%ff"):
        with pytest.raises(HTTPError, match="404"):
            urlopen(f"http://127.0.0.1:{port}/{path}", timeout=60)
    assert "Traceback" not in caplog.text
    lines = [socket.create_connection(("127.0.0.1", port)) for _ in range(80)]
    lines[-1].settimeout(60)
    assert lines[-1].recv(1) == b""  # closed at once: files are left for a recording
    for line in lines:
        line.close()


def asked(url, *messages, **headers):
    """The code with which the server refuses a program, or ends the connection."""

    async def ask():
        try:
            address = url.replace("http", "ws", 1).replace("#", "live?key=")
            line = await websocket_connect(HTTPRequest(address, headers=headers))
        except HTTPClientError as error:
            return error.code
        for message in (*messages, "end"):
            line.write_message(message)
        while await line.read_message() is not None:
            pass
        return line.close_code

    return asyncio.run(ask())


def test_who_is_refused_stops_nothing(feed, url, monkeypatch):
    stops = []
    monkeypatch.setattr(feed, "stop", lambda: stops.append(1))
    # A page of another origin; one that has renamed this computer; a wrong key, and none.
    foreign = "http://example.org"
    assert asked(url, "stop", Origin=foreign) == asked(url, Origin="http://127.0.0.1:1") == 403
    assert asked(url, "stop", Origin=foreign, Host="example.org") == 403
    assert asked(url + "x", "stop") == asked(url.partition("#")[0] + "#", "stop") == 1008
    assert asked(url, "arm") == asked(url, b"\0") == 1008
    assert asked(url, "stop" * 100) in (1006, 1009)
    assert stops == []
    assert asked(url, "stop", Origin=url.partition("/#")[0]) == 1008
    assert stops == [1]


def test_a_slow_browser_holds_up_nobody_and_one_too_many_is_told(url):
    async def crowd():
        address = url.replace("http", "ws", 1).replace("#", "live?key=")
        lines = [await websocket_connect(address) for _ in range(9)]
        assert [await x.read_message() is None for x in lines] == [False] * 8 + [True]
        assert "Too many" in lines[8].close_reason
        for _ in range(3):  # the others ask for nothing
            lines[0].write_message("drawn")
            assert json.loads(await lines[0].read_message())["head"] is None
        for _ in range(2):
            lines[1].write_message("drawn")
        assert await lines[1].read_message() is None  # it asked before it had drawn

    asyncio.run(crowd())


@pytest.mark.parametrize(
    ("listen", "why"),
    [("127.0.0.1", "in use"), ("0.0.0.0", "every network"), ("no", "no, port"), (None, "--serve")],
)
def test_where_it_cannot_be_served_no_recording_is_begun(
    feed, url, tmp_path, monkeypatch, listen, why
):
    port = int(url.partition("/#")[0].rpartition(":")[2]) if why == "in use" else 0
    monkeypatch.setattr("esea_host.cli.view.need_a_screen", lambda _: None)
    monkeypatch.setattr("esea_host.cli.view.open_device", lambda *_: nullcontext(feed.device))
    with pytest.raises(UserError, match=why):
        view("sim:elbow_drive", record=tmp_path / "r.mcap", serve=listen, port=port)
    assert not list(tmp_path.iterdir())


@pytest.mark.ci
def test_the_command_serves_until_ctrl_c(tab):
    words = [sys.executable, "-m", "esea_host.cli", "serve", "sim:elbow_drive", "--port", "0"]
    with subprocess.Popen([*INTERRUPTIBLE, *words], stdout=subprocess.PIPE, text=True) as running:
        tab.opened(running.stdout.readline().strip(), 1024, "light")
        until(lambda: seen(tab, "state") == "UNREFERENCED")
        running.send_signal(signal.SIGINT)
        assert running.wait() == 0
    until(lambda: seen(tab, "state") == "NO CONNECTION")
