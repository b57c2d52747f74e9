"""Proofs of the emitted limits from their C text. Run by `make proof`."""

from __future__ import annotations

import re

import pytest

from tests.conftest import require_tool

from .limits_proof import POSSIBLE, PROPERTIES, prove_limits, show_possible
from .limits_step import compiled

slow = pytest.mark.slow
REALS = ("f32", "q31")


def test_the_numbers_are_those_of_the_device_file(drive):
    # By hand from elbow_drive.toml: these are what the properties speak of.
    k = compiled(drive)
    assert (k.u_max_Nm, k.tau_max_Nm) == (pytest.approx(0.221), 8)
    assert float(k.u_step_Nm) == pytest.approx(50 / 1000)
    assert (float(k.rom_min_rad), float(k.rom_max_rad)) == (-0.15, 2.5)
    assert (float(k.rom_margin_rad), float(k.theta_max_rad)) == (0.2, 0.3)
    assert (k.omega_max_rad_s, k.energy_J, k.stale_ticks) == (10, 15, 25)


@slow
@pytest.mark.parametrize("real", REALS)
def test_every_property_holds_for_any_bits(drive, real):
    require_tool("z3")
    found = prove_limits(drive, real)
    assert {v.name: v.said for v in found if v.said != "proven"} == {}
    assert len(found) == len(PROPERTIES) == 33


@slow
def test_the_properties_are_not_empty(drive):
    """In f32; the same properties are broken by faults in q31, below."""
    require_tool("z3")
    found = {v.name: v.said for v in show_possible(drive, "f32")}
    assert found == dict.fromkeys(POSSIBLE, "possible")


def _defined(text: str, name: str) -> re.Match[str]:
    """The definition of a value that has its Block's label."""
    found = re.search(rf"\b{name}(?:_q\d+|_Nm)? =\s*(.*?);", text, re.DOTALL)
    assert found is not None, name
    return found


def _replaced(text: str, name: str, old: str, new: str) -> str:
    """A fault in the definition of one value."""
    found = _defined(text, name)
    wrong, count = re.subn(old, new, found.group(1), count=1)
    assert count == 1, (name, found.group(1))
    return text[: found.start(1)] + wrong + text[found.end(1) :]


def _everywhere(old: str, new: str):
    def fault(text):
        wrong, count = re.subn(old, new, text)
        assert count, old
        return wrong

    return fault


def _in(name: str, old: str, new: str):
    return lambda text: _replaced(text, name, old, new)


ZERO = r"0(?:\.0f)?"
FAULTS = {
    "stop is ignored": ("stop", _in("stop_used", "stop != 0u", "stop != stop")),
    "released without a request": ("release", _in("release", r"\brearm_edge\b", "1")),
    "released with a command": ("release", _in("release", rf"u_command\w* == {ZERO}", "1")),
    "released in any mode": ("release", _in("release", r"&& \w+(?= && \(u_command)", "&& 1")),
    "clip of the command left out": (
        "command_within_compiled",
        _everywhere(r"esea_\w*min\((\w+), u_max\w*\)", r"\1"),
    ),
    "clip of the command doubled": (
        "command_within_narrowed",
        _everywhere(r"esea_\w*min\((\w+), u_max(\w*)\)", r"esea_m2(\1, u_max\2)"),
    ),
    "a cause is left out": ("shown_cause", _in("cause", r"\|\| stop_used(?= )", "")),
    "the last cause is left out": ("energy shown_cause", _in("cause", r"\s*\|\|\s*\w+$", "")),
    "not cut in the same step": (
        "stop",
        _everywhere(r"= run \? (u_followed\w*) :", r"= was_released ? \1 :"),
    ),
    "an input's lower end is left out": (
        "input_invalid",
        _in("u_command_Nm_ok", r"&& \(?\(.*", "&& 1"),
    ),
    "the reason is forgotten": (
        "first_reason",
        _in("fault_next", r"\? (\w+) :", "? (\\1 + \\1) :"),
    ),
    "the request is not remembered": (
        "request_spent",
        _everywhere(r"(state->rearm_last\w*) = [^;]+;", r"\1 = \1;"),
    ),
    "the change is not limited": ("command_rate", _in("u_followed", r"(?s).*", "u_shaped@")),
}


def faulty(fault, name, text):
    """A fault in the limits' file, none elsewhere."""
    if not name.endswith("_limits.c"):
        return text
    start = text.index("limits_step(")
    wrong = fault(text[start:])
    suffix = re.search(r"\bu_shaped(\w*) =", wrong)
    assert suffix is not None
    wrong = wrong.replace("u_shaped@", f"u_shaped{suffix.group(1)}")
    if "esea_m2" in wrong:
        wrong = re.sub(r"esea_m2\((\w+), (\w+)\)", r"(\1 < \2 + \2 ? \1 : \2 + \2)", wrong)
    assert wrong != text[start:]
    return text[:start] + wrong


# All of them in q31: f32 has the same source.
@slow
@pytest.mark.parametrize(
    ("name", "real"), [*((n, "q31") for n in FAULTS), ("clip of the command left out", "f32")]
)
def test_a_fault_in_the_c_breaks_a_property(drive, real, name):
    require_tool("z3")
    broken, fault = FAULTS[name]
    found = prove_limits(drive, real, broken.split(), lambda f, t: faulty(fault, f, t))
    assert "broken" in {v.said for v in found}


@slow
def test_a_comparison_that_lets_nan_through_breaks_a_property(drive):
    require_tool("z3")

    def fault(text):
        found = _defined(text, "u_command_Nm_ok").group(1)
        return text.replace(found, f"!({found.replace('<=', '>').replace('&&', '||')})", 1)

    found = prove_limits(
        drive, "f32", ["input_invalid", "outputs_in_range"], lambda f, t: faulty(fault, f, t)
    )
    assert "broken" in {v.said for v in found}


@pytest.mark.parametrize(
    "line", ["while (v) { v = 0; }", "double v = 0.0;", "int v = (int)0.5f;", "int v = other(1);"]
)
def test_c_that_is_not_understood_is_refused(drive, line):
    from .limits_step import LimitsC, Step

    def fault(name, text):
        if not name.endswith("_limits.c"):
            return text
        at = text.index("{", text.index("limits_step("))
        return f"{text[: at + 1]} {{ int v = 1; (void)v; }} {line} {text[at + 1 :]}"

    with pytest.raises(Exception, match=r"limits\.c"):
        Step(LimitsC(drive, "f32", fault))
