"""``esea-host``: the command line.  One file a group of commands; each registers itself."""

from esea_host.cli import analyse
from esea_host.cli import demo as demo
from esea_host.cli import live as live
from esea_host.cli import logs as logs
from esea_host.cli.app import app, main

__all__ = ["analyse", "app", "main"]
from esea_host.cli import analyse, study, wrist
from esea_host.cli.app import app, main

__all__ = ["analyse", "app", "main", "study", "wrist"]
from esea_host.cli import assess
from esea_host.cli.app import app, main

__all__ = ["app", "assess", "main"]
