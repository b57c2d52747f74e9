"""Where Linux, macOS and Windows differ: folders, files, locks, terminals, signals, processes."""

from __future__ import annotations

import _thread
import codecs
import errno
import os
import re
import select
import shlex
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import threading
import time
import unicodedata
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import platformdirs


def user_folder(kind: str, program: str) -> Path:
    """A user's ``cache`` or ``config``; ``$XDG_CACHE_HOME``, ``$XDG_CONFIG_HOME`` go before."""
    if base := os.environ.get(f"XDG_{kind.upper()}_HOME"):
        return Path(base) / program
    return Path(getattr(platformdirs, f"user_{kind}_dir")(program, False))


# -- files -----------------------------------------------------------------------------------------

BINARY = getattr(os, "O_BINARY", 0)  # else Windows changes the ends of lines
AT_ONCE = getattr(os, "O_NONBLOCK", 0)  # a named pipe would never answer
path_limit = getattr(os, "pathconf", lambda *_: 255)  # of a folder, by name
PATIENCE_S = 2.0  # for a virus scanner or an indexer that looks at a new file
_LOCKED_BYTE = 1 << 30  # far behind the text: Windows lets nobody read a locked byte
_TAKEN = {errno.EACCES, errno.EAGAIN, getattr(errno, "EDEADLOCK", errno.EAGAIN)}
_DEVICE = re.compile(r"(?i)(con|prn|aux|nul|(com|lpt)[1-9])(\..*)?")


def check_file_name(name: str) -> str:
    """Return a word that a file can be called on every system; else ValueError."""
    if _DEVICE.fullmatch(name):
        raise ValueError("is the name of a device on Windows")
    return name


def in_use(error: OSError) -> bool:
    """Whether Windows does not replace a file: denied, open or locked in another program."""
    return getattr(error, "winerror", None) in (5, 32, 33)


def replace(source: Path, target: Path) -> None:
    """Put a file in the place of another one, or a folder in that of an empty one."""
    until_s, wait_s = time.monotonic() + PATIENCE_S, 0.01
    while True:
        try:
            if sys.platform == "win32" and source.is_dir() and target.is_dir():
                target.rmdir()
            os.replace(source, target)
            return
        except OSError as error:
            if not in_use(error) or time.monotonic() > until_s:
                raise
        time.sleep(wait_s)
        wait_s *= 2


def rename_new(source: Path, target: Path) -> None:
    """Rename a file; FileExistsError, and nothing changed, where the new name is taken."""
    os.close(os.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600))
    try:
        os.replace(source, target)
    except OSError:
        target.unlink()
        raise


def sync_folder(folder: Path) -> None:
    """Have the name of a new file outlast a power failure; Windows has no such call."""
    if sys.platform != "win32":
        file = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(file)
        finally:
            os.close(file)


def try_lock(file: int) -> bool:
    """Lock an open file for this process; the system releases it when the process dies."""
    try:
        if sys.platform == "win32":
            import msvcrt

            os.lseek(file, _LOCKED_BYTE, os.SEEK_SET)
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in _TAKEN:
            return False
        raise
    return True


def lock_holder(path: str | Path) -> str:
    """Number of the process that has locked a file, where the system tells; else empty."""
    locks = Path("/proc/locks")
    if sys.platform != "linux" or not locks.exists():
        return ""
    at = os.stat(path)
    name = f" {os.major(at.st_dev):02x}:{os.minor(at.st_dev):02x}:{at.st_ino} "
    lines = locks.read_text(encoding="ascii").splitlines()
    return next((x.partition(name)[0].split()[-1] for x in lines if name in x), "")


def others_rights(about: os.stat_result) -> tuple[int, int]:
    """Number of another owner, else 0; the rights of others.  Windows has lists: not read here."""
    if sys.platform == "win32":
        return 0, 0
    owner = about.st_uid if about.st_uid != os.geteuid() else 0
    return owner, stat.S_IMODE(about.st_mode) & 0o077


# -- processes and terminals -----------------------------------------------------------------------

CAN_FORK = TERMINALS = sys.platform != "win32"
# Ctrl+C comes as KeyboardInterrupt everywhere.
_ENDING = ("SIGTERM", "SIGHUP", "SIGBREAK")
ENDING_SIGNALS: list[signal.Signals] = [getattr(signal, n) for n in _ENDING if hasattr(signal, n)]


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Let Ctrl+C and the ending signals wait until this is done: nothing stays half written."""
    came: list[int] = []
    numbers = [signal.SIGINT, *ENDING_SIGNALS]
    if threading.current_thread() is not threading.main_thread():
        numbers = []  # Python tells the main thread alone
    before = {n: signal.signal(n, lambda number, _: came.append(number)) for n in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])


def signal_again(number: int) -> threading.Timer:
    """Send this program a signal a moment later; who waits for it joins what is returned."""
    if sys.platform == "win32":
        timer = threading.Timer(0.005, _thread.interrupt_main, [number])
    else:  # what waits in the main thread is woken
        main = threading.main_thread().ident
        timer = threading.Timer(0.005, signal.pthread_kill, [main, number])
    timer.start()
    return timer


def processors() -> int:
    """Processors that this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def command_line(*words: str) -> str:
    """Words as a person types them into this system's shell."""
    return subprocess.list2cmdline(words) if sys.platform == "win32" else shlex.join(words)


def limit_memory(most_bytes: int) -> None:
    """Let this process have no more memory, where the system can."""
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (most_bytes, most_bytes))


def passes_apart(job: Callable[[], bool], limit_s: int) -> bool:
    """Whether a job returns True within a time, in a copy of this process that it may break."""
    if sys.platform == "win32":
        raise NotImplementedError
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # the child starts no thread
        child = os.fork()
    if child == 0:
        signal.alarm(limit_s)
        code = 1
        try:
            code = int(not job())
        finally:
            os._exit(code)
    return os.waitpid(child, 0)[1] == 0


@contextmanager
def listening_for_qemu() -> Iterator[tuple[socket.socket, str]]:
    """A socket that QEMU calls, and its words for where: nobody else can take one that we hold."""
    if sys.platform == "win32":
        with socket.create_server(("127.0.0.1", 0), backlog=1) as server:
            yield server, f"socket,host=127.0.0.1,port={server.getsockname()[1]},server=off"
    else:
        with (
            tempfile.TemporaryDirectory(prefix="esea-") as folder,
            socket.socket(socket.AF_UNIX) as server,
        ):
            server.bind(f"{folder}/link")
            server.listen(1)
            yield server, f"socket,path={folder}/link,server=off"


def raw_terminal(path: str | Path) -> int:
    """Open a terminal, raw, without waiting, unlocked; OSError if it is not a terminal."""
    if sys.platform == "win32":
        raise NotImplementedError
    import termios
    import tty

    handle = os.open(path, os.O_RDWR | os.O_NOCTTY)
    try:
        if not try_lock(handle):  # as pyserial does
            raise BlockingIOError
        tty.setraw(handle, termios.TCSANOW)  # not after a flush: what has come stays
        os.set_blocking(handle, False)
    except BaseException as error:
        os.close(handle)
        if isinstance(error, termios.error):
            raise OSError(errno.ENOTTY, f"it is not a terminal: {error.args[1]}") from None
        raise
    return handle


def raw_terminal_pair() -> tuple[int, int, str]:
    """Both ends of a new pseudo terminal, ours without waiting, and the name of the other."""
    if sys.platform == "win32":
        raise NotImplementedError
    import tty

    ours, theirs = os.openpty()
    tty.setraw(theirs)
    os.set_blocking(ours, False)
    return ours, theirs, os.ttyname(theirs)


def other_end_left(link: socket.socket) -> bool:
    """Whether the other end of a non-blocking socket has closed it; on Linux before all is read."""
    if sys.platform == "linux":
        poll = select.poll()
        poll.register(link, select.POLLRDHUP)
        return bool(poll.poll(0))
    try:
        return link.recv(1, socket.MSG_PEEK) == b""
    except OSError as error:
        return not isinstance(error, BlockingIOError)


# Signs that our texts have and a console's encoding may lack.
_NEAR = dict(zip("\u2212\u2013\u207b\u201c\u201d\u00b7\u00d7\u00b5", '---"".xu', strict=True))
_NEAR |= {"\u2026": "...", "\u221e": "inf", "\u00b0": " deg", "\u00b1": "+-"}


def _nearest_signs(error: UnicodeError) -> tuple[str, int]:
    # In ASCII; of other letters the number, so that a file's name can be made out.
    if not isinstance(error, UnicodeEncodeError):
        raise error
    out = ""
    for sign in error.object[error.start : error.end]:
        digit = unicodedata.digit(sign, None)  # superscripts
        near = _NEAR.get(sign) or ("" if digit is None else str(digit))
        out += near or sign.encode("ascii", "backslashreplace").decode("ascii")
    return out, error.end


codecs.register_error("nearest_signs", _nearest_signs)
