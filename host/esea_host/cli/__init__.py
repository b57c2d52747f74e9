"""``esea-host``: the command line.  One file a group of commands; each registers itself."""

from esea_host.cli import (
    analyse,
    assess,
    board,
    bridge,
    commission,
    demo,
    interaction,
    live,
    logs,
    session,
    study,
    view,
    virtual,
    wrist,
)
from esea_host.cli.app import app, main

__all__ = [
    "analyse",
    "app",
    "assess",
    "board",
    "bridge",
    "commission",
    "demo",
    "interaction",
    "live",
    "logs",
    "main",
    "session",
    "study",
    "view",
    "virtual",
    "wrist",
]
