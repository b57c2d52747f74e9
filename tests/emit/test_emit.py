"""Output folder: self-contained, same bytes, complete or unchanged."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from esea_gen.emit.build import (
    MANIFEST,
    Bundle,
    device_hash,
    differences,
    render_device,
    write_bundles,
)
from esea_gen.errors import UserError
from tests.conftest import ROOT, require_tool

STRICT = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"]


@pytest.fixture(scope="module")
def built(tmp_path_factory, elbow):
    folder = tmp_path_factory.mktemp("elbow")
    write_bundles(render_device(elbow, ["f64", "f32"]), folder)
    return folder


def documented_command(folder: Path) -> list[str]:
    """The gcc line that the header prints."""
    header = next(p for p in folder.glob("esea_*.h") if "#define" in p.read_text()).parent
    line = re.search(r"\* +(gcc .*?\*\.c(?: -lm)?) ", (header / "esea_elbow.h").read_text())
    assert line, "the header does not say how to compile it"
    return line.group(1).split()


@pytest.mark.parametrize("real", ["f64", "f32"])
def test_folder_compiles_alone_by_the_documented_line_and_runs(built, real, tmp_path):
    require_tool("gcc")
    alone = tmp_path / "copied out"
    shutil.copytree(built / real, alone)
    sources = sorted(str(p) for p in alone.glob("*.c"))
    command = documented_command(alone)
    command[command.index("*.c") : command.index("*.c") + 1] = [*sources, *STRICT]
    subprocess.run([*command, "-o", "example"], cwd=tmp_path, check=True)
    done = subprocess.run(["./example"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "12 of 12 samples agree" in done.stdout


def test_the_example_can_fail(built, tmp_path):
    require_tool("gcc")
    alone = tmp_path / "wrong"
    shutil.copytree(built / "f64", alone)
    sensor = alone / "esea_elbow_sensor.c"
    text = sensor.read_text()
    assert "9.39" in text
    sensor.write_text(text.replace("9.39", "9.40"))
    sources = sorted(str(p) for p in alone.glob("*.c"))
    subprocess.run(["gcc", "-std=c99", *sources, "-o", "example", "-lm"], cwd=tmp_path, check=True)
    assert (
        subprocess.run(["./example"], cwd=tmp_path, capture_output=True, check=False).returncode
        == 1
    )


@pytest.mark.parametrize("real", ["f64", "f32"])
def test_it_is_also_valid_cpp(built, real, tmp_path):
    require_tool("g++")
    for source in (built / real).glob("*.c"):
        subprocess.run(
            ["g++", "-x", "c++", "-std=c++17", *STRICT, "-c", str(source), "-o", "x.o"],
            cwd=tmp_path,
            check=True,
        )


def undefined_symbols(sources, tmp_path, flags=()):
    objects = []
    for source in sources:
        target = tmp_path / (source.stem + ".o")
        subprocess.run(
            ["gcc", "-std=c99", "-O2", *flags, "-c", str(source), "-o", str(target)], check=True
        )
        objects.append(str(target))
    text = subprocess.run(["nm", *objects], capture_output=True, text=True, check=True).stdout
    defined = set(re.findall(r" [TDBRdbrt] (\w+)", text))
    return set(re.findall(r" U (\w+)", text)) - defined, defined, text


def control_sources(folder: Path) -> list[Path]:
    return [p for p in sorted(folder.glob("*.c")) if p.name != "main.c"]


def test_f32_needs_no_libm_and_has_no_double(built, tmp_path):
    require_tool("gcc")
    for flags in ((), ("-O0",)):
        undefined, _, _ = undefined_symbols(control_sources(built / "f32"), tmp_path, flags)
        assert undefined == set()
    for source in (built / "f32").glob("esea_*.[ch]"):
        code = re.sub(r"/\*.*?\*/", "", source.read_text(), flags=re.DOTALL)
        assert "double" not in code, source.name
        assert not re.search(r"\b\d+\.\d*(e[-+]?\d+)?(?![\dfe.])", code), source.name
    # The same gate sees the f64 output's libm calls: it is armed.
    undefined, _, _ = undefined_symbols(control_sources(built / "f64"), tmp_path)
    assert {"pow", "exp"} <= undefined


def test_exports_are_prefixed_and_nothing_is_writable(built, tmp_path):
    require_tool("gcc")
    for real in ("f64", "f32"):
        _, _, text = undefined_symbols(control_sources(built / real), tmp_path)
        exported = re.findall(r" ([TDBRC]) (\w+)", text)
        assert exported
        assert all(name.startswith("esea_") for _, name in exported)
        assert not [name for kind, name in re.findall(r" ([DBdbC]) (\w+)", text)]


def test_same_bytes_every_time(elbow, monkeypatch):
    import esea_gen

    # Equal devices share their Blocks: these are made once more.
    monkeypatch.setattr("esea_gen.device._FIRST", {})
    again = esea_gen.load_device("elbow")
    assert again.system is not elbow.system
    one, other = render_device(elbow, ["f64", "f32"]), render_device(again, ["f64", "f32"])
    assert [b.files for b in one] == [b.files for b in other]
    assert render_device(again, ["f32"])[0].files == one[1].files


def test_no_date_host_or_path_in_the_output(elbow):
    for bundle in render_device(elbow, ["f64", "f32"]):
        for name, text in bundle.files.items():
            assert str(ROOT) not in text, name
            assert not re.search(r"20\d\d-\d\d-\d\d", text), name


def test_manifest_and_hash(built, elbow):
    import hashlib

    for real in ("f64", "f32"):
        manifest = json.loads((built / real / MANIFEST).read_text())
        assert manifest["content_hash"] == device_hash(elbow)
        assert manifest["command"] == f"esea-gen build elbow --real {real}"
        assert manifest["versions"]["casadi"]
        for name, digest in manifest["files"].items():
            assert hashlib.sha256((built / real / name).read_bytes()).hexdigest() == digest
        assert device_hash(elbow) in (built / real / "esea_elbow.h").read_text()


def test_the_hash_follows_the_device(elbow):
    from esea_gen.device import parse_device

    other = parse_device(elbow.toml().replace("value = 9.39", "value = 9.38"), "elbow.toml")
    assert device_hash(other) != device_hash(elbow)
    only_source = parse_device(
        elbow.toml().replace("thesis section 3, N = 10", "section 3"), "elbow.toml"
    )
    assert device_hash(only_source) != device_hash(elbow)  # a source is part of the record


def test_the_header_documents_every_port(built, elbow):
    text = re.sub(r"\s*\*?\s+", " ", (built / "f32" / "esea_elbow.h").read_text())
    for block in elbow.system.kinds:
        for port in (*block.inputs, *block.outputs, *block.state, *block.tunables):
            assert port.meaning in text, port.name
        for flag in (f for p in block.outputs for f in p.flags):
            assert flag.meaning in text
        for constant in block.constants:
            assert constant.source.split(";")[0][:20] in text


def test_committed_output_is_current(elbow):
    from esea_gen.emit.dialect import render_dialect

    bundles = [*render_device(elbow, ["f64", "f32"]), render_dialect(elbow)]
    assert differences(bundles, ROOT / "generated" / "elbow") == []


def test_stale_missing_and_left_over_files_are_seen(elbow, tmp_path):
    bundles = render_device(elbow, ["f32"])
    write_bundles(bundles, tmp_path)
    assert differences(bundles, tmp_path) == []
    header = tmp_path / "f32" / "esea_elbow.h"
    header.write_text(header.read_text().replace("1000u", "1001u"))
    (tmp_path / "f32" / "main.c").unlink()
    (tmp_path / "f32" / "old.c").write_text("int x;\n")
    found = "\n".join(differences(bundles, tmp_path))
    assert "-#define ESEA_ELBOW_TICK_US 1001u" in found
    assert "+#define ESEA_ELBOW_TICK_US 1000u" in found
    assert "(missing)" in found
    assert "old.c: not generated" in found


def test_a_failed_write_leaves_the_old_folder(tmp_path):
    write_bundles([Bundle("f32", {"a.c": "old", MANIFEST: '{"files": ["a.c"]}'})], tmp_path)
    bad = Bundle("f32", {"a.c": "new", "a.c/b.c": "cannot be", MANIFEST: "{}"})
    with pytest.raises(UserError, match="cannot be written"):
        write_bundles([bad], tmp_path)
    assert (tmp_path / "f32" / "a.c").read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["f32"]
