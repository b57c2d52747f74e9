"""Published results of chapter 6, and conclusions from them without the thesis' data.

No value of a single person was published, so neither the medians nor an interval can be recomputed.
From a p value of an exact test the rank sum can be, and with it an effect.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from esea_host.statistics import detectable_effect, effect_from_p, holm

PEOPLE = 10
METRICS = ("RMS acceleration", "VDV", "LDLJ", "SPARC")
TASKS = ("tracking", "pong")
CANNOT = (
    "medians, effects in units and their intervals: no value of a person is printed",
    "period and carry-over effects: they need both values of each person",
    "loading stiffness: the curves are a figure; its two slopes are reproduced in simulation",
    "survey: four means of ten answers; their distributions are not printed",
    "agreement of coders: one coding is printed",
)


@dataclass(frozen=True)
class PublishedRow:
    """A comparison as printed: medians, p; table and section."""

    table: str
    task: str
    metric: str
    first: float
    second: float
    p: float


def _rows(
    table: str, numbers: dict[str, tuple[tuple[float, float, float], ...]]
) -> tuple[PublishedRow, ...]:
    return tuple(
        PublishedRow(table, task, metric, *values)
        for metric, pair in numbers.items()
        for task, values in zip(TASKS, pair, strict=True)
    )


# Section 6.6.1.1, block 1 and block 2.
TABLE_6_2 = _rows(
    "6.2",
    {
        "RMS acceleration": ((47.5, 47.5, 0.32), (59.1, 59.3, 0.065)),
        "VDV": ((997.0, 1005.5, 0.28), (1349.0, 1336.0, 0.020)),
        "LDLJ": ((35.9, 35.7, 0.16), (35.7, 36.1, 0.49)),
        "SPARC": ((7.78, 7.12, 0.065), (9.51, 10.2, 0.56)),
    },
)
# Section 6.6.1.2, spring and elastomer.
TABLE_6_3 = _rows(
    "6.3",
    {
        "RMS acceleration": ((53.1, 43.5, 0.049), (59.1, 59.2, 0.63)),
        "VDV": ((1098.0, 903.1, 0.0059), (1370.8, 1335.0, 0.77)),
        "LDLJ": ((35.9, 35.7, 0.11), (35.7, 36.1, 0.70)),
        "SPARC": ((7.55, 6.85, 0.56), (9.83, 10.2, 0.92)),
    },
)
# Section 6.6.2.1, means of spring against elastomer.
TABLE_6_4 = {"comfort": -0.2, "naturalness": -0.3, "control": -0.3, "effort": -0.2}
# Section 6.6.2.2: positive, negative, neutral of the spring, then of the elastomer.
TABLE_6_5 = {
    "smoothness": ((2, 2, 0), (1, 1, 0)),
    "linearity": ((0, 0, 0), (0, 0, 2)),
    "nonlinearity": ((0, 0, 4), (0, 0, 1)),
    "ease of movement": ((3, 3, 0), (3, 3, 0)),
    "miscellaneous": ((0, 0, 3), (0, 0, 5)),
}
COMMENTS = 30


def published(table: tuple[PublishedRow, ...], task: str, metric: str) -> PublishedRow:
    return next(r for r in table if (r.task, r.metric) == (task, metric))


def reread(table: tuple[PublishedRow, ...]) -> list[dict[str, Any]]:
    """Each row with the results implied by its p: rank sum, effect, p adjusted over the table."""
    adjusted = holm([row.p for row in table])
    out = []
    for row, p_holm in zip(table, adjusted, strict=True):
        implied = effect_from_p(row.p, PEOPLE)
        # Which way: the smaller rank sum belongs to the rarer sign; the medians tell as a rule.
        change = row.second - row.first
        out.append(
            vars(row)
            | {"p_holm": float(p_holm), "rank_sum": implied.rank_sum, "p_exact": implied.p}
            | {"rank_biserial": implied.rank_biserial, "as_printed": implied.as_printed}
            | {"change_of_medians": change}
        )
    return out


def could_have_seen() -> dict[str, float]:
    """Smallest difference that ten people show with 80 % power, in standard deviations."""
    family = len(TABLE_6_3)
    return {
        "one_test": detectable_effect(PEOPLE),
        "family_of_8": detectable_effect(PEOPLE, alpha=0.05 / family),
    }
