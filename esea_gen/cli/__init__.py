"""``esea-gen``: the command line.  One file a group of commands, read when one of them is typed."""

try:
    from esea_gen.cli.app import app, main
except KeyboardInterrupt:  # nothing is under way yet
    raise SystemExit(130) from None

__all__ = ["app", "main"]
