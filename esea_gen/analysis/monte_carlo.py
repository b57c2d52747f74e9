"""Many cases of one experiment: in parallel, resumable, the same numbers for any number of workers.

A journal in a folder holds one line a finished case, on the disk before the next one is taken; its
name is a hash of everything that the numbers depend on.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import platform
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from esea_gen import __version__
from esea_gen.errors import UserError

Array = npt.NDArray[np.float64]
Case = Mapping[str, Any]
Function = Callable[..., Mapping[str, float]]

LEVELS = (5.0, 25.0, 50.0, 75.0, 95.0)
RESAMPLES = 2000
CONFIDENCE = 0.95
IDLE_S = 20.0
TAIL = 400  # characters of a failure's text


def canonical(content: Any) -> str:
    """JSON of one form: sorted keys, shortest numbers, nothing that is not finite.

    Parameters
    ----------
    content : object
        JSON-ready content.

    Returns
    -------
    str
        One line.

    Raises
    ------
    UserError
        When something in it is not JSON-ready.
    """
    try:
        return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    except (TypeError, ValueError) as error:
        raise UserError(
            f"Not JSON-ready: {error}.", "Use text, finite numbers, lists and dicts with text keys."
        ) from None


def files_digest(files: Mapping[str, str]) -> str:
    """SHA-256 of generated files, for a configuration.

    Parameters
    ----------
    files : mapping of str to str
        Text by name.

    Returns
    -------
    str
        Hexadecimal.
    """
    return hashlib.sha256(json.dumps(sorted(files.items())).encode()).hexdigest()


def rooms_digest() -> str:
    """SHA-256 of what the figures of a study depend on beside the C that runs.

    Returns
    -------
    str
        Hexadecimal, of every source and number file of the rooms twin, analysis and studies.
    """
    top = Path(__file__).parents[1]
    found = [p for room in ("twin", "analysis", "studies") for p in (top / room).rglob("*")]
    return files_digest(
        {
            p.relative_to(top).as_posix(): p.read_text(encoding="utf-8")
            for p in sorted(found)
            if p.suffix in (".py", ".toml")
        }
    )


def file_digest(path: Path | str) -> str:
    """SHA-256 of a file, for a configuration.

    Parameters
    ----------
    path : path
        The file.

    Returns
    -------
    str
        Hexadecimal.

    Raises
    ------
    UserError
        When it cannot be read.
    """
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}).", "Check the path.") from None


def versions() -> dict[str, str]:
    """Versions that results depend on: this package, Python, numpy, scipy, casadi, the machine."""
    from importlib.metadata import version

    found = {name: version(name) for name in ("numpy", "scipy", "casadi")}
    return found | {
        "esea_gen": __version__,
        "python": platform.python_version(),
        "machine": platform.machine(),
    }


@dataclass(frozen=True)
class Configuration:
    """Everything beside the case that the numbers depend on.

    Parameters
    ----------
    parts : dict
        JSON-ready: content hash of the controller, digest of the plant file, settings.
    """

    parts: dict[str, Any]

    @property
    def key(self) -> str:
        """First 16 hexadecimal digits of the SHA-256 of parts and versions."""
        text = canonical({"parts": self.parts, "versions": versions()})
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def seeded(count: int, *, root: int = 0, **fixed: Any) -> list[dict[str, Any]]:
    """Cases that differ in their seed only.

    Parameters
    ----------
    count : int
        How many.
    root : int
        Root of the seeds; a longer list begins with the shorter one.
    **fixed
        Further arguments of every case.

    Returns
    -------
    list of dict
        ``{"seed": ..., **fixed}``; the seeds are independent 64-bit numbers.

    Raises
    ------
    UserError
        When count is below 1.
    """
    if count < 1:
        raise UserError(f"count: {count}.", "Ask for at least 1 case.")
    children = np.random.SeedSequence(root).spawn(count)
    return [{"seed": int(c.generate_state(1, np.uint64)[0]), **fixed} for c in children]


@dataclass(frozen=True)
class Result:
    """One case.

    Parameters
    ----------
    case : dict
        Its arguments.
    values : dict of str to float or None
        What came out; None when it failed.
    failure : str
        Why it failed, else empty.
    """

    case: dict[str, Any]
    values: dict[str, float] | None
    failure: str = ""


# -- journal --------------------------------------------------------------------------------------


class Journal:
    """Finished cases of one configuration, one JSON line each, in a file that survives kill -9.

    Parameters
    ----------
    folder : Path
        Made when missing.
    configuration : Configuration
        Names the file.
    """

    def __init__(self, folder: Path | str, configuration: Configuration) -> None:
        self.configuration = configuration
        self.path = Path(folder) / f"{configuration.key}.jsonl"

    @contextlib.contextmanager
    def opened(self) -> Iterator[tuple[dict[str, Result], Callable[[Result], None]]]:
        """The finished cases by key, and a function that adds one; for one process at a time.

        Yields
        ------
        tuple
            ``(finished, add)``; ``add`` returns when the line is on the disk.

        Raises
        ------
        UserError
            When the file cannot be written, is in use, or is damaged other than at its end.
        """
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            stream = self.path.open("a+b")
        except OSError as error:
            raise UserError(
                f"{self.path}: cannot be written ({error.strerror}).", "Give another folder."
            ) from None
        with stream:
            self._lock(stream)
            finished = self._read(stream)

            def add(result: Result) -> None:
                _append(stream, _line(result))

            yield finished, add

    def _lock(self, stream: IO[bytes]) -> None:
        try:
            import fcntl
        except ImportError:  # no such lock on this system: the user's own care
            return
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise UserError(
                f"{self.path}: another run is writing it.", "Wait for it or end it."
            ) from None

    def _read(self, stream: IO[bytes]) -> dict[str, Result]:
        stream.seek(0)
        content = stream.read()
        # A line is written at once and ends in a newline: what follows the last one is torn.
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            stream.truncate(whole)
            os.fsync(stream.fileno())
        lines = content[:whole].splitlines()
        head = canonical({"parts": self.configuration.parts, "versions": versions()})
        if not lines:
            _append(stream, head)
            return {}
        if lines[0].decode("utf-8", "replace") != head:
            raise UserError(
                f"{self.path}, line 1: not the head of this configuration.",
                "Move the file away; the run then starts anew.",
            )
        finished: dict[str, Result] = {}
        for number, line in enumerate(lines[1:], 2):
            try:
                entry = json.loads(line)
                result = Result(entry["case"], entry["values"], entry["failure"])
                if entry["check"] != _check(result):
                    raise ValueError("its check sum is wrong")
            except (ValueError, KeyError, TypeError) as error:
                raise UserError(
                    f"{self.path}, line {number}: damaged ({error}).",
                    "Delete this line; its case runs again.",
                ) from None
            finished[canonical(result.case)] = result
        return finished


def _append(stream: IO[bytes], line: str) -> None:
    stream.write(line.encode() + b"\n")
    stream.flush()
    os.fsync(stream.fileno())


def _check(result: Result) -> str:
    return hashlib.sha256(canonical(vars(result)).encode()).hexdigest()[:8]


def _line(result: Result) -> str:
    return canonical(vars(result) | {"check": _check(result)})


# -- running --------------------------------------------------------------------------------------


def _in_worker(function: Function, case: dict[str, Any], parent: int) -> Result:
    # Workers outlive a parent that was killed: no further case then, its result would be lost.
    if os.getppid() != parent:
        os._exit(1)
    return _run(function, case)


def _run(function: Function, case: dict[str, Any]) -> Result:
    """One case: an exception or a number that is not finite is a failure."""
    try:
        values = {str(k): float(v) for k, v in function(**case).items()}
    except Exception as error:
        text = "".join(traceback.format_exception_only(error)).strip()
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
    workers: int = 1,
    retry_failed: bool = False,
    progress: Callable[[int, int, int], None] | None = None,
) -> MonteCarlo:
    """Run a function over cases, in parallel, and keep what is finished.

    Parameters
    ----------
    function : callable
        ``function(**case) -> {name: number}``; draws only from the seed in its case.  With more
        than one worker it travels to other processes.
    cases : sequence of dict
        JSON-ready arguments, no two alike.
    configuration : Configuration
        What else the numbers depend on.
    folder : path, optional
        Of the journal; without it nothing is kept.
    workers : int
        Processes; -1 for one a core.
    retry_failed : bool
        Run cases again that the journal holds as failed.
    progress : callable, optional
        ``progress(done, total, failed)`` at the start and after each case.

    Returns
    -------
    MonteCarlo
        In the order of ``cases``, the same for any number of workers and any interruption.

    Raises
    ------
    UserError
        On cases that are not JSON-ready or occur twice, an unusable journal, or a worker that dies.

    Notes
    -----
    A case's numbers may differ in the last bits between one worker and several where it uses a BLAS
    with threads, since workers have one thread each; generated C has none.
    """
    plain: dict[str, dict[str, Any]] = {}
    for case in cases:
        text = canonical(dict(case))
        if text in plain:
            raise UserError(f"cases: {text} occurs twice.", "Give each case its own seed or name.")
        # Through JSON, so that a case is the same before and after an interruption.
        plain[text] = json.loads(text)
    if not plain:
        raise UserError("cases: none.", "Give at least one.")
    if workers < 1 and workers != -1:
        raise UserError(f"workers: {workers}.", "Give 1 or more, or -1 for one a core.")
    with contextlib.ExitStack() as stack:
        finished: dict[str, Result] = {}
        add: Callable[[Result], None] = _forget
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
        for result in _results(function, [c for k, c in plain.items() if k not in done], workers):
            add(result)
            done[canonical(result.case)] = result
            report()
    return MonteCarlo(configuration, tuple(done[k] for k in plain))


def _forget(_: Result) -> None:
    return


def _results(function: Function, cases: list[dict[str, Any]], workers: int) -> Iterator[Result]:
    if workers == 1 or not cases:
        yield from (_run(function, case) for case in cases)
        return
    import joblib
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    # One case a batch: a batch that dies with its worker would lose all of its cases.  Idle workers
    # of a killed parent go after the timeout.
    pool = joblib.Parallel(
        n_jobs=workers,
        return_as="generator_unordered",
        batch_size=1,
        max_nbytes=None,  # no shared memory that a killed run would leave behind
        idle_worker_timeout=IDLE_S,
    )
    try:
        yield from pool(joblib.delayed(_in_worker)(function, case, os.getpid()) for case in cases)
    except TerminatedWorkerError:
        raise UserError(
            "A worker process died: a crash in compiled code, or no memory left.",
            "Finished cases are kept; run again with workers=1 to see which case it is.",
        ) from None


# -- statistics -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Percentiles:
    """Distribution of one figure.

    Parameters
    ----------
    name : str
        The figure.
    count, failed : int
        Cases that gave it, and cases that failed.
    values : dict of float to float
        Percentile (5, 25, 50, 75, 95) to value, of the cases that gave it.
    low, high : dict of float to float
        95 % bootstrap interval of each.
    largest : float
        Largest value; no interval, since no resample goes beyond it.
    """

    name: str
    count: int
    failed: int
    values: dict[float, float]
    low: dict[float, float]
    high: dict[float, float]
    largest: float

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content: ``p5``, ``p5_low``, ``p5_high``, ..., ``max``."""
        content: dict[str, Any] = {"count": self.count, "failed": self.failed}
        for level, value in self.values.items():
            stem = f"p{level:g}"
            content |= {
                stem: value,
                f"{stem}_low": self.low[level],
                f"{stem}_high": self.high[level],
            }
        return content | {"max": self.largest}


def percentiles(name: str, values: npt.ArrayLike, *, failed: int = 0) -> Percentiles:
    """Percentiles of some values, each with its bootstrap interval.

    Parameters
    ----------
    name : str
        What they are.
    values : array_like
        Finite, shape (n,).
    failed : int
        Cases that gave none, for the record.

    Returns
    -------
    Percentiles
        The same for the same values in any order.

    Raises
    ------
    UserError
        When there is no value, or one is not finite.

    Notes
    -----
    Linear interpolation between order statistics; interval: 2.5 and 97.5 % of the percentile over
    2000 resamples with a fixed seed [1]_.  With few cases the outer percentiles' intervals are too
    narrow, since nothing beyond the extremes can be drawn: below 60 cases take the largest value.

    References
    ----------
    .. [1] B. Efron, R. J. Tibshirani, An Introduction to the Bootstrap, Chapman & Hall, 1993,
       chapter 13.
    """
    found = np.sort(np.asarray(values, dtype=np.float64).ravel())
    if not found.size or not np.all(np.isfinite(found)):
        raise UserError(
            f"{name}: {found.size} values, {np.count_nonzero(~np.isfinite(found))} not finite.",
            "Count cases without a finite value as failed.",
        )
    rng = np.random.default_rng(20230915)
    point = np.percentile(found, LEVELS)
    drawn = np.empty((RESAMPLES, len(LEVELS)))
    block = max(1, 2_000_000 // found.size)  # 16 MB at a time
    for start in range(0, RESAMPLES, block):
        stop = min(start + block, RESAMPLES)
        picks = rng.integers(0, found.size, (stop - start, found.size))
        drawn[start:stop] = np.percentile(found[picks], LEVELS, axis=1).T
    edge = 50 * (1 - CONFIDENCE)
    low, high = np.percentile(drawn, (edge, 100 - edge), axis=0)

    def named(row: Array) -> dict[float, float]:
        return dict(zip(LEVELS, row.tolist(), strict=True))

    return Percentiles(
        name, found.size, failed, named(point), named(low), named(high), float(found[-1])
    )


@dataclass(frozen=True)
class MonteCarlo:
    """Results of all cases.

    Parameters
    ----------
    configuration : Configuration
        What they were made with.
    results : tuple of Result
        In the order of the cases.
    """

    configuration: Configuration
    results: tuple[Result, ...]

    @property
    def failures(self) -> tuple[Result, ...]:
        """Cases that failed."""
        return tuple(r for r in self.results if r.values is None)

    def values(self, name: str, where: Mapping[str, Any] | None = None) -> Array:
        """One figure of all cases that did not fail.

        Parameters
        ----------
        name : str
            The figure.
        where : dict, optional
            Only cases with these arguments.

        Returns
        -------
        ndarray
            In the order of the cases.

        Raises
        ------
        UserError
            When no case has this figure.
        """
        found = [
            r.values[name] for r in self._chosen(where) if r.values is not None and name in r.values
        ]
        if not found:
            have = sorted({k for r in self.results if r.values is not None for k in r.values})
            raise UserError(f"No case gave '{name}'.", f"Choose from {', '.join(have) or 'none'}.")
        return np.array(found)

    def _chosen(self, where: Mapping[str, Any] | None) -> list[Result]:
        wanted = dict(where or {})
        return [r for r in self.results if all(r.case.get(k) == v for k, v in wanted.items())]

    def summary(self, where: Mapping[str, Any] | None = None) -> dict[str, Percentiles]:
        """Percentiles of every figure.

        Parameters
        ----------
        where : dict, optional
            Only cases with these arguments.

        Returns
        -------
        dict of str to Percentiles
            By figure, sorted; empty when every case failed.  A case without a figure that others
            have counts as failed for it.
        """
        chosen = self._chosen(where)
        names = sorted({k for r in chosen if r.values is not None for k in r.values})
        out = {}
        for name in names:
            have = [r.values[name] for r in chosen if r.values is not None and name in r.values]
            out[name] = percentiles(name, have, failed=len(chosen) - len(have))
        return out

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content: configuration, percentiles, failures, every case."""
        return {
            "configuration": self.configuration.parts,
            "key": self.configuration.key,
            "versions": versions(),
            "cases": len(self.results),
            "failed": len(self.failures),
            "summary": {k: p.to_dict() for k, p in self.summary().items()},
            "failures": [{"case": r.case, "failure": r.failure} for r in self.failures],
            "results": [{"case": r.case, "values": r.values} for r in self.results],
        }

    def table(self) -> list[str]:
        """Failures first, then one line a figure: percentiles, the 95 % with its interval, max."""
        lines = [f"{len(self.results)} cases, {len(self.failures)} failed"]
        lines += [f"  FAILED {canonical(r.case)}: {r.failure}" for r in self.failures[:10]]
        if len(self.failures) > 10:
            lines.append(f"  ... {len(self.failures) - 10} more")
        heads = "".join(f"{f'{level:g} %':>10}" for level in LEVELS)
        lines.append(f"{'':28}{heads}{'95 % interval':>22}{'max':>10}")
        for name, p in self.summary().items():
            cells = "".join(f"{p.values[level]:>10.4g}" for level in LEVELS)
            interval = f"{p.low[95.0]:.4g} .. {p.high[95.0]:.4g}"
            lines.append(f"{name:28}{cells}{interval:>22}{p.largest:>10.4g}")
        return lines
