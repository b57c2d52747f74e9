"""``esea-host``: the command line.  One file a group of commands, read when one is typed."""

from esea_host.cli.app import app, main

__all__ = ["app", "main"]
