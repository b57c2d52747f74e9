"""``esea-gen``: the command line.  One file a group of commands; each registers itself."""

from esea_gen.cli import (
    boards,
    evidence,
    experiments,
    exporting,
    faults,
    generate,
    identification,
    pages,
    startup,
)
from esea_gen.cli.app import app, main

__all__ = [
    "app",
    "boards",
    "evidence",
    "experiments",
    "exporting",
    "faults",
    "generate",
    "identification",
    "main",
    "pages",
    "startup",
]
