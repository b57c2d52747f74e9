"""The proof of the emitted q31 C, and that each of its gates can fail.  Run by `make proof`."""

from __future__ import annotations

import re

import pytest
from typer.testing import CliRunner

import esea_gen
from esea_gen.cli import app
from esea_gen.verify import fixed_report
from esea_gen.verify.proof import prove_block, prove_rounding

from .conftest import require_tool

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", ["elbow", "knee", "knee_printed", "wrist", "elbow_drive"])
def test_no_alarm_in_any_emitted_file(name):
    require_tool("frama-c")
    device = esea_gen.load_device(name)
    for block in device.system.kinds:
        found = prove_block(device, block)
        assert found.proven, (found.alarms, found.unproven)
        # One assumption a tunable and coefficient, none for inputs and states, nor for what the
        # limits check themselves.
        trusted = () if block.name == "limits" else block.coefficients
        assert len(found.assumptions) == len(block.tunables) + sum(p.size for p in trusted)


@pytest.mark.parametrize("block", ["velocity", "sensor"])
def test_no_alarm_as_compiled_for_a_core_without_a_64_bit_product(block):
    require_tool("frama-c")
    device = esea_gen.load_device("elbow")
    found = prove_block(device, getattr(device, block), narrow=True)
    assert found.proven, (found.alarms, found.unproven)
    # Armed: one more bit in a half's product overflows.
    wrong = prove_block(
        device,
        getattr(device, block),
        lambda name, text: text.replace("(a >> 16) * (int32_t)(", "(a >> 15) * (int32_t)("),
        narrow=True,
    )
    assert wrong.alarms


def test_the_command_lists_what_is_assumed(monkeypatch):
    require_tool("frama-c")
    monkeypatch.setattr(fixed_report, "published_motions", lambda device: iter(()))
    done = CliRunner().invoke(app, ["fixed", "elbow", "--prove"])
    assert done.exit_code == 0, done.output
    flat = " ".join(done.output.split())
    assert "velocity no alarm" in flat
    assert "sensor no alarm" in flat
    # The tunable and three coefficients of the filter; the sensor has none.
    assert "4 assumed ranges" in flat
    assert "0 assumed ranges" in flat
    assert flat.count("Frama_C_interval(") == 4


def test_the_value_analysis_finds_an_overflow():
    require_tool("frama-c")
    device = esea_gen.load_device("elbow")

    def fault(name, text):
        if name != "esea_elbow_velocity.c":
            return text
        wrong = text.replace("esea_q31_round(v_now_q24, 1) + ", "v_now_q24 + ", 1)
        assert wrong != text
        return wrong

    assert prove_block(device, device.velocity, fault).alarms


@pytest.mark.parametrize(
    ("block", "old", "new"),
    [
        ("sensor", "(significand >> 25) & 63u", "significand >> 24"),
        ("velocity", "(xf - 1)", "(xf + 63)"),
        ("sensor", "(uint32_t)(d >> 27) & 63u", "(uint32_t)(d >> 26) & 127u"),
    ],
)
def test_the_value_analysis_finds_a_fault_in_the_functions(block, old, new):
    require_tool("frama-c")
    device = esea_gen.load_device("elbow")

    def fault(name, text):
        if name != "esea_q31.c":
            return text
        assert old in text
        return text.replace(old, new)

    assert prove_block(device, getattr(device, block), fault).alarms


@pytest.mark.parametrize("name", ["u_max", "u_step", "rom_min", "rom_gain"])
def test_a_checked_coefficient_that_is_not_cut_to_its_range_overflows(name):
    require_tool("frama-c")
    device = esea_gen.load_device("elbow_drive")

    def fault(file, text):
        if file != "esea_elbow_drive_limits.c":
            return text
        wrong, count = re.subn(
            rf"= esea_q31_max\(esea_q31_min\(({name}_held_q\d+), \d+\), [^;]+;", r"= \1;", text
        )
        assert count == 1
        return wrong

    (block,) = (b for b in device.system.kinds if b.name == "limits")
    assert prove_block(device, block, fault).alarms


def test_a_coefficient_outside_its_promise_is_found():
    require_tool("frama-c")
    device = esea_gen.load_device("elbow")

    def fault(name, text):
        if name != "esea_elbow_velocity.c":
            return text
        at = text.index("coeffs->alpha = ")
        end = text.index(";", at)
        wrong = "coeffs->alpha = params->bandwidth_Hz"
        return text[:at] + wrong + text[end:]

    found = prove_block(device, device.velocity, fault)
    assert any("alpha" in u for u in found.unproven)


def test_rounding_of_the_core_is_certified():
    for tool in ("gappa", "z3"):
        require_tool(tool)
    found = prove_rounding()
    assert [r.script for r in found if not r.proven] == []
    assert len(found) == 5


@pytest.mark.parametrize(
    ("script", "old", "new"),
    [
        ("mul.gappa", "1073741824", "1073741000"),
        ("series.gappa", "2015181 + h2", "2015181 + h2 + h2"),
        ("round.smt2", "(bvsub s #x00000001)) #x00000001)", "(bvsub s #x00000001)) #x00000003)"),
        ("narrow.smt2", "(bvlshr p00 half)", "(bvashr p00 half)"),
        ("product.smt2", "(bvsub s #x0000000000000021)))", "(bvsub s #x0000000000000020)))"),
    ],
)
def test_a_fault_in_the_core_is_not_certified(script, old, new):
    for tool in ("gappa", "z3"):
        require_tool(tool)

    def fault(name, text):
        if name != script:
            return text
        assert old in text
        return text.replace(old, new)

    assert [r.script for r in prove_rounding(fault) if not r.proven] == [script]
