"""The live view, opened and closed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from esea_host.windows.arm import add_arms
from esea_host.windows.feed import LiveFeed
from esea_host.windows.frame import qt_application, run_until_closed
from esea_host.windows.live import LiveWindow


def run_live(
    feed: LiveFeed,
    dark: bool | None = None,
    seconds: float | None = None,
    screenshot: Path | None = None,
    push: Callable[..., None] | None = None,
) -> None:
    """Open the view until it is closed; push: pushes a simulated board's axes, each so far, rad."""
    window = LiveWindow(feed, qt_application(dark))
    if push is not None:
        add_arms(window, feed, push)
    window.resize(1280, 860)
    run_until_closed(window, seconds, screenshot)
