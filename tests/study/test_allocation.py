"""Allocation: permuted blocks of random size, sealed, and no better to guess than it must be."""

from __future__ import annotations

from collections import Counter
from functools import cache

import numpy as np
import pytest

from esea_gen.errors import UserError
from esea_host.study.allocation import draw_list, strata_of, stratum_named
from esea_host.study.plan import group_of, guessed_share
from esea_host.study.protocol import ProtocolFile
from tests.conducted import changed

PLACES = 6000


def file_of(blocks: str = "", strata: str = "") -> ProtocolFile:
    text = "[allocation]\n" + (f"blocks = {blocks}\n" if blocks else "")
    text += f"[allocation.strata]\n{strata}\n" if strata else ""
    return changed("[stopping]", f"{text}[stopping]").file


def test_blocks_have_the_declared_sizes_and_are_balanced():
    file = file_of("[2, 6]")
    groups = [e.group for e in draw_list(file, b"1" * 32, PLACES)]
    # Where no group leads, a block may end: at every such place one of the two sizes fits.
    lead = np.cumsum([1 if g == "A" else -1 for g in groups])
    ends = {0}
    for k in range(2, PLACES + 1, 2):
        if lead[k - 1] == 0 and (k - 2 in ends or k - 6 in ends):
            ends.add(k)
    assert PLACES - max(ends) < 6
    assert np.max(np.abs(lead)) <= 3
    assert Counter(groups)["A"] == pytest.approx(PLACES / 2, abs=3)


@pytest.mark.parametrize("blocks", ["", "[2, 4]", "[4, 6]", "[2, 4, 6, 8, 10]"])
def test_nobody_guesses_better_than_the_bound(blocks):
    """An attacker weighs every position in every block by Bayes' rule, seeing all past groups."""
    file = file_of(blocks)
    sizes = file.allocation.blocks or (4, 6, 8)
    groups = [e.group for e in draw_list(file, b"2" * 32, PLACES)]
    # Belief: probability of (places left of A, of B) in the current block.
    start = {(s // 2, s // 2): 1 / len(sizes) for s in sizes}
    belief, right = dict(start), 0
    for group in groups:
        a = sum(p * left[0] / sum(left) for left, p in belief.items())
        right += group == ("A" if a >= 0.5 else "B")
        after: dict = {}
        for (x, y), p in belief.items():
            chance = p * (x if group == "A" else y) / (x + y)
            left = (x - 1, y) if group == "A" else (x, y - 1)
            for new, q in start.items() if left == (0, 0) else [(left, 1.0)]:
                after[new] = after.get(new, 0.0) + chance * q
        belief = {left: p / sum(after.values()) for left, p in after.items() if p}
    sd = 0.5 / np.sqrt(PLACES)
    assert right / PLACES < guessed_share(file) + 3 * sd
    assert guessed_share(file) < 0.75  # of blocks as long as the groups are many


def test_the_bound_is_that_of_blackwell_and_hodges():
    """E[right in a block of 2b] = b + 2^(2b-1) / C(2b, b) - 1/2."""

    @cache
    def choose(n: int, k: int) -> int:
        return 1 if k in (0, n) else choose(n - 1, k - 1) + choose(n - 1, k)

    right = [b + 2 ** (2 * b - 1) / choose(2 * b, b) - 0.5 for b in (2, 3, 4)]
    assert guessed_share(file_of()) == pytest.approx(sum(right) / (4 + 6 + 8), abs=1e-12)


def test_the_exported_seed_and_all_past_allocations_predict_nothing():
    """The former allocation followed from the protocol's seed: all of 200 were predicted."""
    protocol = changed("seed = 7", "seed = 7")
    told = [group_of(protocol, k) for k in range(200)]
    lists = [draw_list(protocol.file, bytes([k]) * 32, 200) for k in range(200)]
    each = [np.mean([e.group == g for e, g in zip(found, told, strict=True)]) for found in lists]
    assert np.mean(each) == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(200 * 200))
    # Nor does the first half of a list tell its second half by way of another secret's list.
    halves = {tuple(e.group for e in found[:40]) for found in lists}
    assert len(halves) == 200


def test_strata_have_lists_of_their_own():
    file = file_of(strata='sex = ["f", "m"]\nsite = ["1", "2"]')
    assert strata_of(file) == ["sex=f,site=1", "sex=f,site=2", "sex=m,site=1", "sex=m,site=2"]
    assert stratum_named(file, ["site=2", "sex=f"]) == "sex=f,site=2"
    found = draw_list(file, b"3" * 32, 40)
    assert len({tuple(e.group for e in found if e.stratum == s) for s in strata_of(file)}) == 4
    for wrong in ([], ["sex=f"], ["sex=x,site=1"], ["sex=f,site=1,more=2"]):
        with pytest.raises(UserError, match="sex: f or m; site: 1 or 2"):
            stratum_named(file, wrong)
    assert stratum_named(file_of(), []) == ""
    with pytest.raises(UserError, match="Leave --stratum out"):
        stratum_named(file_of(), ["sex=f"])


@pytest.mark.parametrize("blocks", ["[4]", "[4, 4]", "[3, 4]", "[0, 4]", "[4, 102]"])
def test_wrong_block_sizes_are_told(blocks):
    with pytest.raises(UserError, match="at least two different sizes"):
        file_of(blocks)
