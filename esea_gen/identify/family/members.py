"""The members of the family that are compared, from simple to rich.

Their outer numbers are fixed: spaced evenly on a logarithmic axis, in units of the largest trained
deflection and in seconds.  Only weights are fitted.
"""

from __future__ import annotations

from esea_gen.model.family import Member, Rise, Softening, Term, softened

LINEAR, CUBIC = Rise("power", 1), Rise("power", 3)
STEEP, BENT = Rise("bend", 0.08), Rise("bend", 0.4)

THRESHOLDS = (0.02, 0.07, 0.15, 0.3, 0.6, 1.1)
PATHS = (0.03, 0.1, 0.3, 1.0, 3.0)
TIMES_s = (3.0, 30.0, 300.0)
QUICK_s = (0.1, 0.3, 1.0, 3.0, 30.0)
TURNING_s = (0.03, 0.1, 0.3, 1.0)
FRACTIONAL_s = tuple(10 ** (-1 + 4 * k / 7) for k in range(8))
EXPONENT = 0.2

STRAIN = Softening("strain", 0.3)
WORN = (STRAIN, Softening("path", 8.0), Softening("path", 40.0))


def _springs(*rises: Rise) -> list[Term]:
    return [Term("spring", r) for r in rises]


def members() -> tuple[Member, ...]:
    """All of them."""
    odd = _springs(LINEAR, CUBIC)
    stops = odd + [Term("stop", q, (r,)) for q in (LINEAR, CUBIC) for r in THRESHOLDS]
    slips = odd + [Term("slip", q, (p,)) for q in (LINEAR, CUBIC) for p in PATHS]
    bent = _springs(STEEP, BENT, LINEAR, CUBIC)
    rises = (STEEP, BENT, LINEAR)
    maxwell = bent + [Term("maxwell", q, (t,)) for q in rises for t in TIMES_s]
    element = [Term("maxwell", q, FRACTIONAL_s, EXPONENT) for q in (STEEP, BENT, LINEAR, CUBIC)]
    fractional = bent + element
    offset = Term("offset")
    quick = [Term("maxwell", q, (t,)) for q in (LINEAR, CUBIC) for t in QUICK_s]
    friction = [*bent, *stops[len(odd) :], *quick, offset]
    # Friction that turns back otherwise at the two ends of a stroke.
    ends = [Rise("power", 1, "positive"), Rise("power", 1, "negative")]
    turning = [Term("maxwell", q, (t,)) for q in ends for t in TURNING_s]
    return (
        Member("stops", "springs and stop operators", tuple(stops)),
        Member("slips", "springs and slip operators", tuple(slips)),
        Member("stops, strain", "stops, softened by strain", softened(stops, STRAIN)),
        Member("slips, strain", "slips, softened by strain", softened(slips, STRAIN)),
        Member("stops, worn", "stops, softened by strain and path", softened(stops, *WORN)),
        Member("slips, worn", "slips, softened by strain and path", softened(slips, *WORN)),
        Member(
            "slips, worn, offset",
            "slips, softened by strain and path, and an offset",
            softened([*slips, offset], *WORN),
        ),
        Member("stops, Maxwell, offset", "bent springs, stops, Maxwell, offset", tuple(friction)),
        Member(
            "stops, sides, offset", "stops, Maxwell each side, offset", (*stops, *turning, offset)
        ),
        Member("Maxwell", "bent springs and Maxwell branches", tuple(maxwell)),
        Member("fractional", "bent springs and a fractional element", tuple(fractional)),
        Member("Maxwell, strain", "Maxwell, softened by strain", softened(maxwell, STRAIN)),
        Member(
            "fractional, strain", "fractional, softened by strain", softened(fractional, STRAIN)
        ),
    )
