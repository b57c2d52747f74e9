"""Verdict of a verification over all comparisons, in one line."""

from __future__ import annotations

import math

import pytest

from esea_gen.emit.step_errors import Bound
from esea_gen.verify.verdict import Comparison, Verification


def comparison(block: str, real: str, errors: dict, **more) -> Comparison:
    return Comparison(block, "walk", real, 10, errors, {"y": 1.0}, **more)


@pytest.mark.parametrize(
    ("more", "passed"),
    [
        ({"bit_identical": True}, True),
        ({"bit_identical": False}, False),
        ({"status_differences": 1}, False),
        ({"problems": ["wrong"]}, False),
        ({"turned": 3, "beyond": 2, "drift": {"y": 9.0}}, True),
    ],
)
def test_one_comparison_and_all_of_them(more, passed):
    both = [comparison("a", "f64", {}), comparison("a", "f32", {}, **more)]
    told = Verification("d", "-", both, {}, {}).to_dict()
    assert [c["passed"] for c in told["comparisons"]] == [True, passed]
    assert told["passed"] == passed


def test_one_verdict_line_names_what_is_not_proven_and_what_failed():
    def verdict(wide: float, **more) -> str:
        both = [comparison("a", "f64", {"y": 0.0}, bit_identical=True)]
        both.append(comparison("a", "f32", {"y": 0.5}, **more))
        bounds = {"a": {"all": Bound("f32", math.inf, {"y": wide}, {}, "linear", ())}}
        return Verification("d", "-", both, bounds, {}, {"a": {"y": 2.0}}).verdict()

    assert verdict(1.0).startswith("verdict: PASS. a: f64 equals CasADi's C bit for bit; f32")
    assert "at most 25 % of full scale from the model (a.y)." in verdict(1.0)
    assert "PASS, 1 output tested but not proven" in verdict(22.0)
    assert verdict(22.0).endswith("a.y (1100 % of full scale).")
    failed = verdict(22.0, problems=["wrong"])
    assert failed == "verdict: FAIL. The C differs from the symbolic model in a f32."
    assert {len(x.splitlines()) for x in (verdict(1.0), verdict(22.0), failed)} == {1}
