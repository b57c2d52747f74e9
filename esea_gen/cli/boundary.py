"""Boundary of a program: turn every failure into one message and an exit code."""

from __future__ import annotations

import errno
import io
import os
import shlex
import signal
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, NoReturn

import typer

from esea_gen.cache import cache_folder
from esea_gen.cli.groups import take_values_as_typed
from esea_gen.errors import UserError, paragraphs
from esea_gen.link.received import shown_lines
from esea_gen.portability import ENDING_SIGNALS, TERMINALS, signal_again
from esea_gen.python_file import MODULE

# Exit codes; 0: done, 1: done with a negative result, or nobody reads the output any more.
REFUSED, FAULT, INTERRUPTED = 2, 70, 130
MOST_TRACEBACKS, MOST_LATE = 20, 200

ROOM = "Free disk space, or set other folders: TMPDIR for scratch files, XDG_CACHE_HOME for caches."
RIGHTS = "Give another path, or obtain access rights to this one."
AWAY = "Check address, cable and power."
GONE = "Check that the device is plugged in and works."
# What to do about what the machine refuses.
REMEDIES = {
    errno.ENOSPC: ROOM,
    errno.EDQUOT: ROOM,
    errno.EFBIG: "Raise the limit on the size of files: ulimit -f.",
    errno.EROFS: RIGHTS,
    errno.EACCES: RIGHTS,
    errno.EPERM: RIGHTS,
    errno.ENOENT: "Check the name.",
    errno.ENOTDIR: "Check the path: a folder in it is a file.",
    errno.EISDIR: "It is a folder: give a file.",
    errno.EEXIST: "Give another name.",
    errno.ENOTEMPTY: "Give a new folder.",
    errno.ELOOP: "Its symbolic links form a loop: give another file.",
    errno.ENAMETOOLONG: "Give a shorter name.",
    errno.EMFILE: "Raise the limit on open files: ulimit -n.",
    errno.ENFILE: "End other programs: all of this machine's files are open.",
    errno.ENOMEM: "End other programs, or use a smaller input.",
    errno.EADDRINUSE: "End the program that uses the port, or give another port (0: any).",
    errno.EADDRNOTAVAIL: AWAY,
    errno.ECONNREFUSED: AWAY,
    errno.ECONNRESET: AWAY,
    errno.EHOSTUNREACH: AWAY,
    errno.ENETUNREACH: AWAY,
    errno.ETIMEDOUT: AWAY,
    errno.EIO: GONE,
    errno.ENODEV: GONE,
    errno.ENXIO: GONE,
    errno.ENOEXEC: "Reinstall the program: it was built for another machine.",
}
# Errors of these modules come from what is read: files that are damaged, or of another kind.
READERS = {
    *("_csv", "csv", "gzip", "h5py", "json", "lz4", "lzma", "mcap", "pandas", "pyarrow"),
    *("struct", "tomlkit", "tomllib", "xml", "zipfile", "zlib", "zoneinfo", "zstandard"),
}
INPUT = "A file is damaged, or not of the kind that this command reads"


class Terminated(KeyboardInterrupt):
    """Somebody else ends the program: the same way out as Ctrl+C, so that files are closed."""


class Shown:
    """``verbose``: errors come with their traceback; ``streams``: the output is all there is."""

    program, verbose, streams = "", False, False
    lost = 0  # exit code of output that ended


class _Output(io.FileIO):
    # A reader that goes, or a full disk, ends the output, not the command: its files are written.

    def write(self, data: Any) -> Any:
        try:
            return super().write(data)
        except OSError as error:
            closed = error.errno in (errno.EPIPE, errno.EINVAL)  # the second one on Windows
            Shown.lost = 1 if closed else _told(Shown.program, error)
            os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())
            if Shown.streams:
                raise SystemExit(Shown.lost) from None
            return len(data)


def run(program: str, app: typer.Typer, quiet: Callable[[], bool] = lambda: False) -> NoReturn:
    """Run a program's command line, and end with its exit code."""
    Shown.program = program
    with _hooks(program, quiet) as ended_by:
        try:
            code = _outcome(program, app)
        except BaseException as error:
            code = _told(program, error)
        _let_go_of_output()
        code = code or Shown.lost
        if ended_by and code in (0, INTERRUPTED):
            code = 128 + ended_by[0]
    raise SystemExit(code)


def _outcome(program: str, app: typer.Typer) -> int:
    # As typer does it, but for what it hides: the end of the input, a pipe that closed.
    command: Any = typer.main.get_command(app)
    if f"_{program.upper().replace('-', '_')}_COMPLETE" in os.environ:
        take_values_as_typed()
        command(prog_name=program)
    try:
        with command.make_context(program, sys.argv[1:]) as context:
            command.invoke(context)
    except typer.Exit as end:
        return int(end.exit_code)
    except Exception as error:
        if not hasattr(error, "show"):  # of click: a word of the command line is wrong
            raise
        error.show()
        return int(getattr(error, "exit_code", REFUSED))
    return 0


def _told(program: str, error: BaseException) -> int:
    # Print what an error says to a person; the exit code.
    if isinstance(error, SystemExit):
        if isinstance(error.code, int | None):
            return error.code or 0
        _print(f"{program}: {error.code}")
        return REFUSED
    if by_hand(error):
        _print(f"{program}: stopped. Files written before are complete.")
        return INTERRUPTED
    said = explained(error)
    if Shown.verbose:
        with suppress(OSError, ValueError):
            traceback.print_exception(error)
    if said is None:
        _print(f"{program}: {_fault(program, error)}")
        return FAULT
    _print(f"{program}: {said}")
    return REFUSED


def by_hand(error: BaseException | None) -> bool:
    """Whether Ctrl+C is behind an error: a library that is being loaded makes it its own."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or (None if error.__suppress_context__ else error.__context__)
    return error is not None


def explained(error: BaseException) -> str | None:
    """Error and remedy; None for a fault of the program itself."""
    from esea_gen.link.transport import LinkError

    if isinstance(error, UserError | LinkError):
        return str(error)
    if isinstance(error, OSError) and type(error).__module__.partition(".")[0] not in READERS:
        names = (error.filename, error.filename2)
        where = " to ".join(os.fsdecode(n) for n in names if isinstance(n, str | bytes))
        what = error.strerror or str(error) or type(error).__name__
        return f"{where}: {what}. {REMEDIES.get(error.errno or 0, '')}" if where else (
            f"{what}. {REMEDIES.get(error.errno or 0, '')}"
        )  # fmt: skip
    if isinstance(error, RuntimeError) and str(error).startswith("Symlink loop"):  # pathlib's
        return f"{error}. {REMEDIES[errno.ELOOP]}"
    if isinstance(error, MemoryError):
        return "Not enough memory. Use a smaller input, or a machine with more memory."
    if isinstance(error, RecursionError):
        return f"{INPUT}: it is nested too deeply. {_given()}"
    if isinstance(error, ModuleNotFoundError) and error.name and not error.name.startswith("esea"):
        return (
            f"This command needs {error.name.partition('.')[0]}, which is not installed. "
            'Install it with: pip install "esea-gen[host]"'
        )
    if isinstance(error, ImportError) and ".so" in str(error):
        return f"A library cannot be loaded ({error}). Install the library that it names."
    module = type(error).__module__.partition(".")[0]
    if module in READERS or isinstance(error, UnicodeError | EOFError):
        return f"{INPUT} ({type(error).__name__}: {error}). {_given()}"
    frames = traceback.walk_tb(error.__traceback__)
    own = [(f, n) for f, n in frames if f.f_globals.get("__name__", "").startswith(MODULE)]
    if own:  # the last place in a law, study or task of somebody's own
        place = f"{own[-1][0].f_code.co_filename}, line {own[-1][1]}"
        return f"{place}: {type(error).__name__}: {error}. Correct the file; -v shows its calls."
    return None


def _given() -> str:
    # The files among the words of the command line.
    values = (w.partition("=")[2] if w.startswith("--") else w for w in sys.argv[1:])
    files = [w for w in values if w and os.path.exists(w)]
    return f"Check: {', '.join(files)}." if files else ""


def _fault(program: str, error: BaseException) -> str:
    # Keep the traceback for whoever mends it; people read where it is.
    text = "".join(traceback.format_exception(error))
    head = f"this is a bug in the program ({type(error).__name__}: {error})".rstrip(": ")
    frame = traceback.extract_tb(error.__traceback__)[-1:]
    where = "".join(f"{os.path.basename(f.filename)}, line {f.lineno}" for f in frame)
    try:
        folder = cache_folder() / "tracebacks"
        folder.mkdir(exist_ok=True)
        for old in sorted(folder.glob("*.txt"))[: 1 - MOST_TRACEBACKS]:
            old.unlink(missing_ok=True)
        name = f"{time.strftime('%Y%m%d-%H%M%S')}-{program}-{os.getpid()}.txt"
        words = shlex.join([program, *sys.argv[1:]])
        (folder / name).write_text(f"{words}\n{text}", encoding="utf-8", errors="replace")
    except OSError:
        return f"{head}, at {where}. Please report it with the command; -v shows the traceback."
    return f"{head}, at {where}. Please report it with this file: {folder / name}"


def _print(text: str) -> None:
    with suppress(OSError, ValueError):
        print(shown_lines(paragraphs(text)), file=sys.stderr, flush=True)


# -- the process ----------------------------------------------------------------------------------


@contextmanager
def _hooks(program: str, quiet: Callable[[], bool]) -> Iterator[list[int]]:
    # Signals, threads and warnings speak through the boundary while it is there.
    # gives: the signals that ended it.
    _have_streams()
    ended_by, late, over = list[int](), list[threading.Timer](), False

    def end(number: int, frame: Any) -> None:
        if over:
            return
        if _dropped(frame) and len(late) < MOST_LATE:
            late.append(signal_again(number))
            return
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        ended_by.append(number)
        own = signal.getsignal(signal.SIGINT)
        if callable(own) and own is not end:
            own(signal.SIGINT, frame)  # a window closes itself
            return
        raise Terminated

    def of_thread(given: Any) -> None:
        if given.exc_type is not SystemExit:
            _told(program, given.exc_value)

    def unraisable(given: Any) -> None:
        # While something is cleaned away: the command has its result, or its own error.
        if isinstance(given.exc_value, KeyboardInterrupt):
            late.append(signal_again(signal.SIGINT))  # it came at a moment when Python drops it
        elif Shown.verbose:
            _told(program, given.exc_value)

    def note(message: Any, category: type[Warning], *_: Any, **__: Any) -> None:
        if issubclass(category, UserWarning) and not quiet():
            _print(f"{program}: note: {message}")

    before = threading.excepthook, sys.unraisablehook, sys.excepthook, warnings.showwarning
    threading.excepthook, sys.unraisablehook = of_thread, unraisable
    sys.excepthook = lambda _, error, __: _told(program, error) and None  # of a window's buttons
    warnings.showwarning = note
    handlers = {}
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, *ENDING_SIGNALS):
            if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
                handlers[number] = signal.signal(number, end)
    try:
        yield ended_by
    finally:
        over = True  # what is still on its way is of a command that has ended
        for timer in late:
            timer.join()
        for number, handler in handlers.items():
            signal.signal(number, handler)
        threading.excepthook, sys.unraisablehook, sys.excepthook, warnings.showwarning = before


def _dropped(frame: Any) -> bool:
    # CasADi drops an exception that comes while it converts what it is given, as Python does in
    # the hook for those that it has dropped.
    while frame is not None and frame.f_globals.get("__name__") != "casadi.casadi":
        if frame.f_code.co_name == "unraisable":
            break
        frame = frame.f_back
    return frame is not None


def _have_streams() -> None:
    # A closed one is as good as none: else the first file that is opened takes its place.
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            with suppress(OSError):
                while os.open(os.devnull, os.O_RDWR) < number:
                    pass
            nothing = os.open(os.devnull, os.O_RDWR)  # stays open
            setattr(sys, name, os.fdopen(nothing, "w" if number else "r", encoding="utf-8"))
    was, console = sys.stdout, not TERMINALS and sys.stdout.isatty()  # Windows: takes no bytes
    if was is sys.__stdout__ and isinstance(was, io.TextIOWrapper) and not console:
        raw = _Output(was.fileno(), "w", closefd=False)
        how = was.line_buffering, was.write_through
        sys.stdout = io.TextIOWrapper(io.BufferedWriter(raw), was.encoding, None, None, *how)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # what this terminal's letters cannot write
            stream.reconfigure(errors="nearest_signs")


def _let_go_of_output() -> None:
    # What cannot be written has been told; Python would tell it again when it ends.
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            with suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
