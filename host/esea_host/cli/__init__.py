"""``esea-host``: the command line.  One file a group of commands, read when one is typed."""

import sys

try:
    from esea_host.cli.app import app, main
except KeyboardInterrupt:
    print("esea-host: stopped before it began.", file=sys.stderr)
    raise SystemExit(130) from None

__all__ = ["app", "main"]
