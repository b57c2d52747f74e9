"""Run a typed command in this process: its output and exit code.

A process of its own reads CasADi and SciPy anew, 1 s of processor time; what needs one (imports,
Ctrl-C, workers) starts it itself.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
import traceback
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any
from unittest import mock

from esea_gen.cli import main


def typed(
    *words: object,
    cwd: Path | None = None,
    env: Mapping[str, str] | None = None,
    program: Callable[[], None] = main,
) -> CompletedProcess[str]:
    """Exit code and text, as ``subprocess.run`` gives them."""
    name = program.__module__.partition(".")[0].replace("_", "-")
    arguments = [name, *map(str, words)]
    said, complained = io.StringIO(), io.StringIO()
    code: object = 0
    with (
        mock.patch.object(sys, "argv", arguments),
        mock.patch.dict(os.environ, {"COLUMNS": "80"} | dict(env or {})),
        mock.patch.object(warnings, "showwarning", warnings.showwarning),
        contextlib.chdir(cwd or Path.cwd()),
        contextlib.redirect_stdout(said),
        contextlib.redirect_stderr(complained),
    ):
        try:
            program()
        except SystemExit as end:
            code = end.code
        except Exception:
            traceback.print_exc()
            code = 1
    if isinstance(code, str):
        complained.write(f"{code}\n")
        code = 1
    return CompletedProcess(arguments, int(code or 0), said.getvalue(), complained.getvalue())


def command(*words: object, **more: Any) -> tuple[int, str, str]:
    """Exit code, output, and what was said of errors, in one line."""
    done = typed(*words, **more)
    return done.returncode, done.stdout, " ".join(done.stderr.split())


def host_command(*words: object) -> tuple[int, str, str]:
    from esea_host.cli import main as host

    return command(*words, program=host)
