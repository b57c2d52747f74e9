"""Every failure of a command ends in one message and an exit code, never in a traceback."""

from __future__ import annotations

import csv
import errno
import json
import os
import re
import resource
import signal
import struct
import subprocess
import sys
import time
import tomllib
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import get_type_hints

import casadi
import pytest
import serial
import typer

from esea_gen import files
from esea_gen.cli.boundary import REMEDIES
from esea_gen.errors import UserError
from esea_gen.link.transport import LinkError
from tests.typed import typed

PROGRAMS = {"esea-gen": ["schema"], "esea-host": ["show", "a.mcap"]}
# What each of these commands does first.
FIRST = ("esea_gen.devices.schema.json_schema", "esea_host.cli.logs.open_log")


def errors():
    for number in REMEDIES:
        yield OSError(number, os.strerror(number), "a.csv"), 2, os.strerror(number)
    yield OSError(errno.ENOTRECOVERABLE, "State not recoverable"), 2, "State not recoverable"
    yield serial.SerialException("device reports readiness"), 2, "device reports readiness"
    yield struct.error("unpack requires 4 bytes"), 2, "A file is damaged"
    yield csv.Error("field larger than limit"), 2, "A file is damaged"
    yield UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid"), 2, "A file is damaged"
    yield json.JSONDecodeError("Expecting value", "", 0), 2, "A file is damaged"
    yield tomllib.TOMLDecodeError("Invalid value"), 2, "A file is damaged"
    yield EOFError("No data left in file"), 2, "A file is damaged"
    yield RecursionError("maximum"), 2, "nested too deeply"
    yield RuntimeError("Symlink loop from 'a'"), 2, "links form a loop"
    yield MemoryError(), 2, "Not enough memory"
    yield ModuleNotFoundError("no", name="pylsl.x"), 2, "needs pylsl, which is not installed"
    yield ImportError("libEGL.so.1: cannot open shared object file"), 2, "libEGL.so.1"
    yield UserError("It is wrong.", "Mend it."), 2, "It is wrong. Mend it."
    yield LinkError("the board was silent"), 2, "the board was silent"
    yield KeyboardInterrupt(), 130, "stopped"
    interrupted = ImportError("initialization failed")  # as of an extension while it is loaded
    interrupted.__cause__ = KeyboardInterrupt()
    yield interrupted, 130, "stopped"
    yield KeyError("x"), 70, "this is a bug in the program (KeyError: 'x')"


@pytest.fixture
def command(monkeypatch, capsys, tmp_path):
    """Exit code and what is said of a command in this process."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)

    def run(program: str, *words: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", [program, *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            import_module(f"{program.replace('-', '_')}.cli").main()
        said = capsys.readouterr()
        assert "Traceback" not in said.err, words
        return int(ended.value.code), " ".join(said.err.split())

    return run


@pytest.mark.parametrize("program", PROGRAMS)
def test_every_kind_of_error_is_one_message(command, monkeypatch, program, tmp_path):
    for error, code, words in errors():

        def fails(*_, error=error, **__):
            raise error

        for place in FIRST:
            monkeypatch.setattr(place, fails)
        ended, said = command(program, *PROGRAMS[program])
        assert (ended, words in said) == (code, True), said
        assert said.startswith(program) or code == 130
    # Of a fault the traceback is kept.
    (kept,) = (tmp_path / "cache" / "esea-gen" / "tracebacks").glob("*.txt")
    assert kept.name in said
    assert kept.read_text().startswith(program)
    assert "KeyError: 'x'" in kept.read_text()


@pytest.mark.parametrize("where", ["__SX__", "__del__"])
def test_ctrl_c_is_never_dropped(command, monkeypatch, where):
    """While CasADi converts an argument, or Python deletes one: both drop an exception."""
    argument = type("Argument", (), {where: lambda _: signal.raise_signal(signal.SIGINT)})

    def interrupted(*_, **__):
        with suppress(NotImplementedError):
            casadi.SX(argument())
        time.sleep(30)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    monkeypatch.setattr(FIRST[0], interrupted)
    assert command("esea-gen", "schema")[0] == 130
    signal.signal(signal.SIGINT, before)


def process(program: str, *words: object, **more) -> subprocess.Popen:
    module = program.replace("-", "_")
    command = [sys.executable, "-m", f"{module}.cli", *map(str, words)]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, **more)


def test_a_fault_of_a_file_of_ones_own_names_its_line(command):
    head = "from esea_gen.studies.simulation import ClosedLoopStudy as S\n"
    Path("own.py").write_text(f"{head}class A(S): name = title = 'a'; cases = lambda s: 1 / 0")
    code, said = command("esea-gen", "simulate", "own.py:a")
    assert (code, "own.py, line 2: ZeroDivisionError: division by zero." in said) == (2, True)


def test_output_that_nobody_reads_or_that_has_no_room(tmp_path):
    reader, writer = os.pipe()
    os.close(reader)
    rows, made = tmp_path / "s.csv", tmp_path / "s.json"
    rows.write_text("a,b\n" + "".join(f"{k**2},{k**3}\n" for k in range(9)))
    with open("/dev/full", "w") as full:
        for out, code, words in ((writer, 1, ""), (full, 2, "No space left on device")):
            done = process("esea-gen", "reliability", rows, "--json", made, stdout=out)
            said = done.communicate()[1]
            assert (done.returncode, words in said) == (code, True), said
            made.unlink()  # it was written
            assert "Traceback" not in said
            assert "Exception ignored" not in said
    os.close(writer)


def test_a_file_that_may_not_grow_leaves_nothing(tmp_path):
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))

    done = process("esea-gen", "schema", "--out", tmp_path / "s.json", preexec_fn=limit)
    assert "File too large" in done.communicate()[1]
    assert done.returncode == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.ci
def test_a_program_that_is_ended_closes_in_good_order():
    done = process("esea-host", "sim", "elbow_drive", "--tcp", "0", stdout=subprocess.PIPE)
    assert done.stdout.readline().startswith("simulated")
    done.send_signal(signal.SIGTERM)
    assert done.communicate()[1] == ""
    assert done.returncode == 128 + signal.SIGTERM


def test_files_are_written_whole_or_not_at_all(tmp_path):
    path, link = tmp_path / "a.txt", tmp_path / "link.txt"
    files.write_whole(path, "old")
    link.symlink_to(path)
    with pytest.raises(KeyError), files.written_whole(path) as scratch:
        scratch.write_text({}["new"])
    assert path.read_text() == "old"
    files.write_whole(link, "new")
    assert link.is_symlink()
    assert path.read_text() == "new"
    files.write_whole(Path("/dev/null"), "nothing is replaced")
    assert Path("/dev/null").is_char_device()
    with pytest.raises(UserError, match="cannot be written"), files.new_whole(path / "b"):
        pass
    with pytest.raises(UserError, match="is not empty"), files.new_whole(tmp_path):
        pass
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.txt", "link.txt"]
    with pytest.raises(UserError, match="is not a regular file"):
        files.read_whole(Path("/dev/zero"), "")
    with pytest.raises(UserError, match="more than 0 MiB"):
        files.read_whole(path, "", most_bytes=2)


def leaves(program: str):
    """Every command with its words."""
    root = typer.main.get_command(import_module(f"{program.replace('-', '_')}.cli.app").app)

    def below(command, words):
        if hasattr(command, "commands"):
            for name in list(command.commands):
                yield from below(command.commands[name], [*words, name])
        else:
            yield words, command

    return below(root, [])


def numbers(command):
    """Parameters that take numbers, each with whether only whole ones."""
    hints = get_type_hints(command.callback)
    for p in command.params:
        kind = re.search(r"\b(int|float)\b", str(hints.get(p.name)))
        if kind:
            yield p, kind[1] == "int"


@pytest.mark.parametrize("program", PROGRAMS)
def test_every_number_of_every_command_is_plain(command, program):
    for words, one in leaves(program):
        before = ["x"] * (sum(p.param_type_name == "argument" for p in one.params) - 1)
        given: list[str] = []
        for p, whole in numbers(one):
            option = p.param_type_name == "option"
            name = p.opts[0] if option else p.name.upper()
            bad = ["2,5", "1_0", "１", "nan", "inf", "1e999", "", *["2.5"] * whole]
            bad += ["-1"] * (p.name in ("seed", "cycles"))
            for text in bad:
                with pytest.raises((UserError, typer.BadParameter)):
                    p.process_value(typer.Context(one), text)
            given = [f"{name}=2,5"] if option else [*before, "2,5"]
        if given:  # one number of each command from its command line
            code, said = command(program, *words, *given)
            assert (code, name in said) == (2, True), (words, given, said)


@pytest.mark.parametrize("program", PROGRAMS)
def test_every_file_to_write_is_known_as_one(program):
    known = {}
    for words, one in leaves(program):
        for name, hint in get_type_hints(one.callback).items():
            p = next(p for p in one.params if p.name == name) if "Path" in str(hint) else None
            if p and p.metavar != "DIR" and re.match("Also|Output|Save|The page|Write", p.help):
                known[*words, name] = hasattr(p.callback, "writes")
    assert [o for o in known if not known[o]] == []
    assert len(known) > 20


def test_results_lie_beside_what_is_read_and_are_written_again(tmp_path):
    for _ in range(2):
        done = typed("simulate", "tuning", "--resume", "d", "--csv", "d/runs.csv", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    journal = next((tmp_path / "d").glob("*.jsonl"))
    said = typed("simulate", "tuning", "--resume", "d", "--csv", journal, cwd=tmp_path).stderr
    assert "is read: --resume and --csv" in " ".join(said.split())
    assert "twice" not in typed("identify", "m.toml", "--data", ".", "--out", ".").stderr


# What is no file among what a command needs.
NEEDED = {"code": "P01", "trial": 1, "--mass": 1, "--arm": 1, "--full-Nm": 1, "--column": "x"}


@pytest.mark.ci
@pytest.mark.parametrize("kind", ["folder", "garbage", "below"])
@pytest.mark.parametrize("program", PROGRAMS)
def test_no_input_of_any_command_is_a_fault(command, tmp_path, program, kind):
    """Every argument of every command is a file of this kind; without arguments its output is."""
    (tmp_path / "folder").mkdir()
    (tmp_path / "garbage").write_bytes(bytes(range(256)) * 16)
    bad = tmp_path / "garbage" / "x" if kind == "below" else tmp_path / kind
    for words, one in leaves(program):
        given: list[object] = []
        for p in one.params:
            key = p.name if p.param_type_name == "argument" else p.opts[0]
            value = NEEDED.get(key, f"file:{bad}" if key == "address" else bad)
            if p.param_type_name == "argument":
                given.append(value)
            elif p.required:
                given += [key, value]
            elif key == "--json" and kind in ("folder", "below"):
                given += [key, bad]
        if given and (words, kind) != (["assess", "build"], "garbage"):  # which it would replace
            code, said = command(program, *words, *given)
            assert code == 2, (words, given, said)
    assert {p.name for p in tmp_path.iterdir()} <= {"folder", "garbage", "cache"}
