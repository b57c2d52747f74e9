"""A link that breaks and comes back: the gap, the window's words, and no command of before."""

from __future__ import annotations

import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

import esea_host
from esea_gen.link.transport import LinkError, open_transport
from esea_host.connection import device as device_module
from esea_host.windows.feed import LiveFeed
from tests.conftest import until
from tests.link.test_host_link import Proxy, served


@pytest.fixture
def cut(simulated_elbow):
    """A board whose line can be pulled out."""
    with served(simulated_elbow, 3.0) as port:
        made = Proxy(port)
        yield made
        made.close()


def test_a_board_that_started_again_leaves_a_gap_as_long_as_it_was_away(
    cut, simulated_elbow, tmp_path, monkeypatch
):
    drive, again, away_s = simulated_elbow, threading.Event(), 0.5
    tick, known = drive.tick, device_module.identify

    def turn() -> None:  # in the thread that serves it
        if again.is_set():
            drive.board.lib.sim_unique(12345678)
            drive.restart()
            drive.board.lib.sim_unique(0)
            again.clear()
        tick()

    monkeypatch.setattr(drive, "tick", turn)
    with esea_host.connect(cut.address) as device, device.record(tmp_path / "a.mcap") as recording:
        device.listen_named(["tau_Nm"])
        monkeypatch.setattr(device_module, "identify", lambda *a: time.sleep(away_s) or known(*a))
        until(lambda: recording.rows >= 2000)
        cut.loses = True
        again.set()
        until(lambda: drive.ticks >= 2000 and not again.is_set())  # only its start tells
        cut.pull()
        until(lambda: device.receiver.reconnects)
        before = recording.rows
        until(lambda: recording.rows >= before + 500)
    with esea_host.open_log(tmp_path / "a.mcap") as log:
        for stream in ("sense_out", "control_out", "chosen"):
            (gap,), (first, second) = log[stream].gaps, log[stream].pieces()
            assert (gap.reason, gap.missing) == ("disconnected", -1)
            assert (first.tick[-1], second.tick[0]) == (gap.after_tick, gap.before_tick)
            assert second.time_s[0] > first.time_s[-1] + away_s


def test_a_command_that_waits_while_the_link_breaks_is_not_sent_afterwards(cut):
    with esea_host.connect(cut.address) as device:
        cut.loses = True
        with ThreadPoolExecutor() as pool:
            waiting = pool.submit(device.arm)
            until(lambda: device.receiver.asked_by is not None)
            cut.pull()
            with pytest.raises(LinkError, match=r"^No link since "):
                waiting.result(60.0)
        until(lambda: device.receiver.reconnects)
        assert device.clock()["refused"] == 0  # what came at all was not an arming


def test_who_comes_second_is_refused_at_once_and_learns_who_is_first(cut, monkeypatch):
    monkeypatch.setattr("esea_host.simulated.server.GUEST_S", 60.0)  # for a stop of theirs
    with (
        esea_host.connect(cut.address),
        pytest.raises(LinkError, match=r"commands this board .127\.0\.0\.1:\d+"),
    ):
        esea_host.connect(cut.address)
    ours, theirs = os.openpty()
    first = open_transport(f"pty:{os.ttyname(theirs)}")
    for kind in ("pty", "serial"):
        with pytest.raises(LinkError, match=f"process {os.getpid()} is connected to the board"):
            open_transport(f"{kind}:{os.ttyname(theirs)}")
    first.close()
    open_transport(f"pty:{os.ttyname(theirs)}").close()
    os.close(ours)
    os.close(theirs)


def test_the_window_shows_since_when_what_was_known_and_connects_again(cut, qtbot, monkeypatch):
    from esea_host.windows.live import LiveWindow

    with esea_host.connect(cut.address) as device:
        feed = LiveFeed(device)
        window = LiveWindow(feed)
        window.timer.stop()
        qtbot.addWidget(window)
        until(lambda: feed.news.state != "UNKNOWN")
        before, back = feed.news.state, threading.Event()
        known = device_module.identify
        monkeypatch.setattr(device_module, "identify", lambda *a: back.wait(60.0) and known(*a))
        cut.pull()
        until(lambda: device.receiver.away)
        feed.do("Arm", device.arm)
        until(lambda: feed.news.said.startswith("Arm: No link since"))
        window.draw()
        assert window.bar.state.text() == "NO LINK"
        told = window.bar.words.text()
        assert told.startswith("No link since ")
        assert told.endswith(f"Last state: {before}. Reconnecting.")
        assert "Bad file descriptor" not in told + feed.news.said
        assert "Link: none" in window.bar.who.text()
        back.set()
        until(lambda: feed.news.said.startswith("The link is back since"))
        window.draw()
        assert window.bar.state.text() == before
        feed.close()
