"""``esea-gen``: the command line.  One file a group of commands, read when one of them is typed."""

import sys

try:
    from esea_gen.cli.app import app, main
except KeyboardInterrupt:
    print("esea-gen: stopped before it began.", file=sys.stderr)
    raise SystemExit(130) from None

__all__ = ["app", "main"]
