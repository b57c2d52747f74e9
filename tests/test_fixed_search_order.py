"""In which order the search tries what may be wide, when it ends, and how it takes back."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from esea_gen.emit.fixed import search
from esea_gen.emit.walker import Kernel, Node
from esea_gen.language.ports import Port

# Nodes 0 to 8; what is said of each is its place in the lists below.
CLIPPED, HALF, SHORT, FINE, ROOT, COARSE, UNFOLLOWED = 1, 2, 3, 4, 5, 6, 7
TERM = 8
LEVELS = [
    {CLIPPED},
    {CLIPPED, HALF},
    {CLIPPED, SHORT, TERM},
    {CLIPPED, SHORT, TERM, ROOT},
    {CLIPPED, HALF, COARSE},
    {CLIPPED, HALF, COARSE, SHORT, TERM, ROOT},
]


class Search:
    """The search with scores that are given, by what is wide."""

    def __init__(self, patch, scores, *, forgets=True, linear=False, still=(), halves=(HALF,)):
        self.tried, self.asked, self.narrowed, self.probed = [], [], [], []
        nodes = [Node("neg", (0,))] * 9
        nodes[0], nodes[SHORT] = Node("input"), Node("add", (TERM, 0))
        state = (Port("p", -1, 1, "pair", 2), Port("q", -1, 1, "own"))
        self.planner = SimpleNamespace(
            kernel=Kernel("f", tuple(nodes), ()), block=SimpleNamespace(state=state, solved={})
        )
        self.states = {"p": 3e-6, "q": 5e-6}

        def plan(why):
            return SimpleNamespace(
                wide=frozenset(why), why_wide=dict(why), block=self.planner.block
            )

        def tried(planner, wide):
            self.tried.append(set(wide))
            score = scores[len(self.tried) - 1]
            if score is None:
                return None
            known = forgets(len(self.tried) - 1) if callable(forgets) else forgets
            return search._Tried(plan(wide), score, self.states, known, linear)

        def bounded(planner, wide, errors, ceiling, known):
            self.asked.append((set(wide), errors, ceiling, known))
            return plan(wide) if frozenset(wide) in still else None

        def narrow(planner, best, ceiling):
            self.narrowed.append((set(best.wide), ceiling))
            return plan({SHORT: "narrowed"})

        def clipped(_plan, inner=False):
            return dict.fromkeys(halves, "half") if inner else {CLIPPED: "clipped"}

        patch.setattr(search, "_try", tried)
        patch.setattr(search, "_still_bounded", bounded)
        patch.setattr(search, "_narrowed", narrow)
        patch.setattr(search, "_clipped", clipped)
        patch.setattr(search, "_small_ends", lambda _p: {SHORT: 27, FINE: 28})
        patch.setattr(search, "_flat_roots", lambda _p: {ROOT: "root"})
        patch.setattr(search, "coarse_values", lambda _p: {COARSE: "coarse", UNFOLLOWED: "coarse"})
        followed = SimpleNamespace(followed=frozenset(range(9)) - {UNFOLLOWED})
        patch.setattr(search, "Propagation", lambda *_a, **_k: followed)
        self.found = search.search(self.planner)


def test_from_little_to_much_and_the_best_of_all_is_kept(monkeypatch):
    run = Search(monkeypatch, [9, 8, 7, 3, None, 5, 4])
    assert run.tried == [set(), *LEVELS]
    assert run.found.wide == LEVELS[2]
    assert run.found.why_wide == {
        CLIPPED: "clipped",
        SHORT: "would keep 27 significant bits of 31 where it is smallest",
        TERM: f"is a term of v{SHORT}, which is held in 64 bits",
    }
    run = Search(monkeypatch, [9, 8, 7, 6, 5, 4, 3])
    assert run.found.why_wide[COARSE] == "would be coarse"
    assert run.found.why_wide[ROOT] == "root"
    assert run.found.why_wide[HALF] == "half"
    # Of two that are alike the first, which has less.
    run = Search(monkeypatch, [9, 8, 3, 3, 3, 3, 3])
    assert run.found.wide == LEVELS[1]


@pytest.mark.parametrize("at", range(7))
def test_it_ends_where_the_aim_is_met(monkeypatch, at):
    run = Search(monkeypatch, [*range(9, 9 - at, -1), 1.0])
    assert run.tried == [set(), *LEVELS][: at + 1]
    assert run.found.wide == run.tried[-1]


def test_a_little_above_the_aim_it_goes_on(monkeypatch):
    run = Search(monkeypatch, [1.001, 0.999])
    assert run.tried == [set(), LEVELS[0]]


def test_what_forgets_its_errors_comes_before_all_that_does_not(monkeypatch):
    # The third try forgets, though its score is the worst; the last is better still.
    run = Search(monkeypatch, [0.2, 0.1, 50, 0.3, 40, 0.1, 0.1], forgets=lambda k: k in (2, 4))
    assert run.tried == [set(), *LEVELS]
    assert run.found.wide == LEVELS[3]
    run = Search(monkeypatch, [0.2, 0.1, 0.9], forgets=lambda k: k == 2)
    assert run.tried == [set(), *LEVELS[:2]]


def test_the_same_values_are_tried_once(monkeypatch):
    # Without more halves the second is the first again.
    run = Search(monkeypatch, [9, 8, 6, 5, 4, 3], halves=(CLIPPED,))
    more = {CLIPPED, COARSE}
    assert run.tried == [set(), LEVELS[0], *LEVELS[2:4], more, more | LEVELS[3]]


@pytest.mark.parametrize(("score", "ceiling"), [(0.8, 1.0), (0.99, 1.0098), (3.0, 3.06)])
def test_one_value_after_the_other_is_taken_back(monkeypatch, score, ceiling):
    # Without 3 it holds, and then without 8; each is asked for of what is left.
    without = frozenset({1, 5, 8}), frozenset({1, 5})
    scores = [9, 8, 7, 6, score, 9, 9]
    run = Search(monkeypatch, scores, still=without, forgets=True)
    assert [a[0] for a in run.asked] == [{3, 5, 8}, {1, 5, 8}, {1, 8}, {1, 5}]
    assert run.found.wide == {1, 5}
    for _, errors, most, forgets in run.asked:
        assert (most, forgets) == (pytest.approx(ceiling), True)
        by = ceiling / score
        assert errors == [[pytest.approx(3e-6 * by)] * 2, [pytest.approx(5e-6 * by)]]


def test_nothing_is_taken_back_of_nothing_or_without_a_bound(monkeypatch):
    for scores in ([0.5], [9, 10, 10, 10, 10, 10, 10], [math.inf] * 7):
        run = Search(monkeypatch, scores)
        assert (run.asked, run.narrowed) == ([], [])
        assert run.found.wide == frozenset()


def test_a_linear_block_is_narrowed_as_one(monkeypatch):
    run = Search(monkeypatch, [9, 8, 2, 7, 7, 7, 7], linear=True)
    assert run.found.why_wide == {SHORT: "narrowed"}
    assert run.narrowed == [(LEVELS[1], pytest.approx(2.04))]
    assert run.asked == []


def test_a_linear_blocks_memory_is_summed_for_every_choice(monkeypatch):
    # Own errors of three elements, and what each of them sums up to in all three.
    memory = [[2.0, 0.5, 0.0], [3.0, 1.5, 0.25], [0.0, 7.0, 5.0]]
    total = [[8e-6, 31.5e-6], [20.5e-6]]
    # As multiples of the aim, by what is left wide; None: no plan, or no bound.
    scores = {"2345": 1.51, "1345": 1.5, "145": None, "135": 1.4, "13": None}
    asked, tried = [], []

    def score(plan):
        return scores["".join(map(str, sorted(plan.wide)))]

    class Step:
        def __init__(self, plan, ranges, input_errors, room=0.0, known=None):
            assert (ranges, input_errors, room, known) == ({}, {}, 0.0, "kept")
            self.plan, self.zero = plan, "zero"

        def once(self, errors):
            asked.append(errors)
            if score(self.plan) is None:
                raise search.RangeError("none")
            return errors

        def state_errors(self, result):
            assert result == "zero"
            return [[1e-6, 2e-6], [4e-6]]

        def outputs(self, result):
            return {"y": score(self.plan) * 5e-5 * 2}

    def plan(fewer, why):
        assert fewer == why
        tried.append(set(fewer))
        if set(fewer) == {1, 3}:
            raise search.LoweringError("no", "fix")
        return SimpleNamespace(wide=frozenset(fewer), why_wide=dict(fewer))

    monkeypatch.setattr(search, "Propagation", Step)
    monkeypatch.setattr(search, "_memory", lambda _block: memory)
    block = SimpleNamespace(
        state=(Port("p", -1, 1, "pair", 2), Port("q", -1, 1, "own")),
        outputs=(Port("y", -1.0, 2.0, "output"),),
    )
    planner = SimpleNamespace(block=block, plan=plan, known={0.0: "kept", 1e-6: "other"})
    why = {k: f"why {k}" for k in (1, 2, 3, 4, 5)}
    best = SimpleNamespace(wide=frozenset(why), why_wide=why)
    found = search._narrowed(planner, best, 1.5)
    assert tried == [{2, 3, 4, 5}, {1, 3, 4, 5}, {1, 4, 5}, {1, 3, 5}, {1, 3}]
    assert found.why_wide == {k: why[k] for k in (1, 3, 5)}
    for errors in asked[1::2]:
        if errors != "zero":
            assert errors == [[pytest.approx(e) for e in row] for row in total]
    assert len([e for e in asked if e != "zero"]) == 3
