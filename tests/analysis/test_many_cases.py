"""Many cases: their percentiles by a second bootstrap, failures counted, and who runs them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from esea_gen.analysis.campaign import Workers, seeded
from esea_gen.analysis.journal import Configuration, Result
from esea_gen.analysis.monte_carlo import MonteCarlo, percentiles
from esea_gen.errors import UserError

LEVELS = (5.0, 25.0, 50.0, 75.0, 95.0)


def between(row: np.ndarray, percent: float) -> float:
    """A percentile on a straight line between order statistics."""
    row = np.sort(row)
    place = percent / 100 * (len(row) - 1)
    k = min(int(place), len(row) - 2)
    return float(row[k] + (place - k) * (row[k + 1] - row[k]))


def test_percentiles_and_their_bootstrap_interval_a_second_time():
    values = np.random.default_rng(7).normal(3.0, 2.0, 23)
    p = percentiles("x", values.tolist(), failed=4)
    assert (p.name, p.count, p.failed, p.largest) == ("x", 23, 4, float(values.max()))
    picks = np.random.default_rng(20230915).integers(0, 23, (2000, 23))
    drawn = np.sort(values)[picks]
    for level in LEVELS:
        assert p.values[level] == pytest.approx(between(values, level))
        of_each = np.array([between(row, level) for row in drawn])
        assert p.low[level] == pytest.approx(between(of_each, 2.5))
        assert p.high[level] == pytest.approx(between(of_each, 97.5))
    told = p.to_dict()
    assert list(told)[:5] == ["count", "failed", "p5", "p5_low", "p5_high"]
    assert (told["count"], told["failed"], told["max"]) == (23, 4, p.largest)
    for level in LEVELS:
        name = f"p{level:.0f}"
        found = (told[name], told[f"{name}_low"], told[f"{name}_high"])
        assert found == (p.values[level], p.low[level], p.high[level])
    for bad, words in (([], "x: 0 values, 0 not"), ([1.0, math.nan, math.inf], "x: 3 values, 2 n")):
        with pytest.raises(UserError, match=words):
            percentiles("x", bad)


RESULTS = (
    Result({"seed": 1, "law": "a"}, {"rms": 1.0, "peak": 5.0}),
    Result({"seed": 2, "law": "a"}, None, "tripped"),
    Result({"seed": 3, "law": "b"}, {"rms": 3.0}),
    Result({"seed": 4, "law": "b"}, {"rms": 2.0, "peak": 4.0}),
)


def test_figures_of_cases_by_their_arguments():
    found = MonteCarlo(Configuration({"x": 1}), RESULTS)
    assert found.failures == RESULTS[1:2]
    assert found.values("rms").tolist() == [1, 3, 2]
    assert found.values("peak").tolist() == [5, 4]
    assert found.values("rms", {"law": "b"}).tolist() == [3, 2]
    assert found.values("rms", {"law": "b", "seed": 4}).tolist() == [2]
    summary = found.summary()
    assert list(summary) == ["peak", "rms"]
    assert [(p.count, p.failed, p.largest) for p in summary.values()] == [(2, 2, 5), (3, 1, 3)]
    assert [(p.count, p.failed) for p in found.summary({"law": "b"}).values()] == [(1, 1), (2, 0)]
    assert found.summary({"law": "c"}) == {}
    with pytest.raises(UserError, match=r"No case gave 'rsm'\. Choose from peak, rms\."):
        found.values("rsm")
    with pytest.raises(UserError, match="No case gave 'rms'"):
        found.values("rms", {"law": "c"})
    with pytest.raises(UserError, match=r"Choose from none\."):
        MonteCarlo(Configuration({}), RESULTS[1:2]).values("rms")
    told = found.to_dict()
    assert (told["cases"], told["failed"]) == (4, 1)
    assert told["configuration"] == found.configuration.parts
    assert told["key"] == found.configuration.key
    assert told["failures"] == [{"case": {"seed": 2, "law": "a"}, "failure": "tripped"}]
    assert told["results"][1:3] == [
        *({"case": {"seed": 2, "law": "a"}, "values": None},),
        *({"case": {"seed": 3, "law": "b"}, "values": {"rms": 3.0}},),
    ]
    assert told["summary"] == {k: p.to_dict() for k, p in summary.items()}


def test_seeds_are_independent_numbers_of_64_bits():
    made = seeded(5, root=3, gain=2.0)
    children = np.random.default_rng(3).bit_generator.seed_seq.spawn(5)
    assert [c["seed"] for c in made] == [int(c.generate_state(1, np.uint64)[0]) for c in children]
    assert {c["gain"] for c in made} == {2.0}
    assert max(c["seed"] for c in made) > 2**60
    assert len(seeded(1)) == 1
    assert seeded(3) == seeded(3, root=0)
    with pytest.raises(UserError, match=r"count: 0\. Ask for at least 1 case"):
        seeded(0)
    assert [Workers(n).jobs for n in (-1, 1, 2)] == [-1, 1, 2]
    assert (Workers().jobs, Workers().cluster) == (-1, None)
    for n in (0, -2):
        with pytest.raises(UserError, match=f"workers: {n}. Give 1 or more, or -1"):
            Workers(n)


def test_the_bootstrap_interval_covers():
    hits = sum(
        p.low[50.0] <= 0 <= p.high[50.0]
        for p in (percentiles("x", np.random.default_rng(s).normal(size=60)) for s in range(100))
    )
    assert 88 <= hits <= 100
