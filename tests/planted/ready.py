"""A Python with other people's libraries loaded, which forks itself for each run of pytest."""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from contextlib import suppress
from importlib import import_module
from typing import Any, NoReturn

# What most test files load, or load for them; one that is not there is for who needs it to miss.
LOADED = """
    pytest hypothesis numpy scipy.optimize scipy.signal scipy.stats scipy.integrate scipy.linalg
    casadi sympy jinja2 cffi pycparser pydantic tomllib typer typer.testing rich.console
    matplotlib.pyplot joblib PySide6.QtWidgets PySide6.QtTest
"""
LOOK_S = 0.005
CHECK = "esea-gen check"  # in place of a test: emits every device, and compares


def _run(request: dict[str, Any]) -> NoReturn:
    import pytest

    os.setsid()
    said = os.open(request["said"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    nothing = os.open(os.devnull, os.O_RDONLY)
    for fd, standard in ((nothing, 0), (said, 1), (said, 2)):
        os.dup2(fd, standard)
    os.environ.update(request["env"])
    code = 1
    try:
        if request["arguments"][-1] == CHECK:
            sys.argv = CHECK.split()
            import_module("esea_gen.cli").main()
            code = 0
        else:
            code = int(pytest.main(request["arguments"]))
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _code(child: int, limit_s: float | None) -> int | None:
    end = None if limit_s is None else time.monotonic() + limit_s
    status = None
    while status is None and (end is None or time.monotonic() < end):
        done, told = os.waitpid(child, os.WNOHANG)
        if done:
            status = told
        else:
            time.sleep(LOOK_S)
    # What a test has started ends with it.
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(child, signal.SIGKILL)
    if status is None:
        os.waitpid(child, 0)
        return None
    return os.waitstatus_to_exitcode(status)


def main() -> None:
    """Answer each line of standard input until it ends."""
    for name in LOADED.split():
        with suppress(ImportError):
            import_module(name)
    for line in sys.stdin:
        request = json.loads(line)
        child = os.fork()
        if not child:
            _run(request)
        print(json.dumps(_code(child, request["limit_s"])), flush=True)


if __name__ == "__main__":
    main()
