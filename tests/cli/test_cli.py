"""Command line: results, JSON, messages on bad input."""

from __future__ import annotations

import json
import re
import sys

import pytest

from tests.conftest import ROOT, require_tool
from tests.typed import typed as run

HDRB = ROOT / "tests" / "data" / "hdrb"


def refused(done) -> str:
    assert done.returncode == 2, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""
    return " ".join(done.stderr.split())


def test_build_and_check(tmp_path):
    done = run("build", "elbow", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "sense: one value (1)" in done.stdout  # what telemetry costs
    assert {p.name for p in (tmp_path / "generated" / "elbow").iterdir()} == {
        "f64",
        "f32",
        "dialect",
    }
    assert run("check", "elbow", cwd=tmp_path).stdout == "elbow: current\n"
    header = tmp_path / "generated" / "elbow" / "f32" / "esea_elbow.h"
    header.write_text(header.read_text().replace("1000u", "999u"))
    done = run("check", "elbow", cwd=tmp_path)
    assert done.returncode == 1
    assert "-#define ESEA_ELBOW_TICK_US 999u" in done.stdout
    assert "esea-gen build" in done.stdout
    assert run("build", "elbow", cwd=tmp_path).returncode == 0
    # Of a folder that holds the manifest alone the hashes in it are compared.
    f64 = header.parents[1] / "f64"
    for path in f64.rglob("*.[ch]"):
        path.unlink()
    (f64 / "reference").rmdir()
    assert run("check", "elbow", cwd=tmp_path).stdout == "elbow: current\n"
    manifest = f64 / "manifest.json"
    manifest.write_text(re.sub(r'(_sensor\.c": ")..', r"\1zz", manifest.read_text()))
    assert '-    "esea_elbow_sensor.c": "zz' in run("check", "elbow", cwd=tmp_path).stdout
    # Line endings count, as in the manifest; so does a format that is not built by default.
    header.write_bytes(header.read_bytes().replace(b"\n", b"\r\n"))
    assert "elbow.h: other line endings" in run("check", "elbow", cwd=tmp_path).stdout
    assert run("build", "elbow", "--real", "q31", cwd=tmp_path).returncode == 0
    (header.parents[1] / "q31" / "main.c").write_text("")
    assert run("build", "elbow", cwd=tmp_path).returncode == 0
    assert run("check", "elbow", cwd=tmp_path).stdout == "elbow: current\n"


def test_no_format_of_another_law_stays_beside_the_new_one(tmp_path):
    (tmp_path / "generated" / "elbow_drive" / "q31").mkdir(parents=True)
    for command in "build", "check":
        error = refused(run(command, "elbow_drive", "--controller", "mpc", cwd=tmp_path))
        assert "q31 is of another build" in error
        assert "Delete that folder." in error


def test_verify_writes_json(tmp_path):
    require_tool("gcc")
    done = run("verify", "elbow", "--real", "f64", "--json", "v.json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert re.search(r"^verdict: PASS\. 3 Blocks: .*bit for bit\.\nnext: ", done.stdout)
    content = json.loads((tmp_path / "v.json").read_text())
    assert content["passed"] is True
    assert all(c["bit_identical_to_casadi_c"] for c in content["comparisons"])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["build", "nothing.toml"], ["no device 'nothing.toml'", "Shipped: elbow"]),
        (["build", "elbow", "--real", "q15"], ["Unknown number format 'q15'", "f64, f32"]),
        (
            ["build", "bad.toml"],
            ["bad.toml, line 10: elastomer.k1_Nm_rad = -9.39", "limit 0", "0 to 1000"],
        ),
        (["verify", "elbow", "--recording", "none.toml"], ["none.toml"]),
        (["firmware", "elbow", "--board", "arduino"], ["arduino", "netduinoplus2"]),
        (["emulate", "elbow", "--board", "arduino"], ["arduino", "netduinoplus2"]),
        (["identify", "none.toml"], ["none.toml"]),
        (["report", "elbow", "--recording", "none.toml"], ["none.toml"]),
        (["report", "elbow", "--data", "."], ["--data without --recording"]),
        (["verify", "soft.toml", "--real", "f32"], ["soft.toml", "no finite float32 bound"]),
        (["build", "elbow", "--out", "a-file/x"], ["a-file", "--out"]),
        (
            ["verify", "elbow", "--real", "f64", "--json", "a-file/x.json"],
            ["a-file", "Give another"],
        ),
    ],
)
def test_bad_input_gets_one_paragraph_and_code_2(tmp_path, elbow, arguments, words):
    (tmp_path / "bad.toml").write_text(elbow.toml().replace("value = 9.39", "value = -9.39"))
    soft = elbow.toml().replace("omega_rad_s = { value = 25.0", "omega_rad_s = { value = 900.0")
    (tmp_path / "soft.toml").write_text(soft.replace("value = 0.0288", "value = 1e-6"))
    (tmp_path / "a-file").write_text("precious")
    before = sorted(p.name for p in tmp_path.iterdir())
    message = refused(run(*arguments, cwd=tmp_path))
    for word in words:
        assert word in message
    assert sorted(p.name for p in tmp_path.iterdir()) == before
    assert (tmp_path / "a-file").read_text() == "precious"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("force_tonf", "force_kN", ["hdrb.csv", "force_kN", "'displacement_cm', 'force_tonf'"]),
        ('files = ["hdrb.csv"]', 'files = ["gone.csv"]', ["gone.csv"]),
    ],
)
def test_a_wrong_mapping_leaves_no_output(tmp_path, old, new, words):
    text = (HDRB / "hdrb.toml").read_text()
    assert old in text
    (tmp_path / "mine.toml").write_text(text.replace(old, new))
    message = refused(run("identify", "mine.toml", "--data", HDRB, "--out", "o", cwd=tmp_path))
    for word in words:
        assert word in message
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (["firmware", "elbow"], ["arm-none-eabi-gcc", "gcc-arm-none-eabi"]),
        (["verify", "elbow"], ["gcc, clang nor zig", '"esea-gen[compiler]"', "gcc libc6-dev"]),
    ],
)
def test_a_missing_compiler_is_named_with_what_installs_it(monkeypatch, tmp_path, command, words):
    monkeypatch.setitem(sys.modules, "ziglang", None)  # which pip installs
    message = refused(run(*command, cwd=tmp_path, env={"PATH": str(tmp_path)}))
    for word in words:
        assert word in message
