"""Ways to search, written down a second time in loops: what is drawn, kept, crossed and refined."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import qmc

from esea_gen.errors import UserError
from esea_gen.identify import searches
from esea_gen.identify.searches import POPULATION, SEARCHES, GeneticSettings, genetic, search_named


def test_the_numbers_of_a_search():
    assert GeneticSettings() == GeneticSettings(300, 1200, 50, 1e-6, 0.05, 0.8)
    assert POPULATION == 256
    assert list(SEARCHES) == ["multi-start", "evolution", "thesis"]
    assert [search_named(n) for n in SEARCHES] == [
        *(searches.multi_start, searches.evolution, searches.thesis)
    ]
    with pytest.raises(UserError, match="There is no search 'evolutoin'") as refused:
        search_named("evolutoin")
    assert "evolution?" in str(refused.value)
    assert "Known: multi-start, evolution, thesis." in str(refused.value)


def bred(costs, low, high, seed, s: GeneticSettings) -> list[list[float]]:
    """Every generation's children and the best point at last, one number after the other."""
    rng, n = np.random.default_rng(seed), len(low)
    drawn = rng.random((s.population, n))
    herd = [
        [low[k] + (high[k] - low[k]) * drawn[i, k] for k in range(n)] for i in range(s.population)
    ]
    worth = [costs(x) for x in herd]
    told = [herd]
    kept, crossed = round(s.elite * s.population), round(s.crossed * s.population)
    children = s.population - kept
    best = []
    for generation in range(s.generations):
        ranked = sorted(range(s.population), key=lambda i: worth[i])
        herd, worth = [herd[i] for i in ranked], [worth[i] for i in ranked]
        best.append(math.sqrt(worth[0]))
        if len(best) >= s.stall + 1 and best[-(s.stall + 1)] - best[-1] < s.tolerance_Nm:
            break
        # A wheel whose sectors are as wide as 1 over the root of the rank.
        start, total = rng.random(), sum(1 / math.sqrt(r + 1) for r in range(s.population))
        chosen = []
        for spoke in range(2 * children):
            at, end, rank = (start + spoke) / (2 * children) * total, 0.0, -1
            while end < at:
                rank += 1
                end += 1 / math.sqrt(rank + 1)
            chosen.append(rank)
        chosen = rng.permutation(chosen)
        coin, moves = rng.random((children, n)), rng.normal(0, 0.3, (children, n))
        moving = rng.random((children, n))
        left = 1 - generation / s.generations
        born = []
        for i in range(children):
            one, other = herd[chosen[i]], herd[chosen[children + i]]
            child = []
            for k in range(n):
                width = high[k] - low[k]
                if i < crossed:
                    x = one[k] if coin[i, k] < 0.5 else other[k]
                else:
                    x = one[k] + (left * width * moves[i, k] if moving[i, k] < 0.5 else 0)
                if x < low[k]:
                    x = max(low[k] + (low[k] - x), low[k])
                if x > high[k]:
                    x = min(max(high[k] - (x - high[k]), low[k]), high[k])
                child.append(x)
            born.append(child)
        told.append(born)
        herd, worth = herd[:kept] + born, worth[:kept] + [costs(x) for x in born]
    return [*told, herd[min(range(s.population), key=lambda i: worth[i])]]


@pytest.mark.parametrize(
    "settings",
    [
        GeneticSettings(20, 6, 50, 1e-6, 0.1, 0.45),
        GeneticSettings(31, 9, 3, 0.01, 0.2, 0.4),
        GeneticSettings(300, 5, 50, 1e-6, 0.05, 0.1),
        GeneticSettings(12, 0, 50, 1e-6, 0.1, 0.8),
    ],
)
def test_a_genetic_algorithm_generation_by_generation(settings):
    low, high = np.array([-2.0, 5.0, 0.1]), np.array([-1.0, 9.0, 0.3])
    asked = []

    def cost(x):
        # Least at an end of each number, so that many children come back from beyond it.
        return 1.0 + 3 * (x[0] + 2) + 0.5 * (9 - x[1]) + 40 * (x[2] - 0.1) + (x[0] + 2) * x[1]

    def costs(points):
        asked.append(points)
        return np.array([cost(x) for x in points])

    found = genetic(costs, low, high, 5, settings)
    expected = bred(cost, low, high, 5, settings)
    assert len(asked) == len(expected) - 1
    for one, other in zip(asked, expected, strict=False):
        np.testing.assert_allclose(one, other, rtol=1e-12)
    np.testing.assert_allclose(found, expected[-1], rtol=1e-12)


@pytest.mark.parametrize(("tolerance", "generations"), [(2.0, 8), (2.001, 2), (1e9, 2)])
def test_it_stalls_where_the_best_falls_by_less(tolerance, generations):
    low, high, calls = np.zeros(2), np.ones(2), []

    def costs(points):
        calls.append(len(points))
        return np.full(len(points), (20.0 - len(calls)) ** 2)  # a root of 19, 18, 17 ...

    genetic(costs, low, high, 1, GeneticSettings(10, 8, 2, tolerance, 0.2, 0.8))
    assert calls == [10, *[8] * generations]


LOW, HIGH = np.array([-3.0, 1.0, 10.0]), np.array([0.9, 2.0, 20.0])
# Costs along the first threshold: minima at both ends, one of two equal places, and four more.
VALLEYS = [5, 7, 9, 8, 6, 6, 7, 4, 9, 9.5, 3, 8, 7, 8, 9, 2, *[10 + k / 9 for k in range(23)], 12]


def valley(x: np.ndarray) -> float:
    i, j = round((x[0] + 3) / 0.1), round((x[1] - 1) / 0.2)
    return VALLEYS[i] + (j - i % 6) ** 2 + (x[2] - 17.0) ** 2


def test_minima_along_the_thresholds():
    asked = []

    def costs(points):
        asked.append(points)
        return np.array([valley(x) for x in points])

    assert len(VALLEYS) == 40
    problem = SimpleNamespace(low=LOW, high=HIGH, costs=costs)
    found = searches._threshold_minima(problem, np.array([-1.0, 1.5, 17.0]))
    (points,) = asked
    assert len(points) == 240
    assert sorted({round(x, 9) for x in points[:, 0]}) == pytest.approx(np.linspace(-3, 0.9, 40))
    assert sorted({round(x, 9) for x in points[:, 1]}) == pytest.approx(np.linspace(1, 2, 6))
    # At each minimum the second one's best place.
    places = [(15, 15 % 6), (10, 10 % 6), (7, 7 % 6), (0, 0)]
    expected = [[-3 + 0.1 * i, 1 + 0.2 * j, 17.0] for i, j in places]
    np.testing.assert_allclose(found, expected)
    # Where all are equal every place is one; the first four are kept.
    flat = SimpleNamespace(low=LOW, high=HIGH, costs=lambda p: np.ones(len(p)))
    found = searches._threshold_minima(flat, np.array([-1.0, 1.5, 17.0]))
    np.testing.assert_allclose(found, [[-3 + 0.1 * i, 1.0, 17.0] for i in range(4)])
    # The last place may be one.
    falls = SimpleNamespace(low=LOW, high=HIGH, costs=lambda p: -p[:, 0] + p[:, 1])
    found = searches._threshold_minima(falls, np.array([-1.0, 1.5, 17.0]))
    np.testing.assert_allclose(found, [[0.9, 1.0, 17.0]])


def test_many_starts_are_refined_a_little_and_the_best_two_to_the_end():
    refined = []

    def costs(points):
        return np.array([valley(x) for x in np.atleast_2d(points)])

    def refine(starts, steps):
        refined.append(([list(x) for x in starts], steps))
        return [(float(costs(x)[0]), np.asarray(x)) for x in starts]

    problem = SimpleNamespace(low=LOW, high=HIGH, costs=costs, refined=refine)
    ends = searches.multi_start(problem, 3, 64)
    # The best of Sobol's points, each a tenth of the box from every better one.
    points = qmc.scale(qmc.Sobol(3, seed=3).random(64), LOW, HIGH)
    chosen = []
    for x in sorted(points, key=valley):
        if all(np.max(np.abs(x - y) / (HIGH - LOW)) > 0.1 for y in chosen):
            chosen.append(x)
    chosen = chosen[:6]
    best = chosen[0]
    minima = [[-3 + 0.1 * i, 1 + 0.2 * (i % 6), best[2]] for i in (15, 10, 7, 0)]
    steps = [n for _, n in refined]
    assert steps == [12, 60, 12, 60]
    for (asked, _), expected in zip(refined, (chosen, chosen[:2], minima, minima[:2]), strict=True):
        np.testing.assert_allclose(asked, expected)
    np.testing.assert_allclose([x for _, x in ends], [*chosen, *minima])
    assert searches.best_of(ends)[0] == min(cost for cost, _ in ends)


def test_the_thesis_way_refines_from_both_of_its_ends(monkeypatch):
    asked = []
    monkeypatch.setattr(
        searches, "genetic", lambda costs, low, high, seed: asked.append((costs, low, high, seed))
    )
    monkeypatch.setattr(searches, "interior_point", lambda p, start: asked.append(start) or "in")
    problem = SimpleNamespace(
        low=1, high=2, costs=3, refined=lambda starts, steps: [(steps, x) for x in starts]
    )
    assert searches.thesis(problem, 9, 64) == [(60, "in"), (60, None)]
    assert asked == [(3, 1, 2, 9), None]
