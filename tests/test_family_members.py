"""The members of the family that are compared, written down a second time."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.identify.candidates import members
from esea_gen.model.family import Term

# Thresholds and paths over the largest trained deflection; times in s.  Each from about a fiftieth
# on, in steps of about two, or of three.
THRESHOLDS = 0.02, 0.07, 0.15, 0.3, 0.6, 1.1
PATHS = 0.03, 0.1, 0.3, 1, 3
X, X3, STEEP, BENT = ("power", 1), ("power", 3), ("bend", 0.08), ("bend", 0.4)
STRAIN, SHORT, LONG = ("strain", 0.3), ("path", 8.0), ("path", 40.0)

Row = tuple[str, tuple, tuple, float, tuple | None]


def rows(kind: str, rises, *numbers: tuple, exponent: float = 0.0) -> list[Row]:
    return [(kind, r, n, exponent, None) for r in rises for n in numbers]


def worn(plain: list[Row], *softenings: tuple) -> list[Row]:
    """Each term as it is, and with each softening; an offset does not soften."""
    soft = [(*r[:4], s) for s in softenings for r in plain if r[0] != "offset"]
    return plain + soft


def each(*numbers: float) -> list[tuple]:
    return [(n,) for n in numbers]


SPRINGS = rows("spring", (X, X3), ())
STOPS = SPRINGS + rows("stop", (X, X3), *each(*THRESHOLDS))
SLIPS = SPRINGS + rows("slip", (X, X3), *each(*PATHS))
CURVED = rows("spring", (STEEP, BENT, X, X3), ())
MAXWELL = CURVED + rows("maxwell", (STEEP, BENT, X), *each(3, 30, 300))
# Eight times from 0.1 to 1000 s, evenly spaced on a logarithmic axis; shares T^-0.2.
EIGHT = tuple(np.logspace(-1, 3, 8).tolist())
FRACTIONAL = CURVED + rows("maxwell", (STEEP, BENT, X, X3), EIGHT, exponent=0.2)
OFFSET = rows("offset", (X,), ())
SIDES = ("power", 1, "positive"), ("power", 1, "negative")
QUICK = rows("maxwell", (X, X3), *each(0.1, 0.3, 1, 3, 30))
TURNING = rows("maxwell", SIDES, *each(0.03, 0.1, 0.3, 1))
EXPECTED = {
    "stops": STOPS,
    "slips": SLIPS,
    "stops, strain": worn(STOPS, STRAIN),
    "slips, strain": worn(SLIPS, STRAIN),
    "stops, worn": worn(STOPS, STRAIN, SHORT, LONG),
    "slips, worn": worn(SLIPS, STRAIN, SHORT, LONG),
    "slips, worn, offset": worn(SLIPS, STRAIN, SHORT, LONG) + OFFSET,
    "stops, Maxwell, offset": CURVED + STOPS[2:] + QUICK + OFFSET,
    "stops, sides, offset": STOPS + TURNING + OFFSET,
    "Maxwell": MAXWELL,
    "fractional": FRACTIONAL,
    "Maxwell, strain": worn(MAXWELL, STRAIN),
    "fractional, strain": worn(FRACTIONAL, STRAIN),
}


def row(t: Term) -> Row:
    side = () if t.rise.side == "both" else (t.rise.side,)
    softening = t.softening and (t.softening.kind, t.softening.number)
    return t.kind, (t.rise.kind, t.rise.number, *side), t.numbers, t.exponent, softening


@pytest.mark.parametrize("name", EXPECTED)
def test_a_member_has_these_terms_and_no_other(name):
    (found,) = [m for m in members() if m.name == name]

    def key(r: Row) -> str:
        return repr((r[0], r[1], [round(n, 9) for n in map(float, r[2])], r[3], r[4]))

    assert sorted(key(row(t)) for t in found.terms) == sorted(map(key, EXPECTED[name]))
    for t in found.terms:
        if len(t.numbers) == 8:
            np.testing.assert_allclose(t.numbers, EIGHT, rtol=1e-12)


def test_members_go_from_simple_to_rich():
    assert [m.name for m in members()] == list(EXPECTED)
