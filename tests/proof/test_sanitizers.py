"""Sanitizers on the equivalence streams, each proven armed by a deliberate fault."""

from __future__ import annotations

import os

import pytest

from esea_gen.emit.build import render_device
from esea_gen.errors import UserError
from tests.conftest import require_tool

from .sanitize import replay_device, undefined_behaviour

pytestmark = pytest.mark.ci

STEP = "    const uint32_t primed_now = state->primed;"


@pytest.fixture(scope="module")
def files(elbow):
    return render_device(elbow, ["f32"])[0].files


def broken(files, old, new, name="esea_elbow_sensor.c"):
    assert files[name].count(old) >= 1
    return files | {name: files[name].replace(old, new, 1)}


@pytest.mark.parametrize("real", ["f32", "f64"])
def test_no_undefined_behaviour(elbow, real):
    found = undefined_behaviour(elbow, real)
    assert found.reports == ()
    assert found.runs >= 19
    assert found.passed


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (STEP, STEP + " volatile int big = 2147483647; big = big + 1;", "signed integer overflow"),
        (STEP, STEP + " volatile int far = 40; far = 1 << far;", "shift exponent"),
        ("state->play_rad[9];", "state->play_rad[10 + (in->theta_rad > 2.0f)];", "out of bounds"),
        (STEP, STEP + " volatile float m = -5.0f; out->status = (uint32_t)m;", "outside the range"),
        (STEP, STEP + " volatile float z = 0.0f; z = 1.0f / z;", "division by zero"),
    ],
)
def test_undefined_behaviour_is_seen(elbow, files, old, new, said):
    found = undefined_behaviour(elbow, "f32", broken(files, old, new), 200, ["sensor"])
    assert any(said in text for text in found.reports), found.reports
    assert not found.passed


@pytest.mark.parametrize("real", ["f32", "f64"])
def test_no_stray_access_and_the_same_bits(elbow, real):
    found = replay_device(elbow, real, "address")
    assert found.reports == ()
    assert found.differences == ()
    assert found.runs >= 38  # each stream with two fillings of fresh memory


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        # Beyond the state, by a pointer that no bounds check follows.
        (
            STEP,
            STEP + " ((volatile uint32_t *)(void *)state)[sizeof *state / 4u] = 1u;",
            "heap-buffer-overflow",
        ),
        (
            STEP,
            STEP
            + " { volatile uint32_t x = ((uint32_t *)(void *)out)[sizeof *out / 4u]; (void)x; }",
            "heap-buffer-overflow",
        ),
        (STEP, STEP + " volatile int big = 2147483647; big = big + 1;", "signed integer overflow"),
    ],
)
def test_a_stray_access_is_seen(elbow, files, old, new, said):
    found = replay_device(elbow, "f32", "address", broken(files, old, new), 200, ["sensor"])
    assert any(said in text for text in found.reports), found.reports


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("    state->play_rad[3] = 0.0f;\n", ""),  # init leaves a state unwritten
        ("    out->tau_rate_Nm = tau_r_Nm;\n", ""),  # step leaves an output unwritten
    ],
)
def test_memory_that_nobody_wrote_is_seen(elbow, files, old, new):
    found = replay_device(elbow, "f32", "address", broken(files, old, new), 200, ["sensor"])
    assert found.differences


def memory_run(elbow, files=None, steps=1500, blocks=None):
    require_tool("clang")
    try:
        return replay_device(elbow, "f32", "memory", files, steps, blocks)
    except UserError as error:
        if os.environ.get("ESEA_REQUIRE_TOOLS") == "1":
            pytest.fail(str(error))
        pytest.skip(str(error))


def test_no_uninitialised_memory(elbow):
    found = memory_run(elbow)
    assert found.passed, found


def test_uninitialised_memory_is_seen(elbow, files):
    faulty = broken(files, "    out->tau_rate_Nm = tau_r_Nm;\n", "")
    found = memory_run(elbow, faulty, 200, ["sensor"])
    assert any("uninitialized" in text for text in found.reports), found
