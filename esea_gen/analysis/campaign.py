"""One way to run many independent cases: here or on a cluster, resumable, always the same numbers.

Monte Carlo, sweeps of tunables, passivity maps: a function, a list of cases, and who runs them.
joblib starts processes here, a Dask scheduler elsewhere; the calling process writes the journal.
"""

from __future__ import annotations

import contextlib
import functools
import json
import math
import os
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

from esea_gen.analysis.cluster import connected, run_on
from esea_gen.analysis.journal import Configuration, Journal, Result, canonical
from esea_gen.analysis.monte_carlo import MonteCarlo
from esea_gen.errors import UserError

Case = Mapping[str, Any]
Progress = Callable[[int, int, int], None]
Function = Callable[..., Mapping[str, float]]

IDLE_S = 20.0
TAIL = 400  # characters of a failure's text
DIED = "its worker died each time: a crash in compiled code, or lack of memory"


@dataclass(frozen=True)
class Workers:
    """Executor of the cases.

    Parameters
    ----------
    jobs : int
        Processes on this machine; -1: all cores, 1 for none beside this one.
    cluster : str, optional
        Address of a Dask scheduler, whose workers then run all cases instead.
    """

    jobs: int = -1
    cluster: str | None = None

    def __post_init__(self) -> None:
        if self.jobs < 1 and self.jobs != -1:
            raise UserError(f"workers: {self.jobs}.", "Give 1 or more, or -1 for all cores.")


class Running(TypedDict, total=False):
    """What :func:`run_cases` takes of how cases run."""

    folder: Path | str | None
    workers: int | Workers
    progress: Progress | None


# -- running --------------------------------------------------------------------------------------


def _run(function: Function, case: dict[str, Any]) -> Result:
    """One case: an exception or a number that is not finite is a failure."""
    try:
        values = {str(k): float(v) for k, v in function(**case).items()}
    except Exception as error:
        told = isinstance(error, UserError)
        text = str(error) if told else "".join(traceback.format_exception_only(error)).strip()
        return Result(case, None, text[:TAIL])
    bad = [k for k, v in values.items() if not math.isfinite(v)]
    if bad or not values:
        return Result(case, None, f"{bad[0]} is {values[bad[0]]}" if bad else "gave no numbers")
    return Result(case, values)


def run_cases(
    function: Function,
    cases: Sequence[Case],
    *,
    configuration: Configuration,
    folder: Path | str | None = None,
    workers: int | Workers = 1,
    retry_failed: bool = False,
    progress: Progress | None = None,
) -> MonteCarlo:
    """Run cases in parallel: results in their order, independent of workers and resumption.

    Parameters
    ----------
    function : callable
        ``function(**case) -> {name: number}``; draws only from the seed in its case.  With more
        than one worker it travels to other processes; on a cluster its module must be there too.
    cases : sequence of dict
        JSON-ready arguments, no two alike.
    configuration : Configuration
        What else the numbers depend on.
    folder : path, optional
        Of the journal; without it nothing is kept.
    workers : int or Workers
        Who runs them; a number is that of processes on this machine, -1: all cores.
    retry_failed : bool
        Run cases again that the journal holds as failed.
    progress : callable, optional
        ``progress(done, total, failed)`` at the start and after each case.

    Notes
    -----
    A case's numbers may differ in the last bits between one worker and several where it uses a BLAS
    with threads, since workers have one thread each; so has this package where it sets OpenBLAS up,
    before NumPy is imported; generated C has none.

    When a worker dies, its cases run again.  One that a worker dies of even when it runs alone has
    failed; with one process there is no worker, and this process dies.
    """
    plain = _plain(cases)
    who = workers if isinstance(workers, Workers) else Workers(workers)
    with contextlib.ExitStack() as stack:
        finished: dict[str, Result] = {}
        add: Callable[[Result], None] | None = None
        if folder is not None:
            finished, add = stack.enter_context(Journal(folder, configuration).opened())
        done = {
            k: finished[k]
            for k in plain
            if k in finished and not (retry_failed and finished[k].values is None)
        }

        def report() -> None:
            if progress is not None:
                failed = sum(r.values is None for r in done.values())
                progress(len(done), len(plain), failed)

        report()
        missing = [c for k, c in plain.items() if k not in done]
        for result in _results(functools.partial(_run, function), missing, who):
            if add is not None:
                add(result)
            done[canonical(result.case)] = result
            report()
    return MonteCarlo(configuration, tuple(done[k] for k in plain))


def _plain(cases: Sequence[Case]) -> dict[str, dict[str, Any]]:
    plain: dict[str, dict[str, Any]] = {}
    for case in cases:
        text = canonical(dict(case))
        if text in plain:
            raise UserError(f"cases: {text} occurs twice.", "Give each case its own seed or name.")
        # Through JSON, so that a case is the same before and after an interruption.
        plain[text] = json.loads(text)
    if not plain:
        raise UserError("There are no cases.", "Give at least one.")
    return plain


Work = Callable[[dict[str, Any]], Result]
Engine = Callable[[Work, Iterator[dict[str, Any]]], Iterator[Result]]


@contextlib.contextmanager
def _engine(workers: Workers) -> Iterator[Engine]:
    """Iterator of finished results, without those of cases whose worker died."""
    if workers.cluster is not None:
        with connected(workers.cluster) as client:
            yield functools.partial(run_on, client, workers.cluster)
    else:
        yield map if workers.jobs == 1 else functools.partial(_run_here, workers.jobs)


def _noted(
    cases: Iterable[dict[str, Any]], given: list[dict[str, Any]]
) -> Iterator[dict[str, Any]]:
    for case in cases:
        given.append(case)
        yield case


def _results(work: Work, cases: list[dict[str, Any]], workers: Workers) -> Iterator[Result]:
    """Results as they end.

    When workers died, the cases that may be the reason run again, by halves, so that only a case
    that a worker dies of when it runs alone is one that failed.
    """
    if not cases:
        return
    with _engine(workers) as engine:
        groups = [cases]
        while groups:
            group = groups.pop()
            given: list[dict[str, Any]] = []
            ended = set()
            for result in engine(work, _noted(group, given)):
                ended.add(canonical(result.case))
                yield result
            lost = [case for case in given if canonical(case) not in ended]
            if len(group) == len(lost) == 1:
                yield Result(lost[0], None, DIED)
                continue
            half = len(lost) // 2
            groups += [g for g in (group[len(given) :], lost[half:], lost[:half]) if g]


def _run_here(jobs: int, work: Work, cases: Iterator[dict[str, Any]]) -> Iterator[Result]:
    """In processes of this machine; ends early when one dies, since all of them then end."""
    import joblib
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    # One case a batch, and none that waits in line: those that were given to a worker that dies are
    # lost.  Idle workers of a killed parent go after the timeout.
    pool = joblib.Parallel(
        n_jobs=jobs,
        return_as="generator_unordered",
        batch_size=1,
        pre_dispatch="n_jobs",
        max_nbytes=None,  # no shared memory that a killed run would leave behind
        idle_worker_timeout=IDLE_S,
    )
    with contextlib.suppress(TerminatedWorkerError):
        yield from pool(joblib.delayed(_in_process)(work, case, os.getpid()) for case in cases)


def _in_process(work: Work, case: dict[str, Any], parent: int) -> Result:
    # Workers outlive a parent that was killed: no further case then, its result would be lost.
    if parent not in (os.getpid(), os.getppid()):  # itself: joblib has no shared memory here
        os._exit(1)
    with warnings.catch_warnings():  # what there is to say of a device, the parent has said
        warnings.simplefilter("ignore", UserWarning)
        return work(case)
