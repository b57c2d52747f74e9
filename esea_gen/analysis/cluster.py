"""Workers on other machines: a Dask scheduler's.

A worker must be able to give the same numbers as this machine: same code, same versions, same
compiler, one case at a time.  This is looked at on connecting, and by each worker before a case.
"""

from __future__ import annotations

import asyncio
import functools
import logging
import platform
import shutil
import subprocess
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from esea_gen.analysis.journal import files_digest, versions
from esea_gen.errors import UserError
from esea_gen.files import template_folder

CONNECT_S = 5.0
SHOWN = 3  # workers in a message
CARRY_ON = "A journal stores finished cases; run again to continue."


def code_digest() -> str:
    """SHA-256 of the package and its templates: everything that a case's numbers may come from."""
    package, templates = Path(__file__).parents[1], template_folder()
    found = {}
    for top, skipped in ((package, ("_templates", "_firmware")), (templates, ())):
        for path in top.rglob("*"):
            name = path.relative_to(top)
            if path.is_file() and "__pycache__" not in name.parts and name.parts[0] not in skipped:
                found[f"{top is package}/{name.as_posix()}"] = path.read_bytes().hex()
    return files_digest(found)


@functools.cache
def machine() -> dict[str, str]:
    """Properties that must be equal on every machine, in words."""
    gcc = "none"
    if shutil.which("gcc"):
        command = ["gcc", "-dumpfullversion"]
        gcc = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    return versions() | {
        "code of esea_gen": code_digest()[:12],
        "gcc": gcc,
        "libc": "-".join(platform.libc_ver()),
    }


def _differences(expected: dict[str, str], found: dict[str, str], threads: int) -> str:
    apart = [f"{k} {found.get(k)} (here {v})" for k, v in expected.items() if found.get(k) != v]
    if threads != 1:
        apart.append(f"{threads} threads (1 is needed: each case has its own process)")
    return ", ".join(apart)


def _refused(address: str, wrong: dict[str, str]) -> UserError:
    told = "; ".join(f"{worker}: {text}" for worker, text in list(wrong.items())[:SHOWN])
    more = f"; and {len(wrong) - SHOWN} more" if len(wrong) > SHOWN else ""
    return UserError(
        f"The cluster at {address} has workers that would not give this machine's numbers. "
        f"{told}{more}.",
        "Start every worker from the same installation as here, with --nthreads 1.",
    )


# -- connecting -----------------------------------------------------------------------------------


def _probe(address: str) -> None:
    """Ask who is there: the client itself waits for ever on a server of another kind."""
    from distributed.core import rpc

    async def ask() -> Any:
        async with asyncio.timeout(CONNECT_S), rpc(address, timeout=CONNECT_S) as server:
            return await server.identity()

    try:
        # In a thread of its own, since a notebook has a loop that runs.
        with ThreadPoolExecutor(1) as pool:
            said = pool.submit(asyncio.run, ask()).result()
        if said["type"] != "Scheduler":
            raise TypeError(f"a {said['type'].lower()} answers there")
    except Exception as error:
        reason = str(error) or f"no answer within {CONNECT_S:g} s"
        raise UserError(
            f"No Dask scheduler at '{address}' ({reason}).",
            "Give the address that `dask scheduler` prints, such as tcp://10.0.0.5:8786.",
        ) from None


def _check(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError:
        raise UserError(
            f"The scheduler at {address} has no worker.",
            f"Start one or more: dask worker {address} --nthreads 1 --nworkers -1",
        ) from None
    threads = client.ncores()
    found = client.run(machine, on_error="return")
    wrong = {}
    for worker, said in found.items():
        if isinstance(said, BaseException):
            wrong[worker] = f"cannot load this esea_gen ({said})"
        elif text := _differences(machine(), said, threads.get(worker, 1)):
            wrong[worker] = text
    if wrong:
        raise _refused(address, wrong)


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """A client of the scheduler, after all of its workers passed the check."""
    try:
        import distributed
    except ImportError:
        raise UserError(
            "A cluster needs dask.distributed, which is not installed.",
            'Install it here and on the workers: pip install "esea-gen[cluster]"',
        ) from None
    _probe(address)
    # Dask logs on stderr what is told here in one paragraph.
    log = logging.getLogger("distributed.client")
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", distributed.versions.VersionMismatchWarning)
            client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
        with client:
            _check(client, address)
            yield client
    finally:
        log.setLevel(level)


# -- running --------------------------------------------------------------------------------------


def _fit(work: Callable[[Any], Any], case: Any, expected: dict[str, str]) -> Any:
    """On the worker: the result, or as text why it is not fit. Workers join at any time."""
    from distributed import get_worker

    worker = get_worker()
    wrong = _differences(expected, machine(), worker.state.nthreads)
    return (worker.address, wrong) if wrong else work(case)


def run_on(
    client: Any, address: str, work: Callable[[Any], Any], cases: Iterable[Any]
) -> Iterator[Any]:
    """``work(case)`` of each case as it ends; nothing of a case that workers died of."""
    import distributed

    fit = functools.partial(_fit, work, expected=machine())
    futures = client.map(fit, list(cases), pure=False)
    try:
        ended = distributed.as_completed(futures, loop=client.loop)
        for future in ended:
            try:
                result = future.result()
            except distributed.KilledWorker:
                continue
            if isinstance(result, tuple):
                raise _refused(address, dict([result]))
            yield result
    except UserError:
        raise
    except Exception as error:
        told = " ".join(f"{type(error).__name__}: {error}".split())
        raise UserError(f"The cluster at {address} stopped ({told}).", CARRY_ON) from None
    finally:
        client.cancel(futures)
