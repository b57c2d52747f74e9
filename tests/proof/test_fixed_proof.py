"""The proof of the emitted q31 C, and that each of its gates can fail.  Run by `make proof`."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

import esea_gen
from esea_gen.cli import app
from esea_gen.emit.fixed.functions import source_files
from esea_gen.verify import fixed_report
from esea_gen.verify.proof import prove_block
from tests.conftest import require_tool

from .certificates import prove_rounding
from .firmware_proof import prove_drive

pytestmark = pytest.mark.slow


# The mean square of the speed: the analysis takes the words of a product apart, and so the signs.
WORDS_APART = r"esea_elbow_drive_passivity\.c:\d+ signed downcast\. .*esea_q63_mul_q31\("


@pytest.mark.parametrize("name", ["elbow", "knee", "knee_printed", "wrist", "elbow_drive"])
def test_no_alarm_in_any_emitted_file(name):
    require_tool("frama-c")
    device = esea_gen.load_device(name)
    for block in device.system.kinds:
        found = prove_block(device, block)
        known = {"passivity": WORDS_APART} if name == "elbow_drive" else {}
        pattern = known.get(block.name)
        explained = [a for a in found.alarms if pattern and re.match(pattern, a)]
        assert len(explained) == (2 if pattern else 0)
        assert len(found.alarms) == len(explained), found.alarms
        assert found.unproven == ()
        # One assumption a tunable and coefficient; none for inputs, states, whole numbers, nor for
        # what a Block checks itself.
        trusted = () if block.name in ("limits", "passivity") else block.coefficients
        assert len(found.assumptions) == len(block.tunables) + sum(
            p.size for p in trusted if not p.whole
        )


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
            rf"= esea_q31_max\(esea_q31_min\(({name}_held_q\d+), \d+\),\s[^;]+;", r"= \1;", text
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
        return text[:at] + "coeffs->alpha = params->bandwidth_Hz" + text[text.index(";", at) :]

    assert any("alpha" in u for u in prove_block(device, device.velocity, fault).unproven)


HIGH_WORD = "the high word of a product, taken through unsigned words: at most half of its factor"
ALARMS = {
    # What the analysis says, how often, and why it is not so.
    "f32": {
        r"esea_f32\.c:\d+ signed overflow\. .* from high_signed\(": (9, HIGH_WORD),
        r"esea_f32\.c:\d+ invalid RHS operand for shift\. .*shift": (
            3,
            "exponents outside the normal range only, and |x| >= 1/2: the callers see to it",
        ),
    },
    "q31": {
        r"esea_q31_units\.h:\d+ non-finite float value\. .*is_finite\(y\)": (
            1,
            "the line before leaves for NaN and infinity, of which both comparisons are false",
        ),
        WORDS_APART: (2, "test_the_mean_square_of_the_speed_fits has the largest product"),
    },
}


def _coefficients(system, but):
    blocks = [b for i, b in system.blocks.items() if b.name != but]
    return sum(len(b.coefficients) for b in blocks)


@pytest.mark.parametrize("real", ALARMS)
def test_the_whole_drive_raises_no_alarm_but_those_explained(real):
    """Any bits in parameters, inputs, states and ticks; in f32 in all coefficients, too."""
    require_tool("frama-c")
    device = esea_gen.load_device("elbow_drive")
    found = prove_drive(device, real, free=real == "f32")
    rest = list(found.alarms)
    for pattern, (count, why) in ALARMS[real].items():
        hits = [a for a in rest if re.match(pattern, a)]
        assert len(hits) == count, (why, hits)
        rest = [a for a in rest if a not in hits]
    assert rest == []
    assert found.unproven == ()
    # q31 trusts each coefficient that no step checks: one assumption each.
    trusted = 0 if real == "f32" else _coefficients(device.system, "limits")
    assert len(found.assumptions) == trusted
    # All tasks and Blocks were reached.
    assert found.functions > 100


def test_any_coefficient_bits_overflow_only_blocks_of_q31_that_do_not_check_theirs():
    require_tool("frama-c")
    device = esea_gen.load_device("elbow_drive")
    found = prove_drive(device, "q31", free=True)
    assert found.assumptions == ()
    unchecked = {b.name for b in device.system.kinds if b.coefficients} - {"limits"}
    for alarm in found.alarms:
        named = re.match(r"esea_elbow_drive_(\w+)\.c:", alarm)
        if named:
            assert named.group(1) in unchecked, alarm
        else:
            # In functions that they call.
            assert re.match(r"esea_q31(_units)?\.[ch]:", alarm), alarm
    assert any("esea_elbow_drive_rate" in a for a in found.alarms)


def test_the_mean_square_of_the_speed_fits():
    """The product of WORDS_APART, from the bounds that stand in the C: it is far below 2^31."""
    folder = Path(__file__).parents[2] / "generated" / "elbow_drive" / "q31"
    text = (folder / "esea_elbow_drive_passivity.c").read_text()
    found = re.search(
        r"const int64_t (\w+) = \(\w+_q22 \* INT64_C\(2\)\)\s*- square_rad2_s2_used_q23;\s*"
        r"const int32_t \w+ = \(int32_t\)esea_q63_mul_q31\(\1,\s*(\d+), (\d+)\);",
        text,
    )
    assert found
    factor, shift = int(found[2]), int(found[3])
    speed = int(re.search(r"omega_load_q27 <= (\d+)\)", text)[1])
    square = int(re.search(r"square_rad2_s2_now_q23 <= (\d+)\)", text)[1])
    # 12 rad/s in q27; its square in q22, twice; less a mean square that is not negative.
    assert speed == 12 * 2**27
    largest = max(2 * (speed**2 // 2**32 + 1), square)
    assert largest * factor / 2**shift < 0.4 * 2**31


def test_sums_of_the_explained_alarms_fit():
    # |a b / 2^32| <= |b| / 2 for a word a: each polynomial's largest sum, from the tables.
    text = next(p for p in source_files() if p.suffix == ".h" and "tables" in p.name).read_text()
    for name, last in (("EXP2", 2), ("LOG2", 3), ("RECIPROCAL", 4)):
        of = {
            int(k): abs(int(v)) for k, v in re.findall(rf"#define {name}_(\d) \(?(-?\d+)\)?", text)
        }
        assert sorted(of) == list(range(last + 1))
        size = of[last]
        for k in reversed(range(last)):
            size = of[k] + size // 2 + 1
            assert size < 2**31


def test_a_fault_in_the_drive_file_raises_an_alarm():
    require_tool("frama-c")

    def fault(name, text):
        if name != "esea_elbow_drive.c":
            return text
        # A conversion between two Blocks' formats, in 32 bits.
        wrong, count = re.subn(
            r"esea_q31_saturate\((encoder_load_out\.\w+) \* \(INT64_C\(1\) << 4\)\)",
            r"\1 * (1 << 4)",
            text,
        )
        assert count
        return wrong

    found = prove_drive(esea_gen.load_device("elbow_drive"), "q31", change=fault)
    assert any(a.startswith("esea_elbow_drive.c:") for a in found.alarms)


def test_rounding_of_the_core_is_certified():
    for tool in ("gappa", "z3"):
        require_tool(tool)
    found = prove_rounding()
    assert [r.script for r in found if not r.proven] == []
    assert len(found) == 5


@pytest.mark.parametrize(
    ("script", "old", "new"),
    [
        ("mul.gappa", "1073741824) /", "1073741000) /"),
        ("series.gappa", "2015181 + h2", "2015181 + h2 + h2"),
        ("round.smt2", "(bvsub wide_s #x0000000000000001)", "(bvsub wide_s #x0000000000000002)"),
        ("narrow.smt2", "(= left_1 (above a))", "(= left_1 (below a))"),
        ("product.smt2", "(bvsub count one)", "count"),
    ],
)
def test_a_wrong_script_certifies_nothing(script, old, new):
    for tool in ("gappa", "z3"):
        require_tool(tool)

    def fault(name, text):
        if name != script:
            return text
        assert old in text
        return text.replace(old, new)

    assert [r.script for r in prove_rounding(fault) if not r.proven] == [script]


@pytest.mark.parametrize(
    ("file", "old", "new", "scripts"),
    [
        # One character of the C each; the last two are what a copy of the C would not notice.
        ("esea_q31.h", "(x >> s) + ((x >> (s - 1)) & 1)", "(x >> s) + ((x >> (s - 1)) & 3)",
         ["round.smt2"]),
        ("esea_q31.h", "(int32_t)(last >> 16)", "(int32_t)(last >> 17)", ["narrow.smt2"]),
        ("esea_q31.h", "(b >> 16) * (int32_t)((uint32_t)a", "(a >> 16) * (int32_t)((uint32_t)a",
         ["narrow.smt2"]),
        ("esea_q31.h", "(INT64_C(1) << (s - 33))) >>", "(INT64_C(1) << (s - 34))) >>",
         ["product.smt2"]),
        ("esea_q31.h", "(int64_t)a * b + (INT64_C(1) << (s - 1))",
         "(int64_t)a * b + (INT64_C(1) << (s - 2))", ["mul.gappa"]),
        ("esea_q31.h", "return (x + (INT64_C(1) << (s - 1))) >> s;",
         "return (x + (INT64_C(1) << (s - 1))) >> 1;", ["mul.gappa"]),
        ("esea_f32_tables.h", "#define EXP2_1 2015181", "#define EXP2_1 2015182",
         ["series.gappa"]),
        ("esea_q31.c", "p = EXP2_0 + high_signed(t, p);", "p = EXP2_0 - high_signed(t, p);",
         ["series.gappa"]),
    ],
)  # fmt: skip
def test_a_changed_character_of_the_c_is_not_certified(file, old, new, scripts):
    for tool in ("gappa", "z3"):
        require_tool(tool)

    def fault(name, text):
        if name != file:
            return text
        assert old in text
        return text.replace(old, new)

    assert [r.script for r in prove_rounding(fault) if not r.proven] == scripts
