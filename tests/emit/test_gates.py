"""Gates on object files, each proven armed."""

from __future__ import annotations

import shutil
import subprocess

import pytest

from esea_gen.emit.build import render_device
from esea_gen.errors import UserError
from esea_gen.targets import EXACT_FLAGS
from esea_gen.verify.gates import TARGETS, check_objects
from tests.conftest import require_tool

pytestmark = pytest.mark.ci


@pytest.fixture(scope="module")
def texts(elbow):
    return {real: render_device(elbow, [real])[0].files for real in ("f32", "f64")}


def broken(files, old, new, name="esea_elbow_sensor.c"):
    """The objects alone are asked: without the example, which has tests of its own."""
    assert old in files[name]
    rest = {n: text for n, text in files.items() if n != "main.c"}
    return rest | {name: files[name].replace(old, new, 1)}


@pytest.mark.parametrize("target", sorted(TARGETS))
def test_the_emitted_objects_pass(elbow, target):
    require_tool(TARGETS[target].toolchain.compiler)
    report = check_objects(elbow, target)
    assert report.problems == ()
    assert report.passed
    assert 0 < report.stack_bytes["sense"] <= report.stack_limit_bytes
    assert report.to_dict()["target"] == target


def test_the_double_precision_c_passes_what_applies_to_it(elbow):
    require_tool("gcc")
    assert check_objects(elbow, "host", "f64").problems == ()


STEP = "    const uint32_t primed_now = state->primed;"
DOUBLE = " state->tau_r_Nm = (float)(0.1 * (double)in->theta_rad);"
OFFENCES = {
    "double constant": (STEP, STEP + DOUBLE, "double"),
    "heap": (STEP, STEP + " extern void free(void *); free((void *)state);", "heap"),
    "stdio": (STEP, STEP + ' extern int puts(const char *); (void)puts("");', "input and output"),
    "hidden state": (
        STEP,
        STEP + " static unsigned seen; state->tau_r_Nm += (float)++seen;",
        "writable",
    ),
    "writable data": ("void esea_elbow_sensor_init", "int esea_seen = 3;\n{}", "writable"),
    "export": (
        "void esea_elbow_sensor_init",
        "int helper(void);\nint helper(void) { return 1; }\n{}",
        "prefix",
    ),
    "stack": (
        STEP,
        STEP + " volatile float big[400]; big[0] = (float)primed_now;",
        "above the limit",
    ),
    "dynamic stack": (
        STEP,
        STEP + " volatile float a[1 + primed_now]; a[0] = (float)primed_now;",
        "depends on data",
    ),
    "pointer": (
        "void esea_elbow_sensor_init",
        "extern void (*const esea_hook)(void);\nvoid esea_call(void);\n"
        "void esea_call(void) { esea_hook(); }\n{}",
        "through a pointer",
    ),
    "recursion": (
        STEP,
        STEP + " if (in->theta_rad > 7.0f) {"
        " esea_elbow_sensor_step(state, in, out); out->tau_Nm = 1.0f; }",
        "recursion",
    ),
}


@pytest.mark.parametrize("target", ["host", "cortex-m4f"])
@pytest.mark.parametrize("offence", sorted(OFFENCES))
def test_each_gate_is_armed(elbow, texts, target, offence):
    require_tool(TARGETS[target].toolchain.compiler)
    old, new, rule = OFFENCES[offence]
    report = check_objects(elbow, target, files=broken(texts["f32"], old, new.replace("{}", old)))
    assert any(rule in p for p in report.problems), report.problems


@pytest.mark.parametrize("target", sorted(TARGETS))
def test_libm_and_double_are_seen_on_every_target(elbow, texts, target):
    require_tool(TARGETS[target].toolchain.compiler)
    files = broken(texts["f32"], STEP, STEP + " state->tau_r_Nm = powf(in->theta_rad, 0.77f);")
    files = broken(files, '#include "esea_elbow.h"', '#include "esea_elbow.h"\n#include <math.h>')
    assert any("asks for powf" in p for p in check_objects(elbow, target, files=files).problems)
    report = check_objects(elbow, target, files=broken(texts["f32"], STEP, STEP + DOUBLE))
    # A double FPU computes on without a helper: only the instructions tell.
    wanted = "double arithmetic" if target in ("cortex-m3", "cortex-m4f") else "double instruction"
    assert any(wanted in p for p in report.problems), report.problems


# The last two see a slip to double where -Wconversion does not look.
STRICT = (*["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"], *EXACT_FLAGS)
STRICT_F32 = ("-Wdouble-promotion", "-Wfloat-conversion")


def warnings_of(files, real, compiler, folder) -> str:
    """What a strict compiler says of the C, less the example program, which prints doubles."""
    flags = [*STRICT, *(STRICT_F32 if real == "f32" else ())]
    flags += ["-Wunsuffixed-float-constants"] if (compiler, real) == ("gcc", "f32") else []
    for name, text in files.items():
        if "/" not in name:
            (folder / name).write_text(text)
    sources = [n for n in files if n.endswith(".c") and "/" not in n and n != "main.c"]
    command = [require_tool(compiler), *flags, "-c", *sources]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False).stderr


@pytest.mark.parametrize("real", ["f32", "f64"])
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_a_strict_compiler_has_nothing_to_say(texts, real, compiler, tmp_path):
    assert warnings_of(texts[real], real, compiler, tmp_path) == ""


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize(
    ("old", "new"),
    [
        (STEP, STEP + " int unused;"),
        (STEP, STEP + " float lost; state->tau_r_Nm = lost;"),  # read before it is written
        (STEP, STEP + " state->tau_r_Nm = 0.1f * in->theta_rad * 2.0;"),
        (STEP, STEP + " out->status = in->theta_rad;"),
    ],
)
def test_the_warnings_are_armed(texts, compiler, old, new, tmp_path):
    said = warnings_of(broken(texts["f32"], old, new), "f32", compiler, tmp_path)
    assert "esea_elbow_sensor.c" in said


def test_unknown_target_and_missing_compiler(elbow, monkeypatch):
    with pytest.raises(UserError, match="cortex-a9"):
        check_objects(elbow, "z80")
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(UserError, match="gcc-arm-linux-gnueabi"):
        check_objects(elbow, "cortex-a9")
