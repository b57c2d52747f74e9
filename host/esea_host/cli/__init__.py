"""``esea-host``: the command line.  One file a group of commands; each registers itself."""

from esea_host.cli import analyse, interaction
from esea_host.cli.app import app, main

__all__ = ["analyse", "app", "interaction", "main"]
