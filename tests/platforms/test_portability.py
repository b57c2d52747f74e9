"""File names, open files, consoles and serial ports as other systems have them."""

import errno
from pathlib import PureWindowsPath

import pytest
from hypothesis import given
from hypothesis import strategies as st

from esea_gen import portability
from esea_gen.device import load_device
from esea_gen.emit.build import Bundle, write_bundles
from esea_gen.errors import UserError
from esea_gen.files import write_whole
from esea_gen.hostlib.compiler import compile_sources
from esea_host.connection.address import open_transport, parse_address

WORDS = ("con", "NUL", "aux.csv", "Prn", "COM1", "com9.x", "lpt1", "com0", "com10", "console", "a")


def test_names_that_windows_has_for_devices():
    """As Python's own table has them."""
    for name in WORDS:
        if PureWindowsPath(name).is_reserved():
            with pytest.raises(ValueError, match="device on Windows"):
                portability.check_file_name(name)
        else:
            assert portability.check_file_name(name) == name


def test_a_file_that_another_program_has_open(monkeypatch, tmp_path):
    path, turns, real = tmp_path / "r.csv", iter(range(3)), portability.os.replace

    def denied(*paths):
        if next(turns, None) is None:
            return real(*paths)
        error = PermissionError(errno.EACCES, "Access is denied")
        error.winerror = 32
        raise error

    monkeypatch.setattr(portability.os, "replace", denied)
    write_whole(path, "old")
    assert path.read_text() == "old"
    turns = iter(range(99))
    monkeypatch.setattr(portability, "PATIENCE_S", 0.0)
    with pytest.raises(UserError, match=r"r.csv: .*another program has it open.* Close it") as told:
        write_whole(path, "new")
    kept = next(p for p in tmp_path.iterdir() if p != path)
    assert (path.read_text(), kept.read_text()) == ("old", "new")
    assert str(kept) in told.value.fix


@pytest.mark.skipif(not portability.TERMINALS, reason="a shell script stands in for gcc")
def test_a_compiler_that_speaks_another_language(monkeypatch, tmp_path):
    script = tmp_path / "gcc"
    script.write_text(
        '#!/bin/sh\n[ "$1" = --version ] && echo gcc 1 && exit\n'
        '[ "$LC_ALL" = C ] && echo No space left on device >&2 || echo Kein Platz >&2\nexit 1\n'
    )
    script.chmod(0o755)
    for name, value in {"PATH": str(tmp_path), "LC_ALL": "de_DE.UTF-8", "LANGUAGE": "de"}.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(OSError, match=str(errno.ENOSPC)) as told:
        compile_sources({"a.c": "int a;"})
    assert told.value.errno == errno.ENOSPC


def test_a_folder_that_cannot_be_replaced_is_still_there(monkeypatch, tmp_path):
    write_bundles([Bundle("f32", {"manifest.json": '{"files": []}'})], tmp_path)
    real = portability.os.replace

    def denied(source, target):
        if source.name == "f32" and source.parent != tmp_path:
            raise PermissionError(errno.EACCES, "Access is denied")
        real(source, target)

    monkeypatch.setattr(portability.os, "replace", denied)
    with pytest.raises(UserError, match="cannot be written"):
        write_bundles([Bundle("f32", {"manifest.json": "new"})], tmp_path)
    assert [p.read_text() for p in tmp_path.rglob("*.json")] == ['{"files": []}']


@given(text=st.text(), page=st.sampled_from(["cp1252", "cp437", "ascii"]))
def test_any_text_goes_to_any_console(text, page):
    shown = text.encode(page, "nearest_signs").decode(page)
    assert all(c in shown for c in text if c.encode(page, "ignore"))
    signs = "\u22125 Nm\u00b7s at 10\u207b\u2079, 3\u00b0 \u03c4"
    assert signs.encode("ascii", "nearest_signs") == rb"-5 Nm.s at 10-9, 3 deg \u03c4"


BY_PATH = "/dev/serial/by-path/pci-0000:00:14.0-usb-0:3:1.0-port0"
WRONG = [" COM3", "COM3 :9600", ":9600", "COM3:", "COM3:x", "COM3:1", "COM3:" + "9" * 30]


def test_serial_ports_by_the_names_of_every_system(monkeypatch):
    opened = []
    monkeypatch.setattr("serial.Serial", lambda port, baud, **_: opened.append((port, baud)))
    for port in ("COM3", r"\\.\COM10", "/dev/ttyACM0", BY_PATH):
        for rate in ("", ":921600"):
            open_transport(parse_address(f"serial:{port}{rate}"))
        assert opened[-2:] == [(port, 115200), (port, 921600)]
    for place in WRONG:
        with pytest.raises(UserError, match="serial:COM3:921600"):
            parse_address(f"serial:{place}")


def test_windows_ends_of_lines_make_the_same_device(tmp_path):
    text, path = 'schema = 1\nextends = "elbow"\nname = "mine"\ntitle = "\u00dc"\n', tmp_path / "a"
    path.write_text(text, encoding="utf-8", newline="\n")
    plain = load_device(str(path)).digest
    path.write_text(text, encoding="utf-8-sig", newline="\r\n")
    assert load_device(str(path)).digest == plain
