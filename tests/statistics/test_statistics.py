"""Statistics: published examples, other libraries, enumeration, rejected input."""

from __future__ import annotations

import itertools
import math
import warnings

import numpy as np
import pytest
import scipy.stats
from hypothesis import given, settings
from hypothesis import strategies as st
from statsmodels.regression.mixed_linear_model import MixedLM, MixedLMParams
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.power import TTestPower

from esea_host.statistics import (
    NoStatisticError,
    attainable_p,
    bayes_paired,
    cohens_kappa,
    crossover,
    effect_from_p,
    holm,
    mixed_model,
    paired_t_power,
    power_statement,
    signed_rank,
    standardised_difference,
)
from esea_host.statistics.bayes import log_bayes_factor_01

# R, help page of wilcox.test: Hollander and Wolfe's depression scale.
BEFORE = [1.83, 0.50, 1.62, 2.48, 1.68, 1.88, 1.55, 3.06, 1.30]
AFTER = [0.878, 0.647, 0.598, 2.05, 1.06, 1.29, 1.06, 3.14, 1.29]
# R, data set sleep: extra hours, two drugs, the same ten people.
DRUG_1 = [0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0]
DRUG_2 = [1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4]
# Senn, Cross-over Trials in Clinical Research, table 3.1: peak flow, formoterol and salbutamol.
FIRST = [310, 310, 370, 410, 250, 380, 330, 370, 310, 380, 290, 260, 90]
SECOND = [270, 260, 300, 390, 210, 350, 365, 385, 400, 410, 320, 340, 220]
SEQUENCE = ["formoterol"] * 7 + ["salbutamol"] * 6
DRUGS = ("formoterol", "salbutamol")


def enumerated_p(found):
    """Every assignment of signs, counted one by one."""
    d = np.asarray(found, dtype=float)
    d = d[d != 0]
    r = scipy.stats.rankdata(np.abs(d))
    seen = r[d > 0].sum()
    sums = np.array([np.dot(s, r) for s in itertools.product((0, 1), repeat=len(d))])
    return min(1.0, 2 * min(np.sum(sums <= seen + 1e-9), np.sum(sums >= seen - 1e-9)) / len(sums))


# -- signed rank ----------------------------------------------------------------------------------


def test_rs_example():
    """V = 40, p = 0.03906; pseudo-median 0.46, interval 0.010 to 0.786."""
    found = signed_rank(BEFORE, AFTER)
    assert (found.w_plus, found.w_minus, found.method) == (40, 5, "exact")
    assert found.p == pytest.approx(0.0390625)
    assert (found.low, found.hodges_lehmann, found.high) == pytest.approx((0.010, 0.46, 0.786))
    assert found.confidence == pytest.approx(1 - 2 * 10 / 512)
    assert found.rank_biserial == pytest.approx(35 / 45)


def test_zeros_and_ties_are_stated():
    """Of all signs counted; R warns of both and takes the normal approximation."""
    found = signed_rank(DRUG_1, DRUG_2)
    assert (found.n, found.zeros, found.ties) == (10, 1, 2)
    assert found.p == pytest.approx(2 / 512)
    assert (found.rank_biserial, found.rank_biserial_low) == (-1, -1)
    # All nine slower: (1 - c)/(1 + c) with c = 1.96^2 times the variance under no difference.
    c = 1.959964**2 * (9 * 10 * 19 / 6) / 45**2
    assert found.rank_biserial_high == pytest.approx(-(1 - c) / (1 + c), abs=1e-6)


def test_ties_and_zeros_up_to_rounding():
    """Tenths: 0.3 - 0.2, 0.2 - 0.1 and 1.3 - 1.2 are one tie, 0.1 + 0.2 - 0.3 is a zero."""
    x, y = [0.3, 0.2, 1.3, 0.1 + 0.2], [0.2, 0.1, 1.2, 0.3]
    assert len({a - b for a, b in zip(x, y, strict=True)}) == 4
    for found in (signed_rank(x, y), signed_rank([a - b for a, b in zip(x, y, strict=True)])):
        assert (found.n, found.zeros, found.ties) == (4, 1, 3)
        assert found.p == 2 / 8
    assert signed_rank([1e-200, 2e-200], [0, 0]).ties == 0


@settings(max_examples=60)
@given(st.lists(st.integers(-4, 4), min_size=2, max_size=8).filter(any))
def test_every_sign_counted(found):
    """Five-level answers are full of ties and zeros."""
    ours = signed_rank(found)
    assert ours.p == pytest.approx(enumerated_p(found))
    assert ours.n == len(found)
    assert ours.zeros == found.count(0)
    turned = signed_rank([-x for x in found])
    assert turned.p == pytest.approx(ours.p)
    assert turned.rank_biserial == pytest.approx(-ours.rank_biserial)
    assert turned.low == pytest.approx(-ours.high)


def test_what_p_values_ten_people_can_have():
    assert attainable_p(10)[[0, 2, 8]] == pytest.approx([2 / 1024, 6 / 1024, 50 / 1024])
    assert attainable_p(5)[0] == pytest.approx(2 / 32)
    assert attainable_p(4)[-1] == 1.0
    # 0.0059 is a smaller rank sum of 2; nothing rounds to 0.065.
    implied = effect_from_p(0.0059, 10)
    assert (implied.rank_sum, implied.as_printed) == (2, True)
    assert implied.rank_biserial == pytest.approx(1 - 4 / 55)
    odd = effect_from_p(0.065, 10)
    assert (odd.rank_sum, odd.as_printed) == (9, False)
    assert odd.p == pytest.approx(66 / 1024)


# -- effects, multiplicity, power -----------------------------------------------------------------


def test_rs_paired_t():
    """t.test(extra ~ group, paired): mean -1.58, interval -2.459886 to -0.7001142, p 0.002833."""
    found = standardised_difference(DRUG_1, DRUG_2)
    assert (found.mean, found.low, found.high) == pytest.approx((-1.58, -2.459886, -0.7001142))
    assert found.p == pytest.approx(0.002833, abs=5e-7)
    assert found.dz == pytest.approx(-4.0621 / math.sqrt(10), abs=1e-5)


def test_holm():
    """By hand: 4 x 0.01, 3 x 0.012 (not below the one before), 2 x 0.03, 0.2."""
    assert holm([0.03, 0.01, 0.2, 0.012]) == pytest.approx([0.06, 0.04, 0.2, 0.04])
    p = np.random.default_rng(2).uniform(0, 1, 9) ** 3
    assert holm(p) == pytest.approx(multipletests(p, method="holm")[1])


def test_t_power_as_g_power_and_statsmodels():
    """34 pairs for d_z = 0.5 and 80 % (R's pwr: 33.37); 10 pairs see 0.996."""
    assert paired_t_power(33, 0.5) < 0.8 < paired_t_power(34, 0.5)
    assert paired_t_power(10, 0.996) == pytest.approx(0.8, abs=1e-3)
    for n, d, alpha in ((10, 0.3, 0.05), (25, 0.7, 0.01)):
        theirs = TTestPower().power(d, n, alpha)
        assert paired_t_power(n, d, alpha) == pytest.approx(theirs, abs=1e-9)
    # By mpmath, 25 digits; that of older SciPy is not a number for the first two.
    for n, d, alpha, power in (
        (8, 3.0, 1e-4, 0.65897414383567),
        (8, 3.0, 0.05 / 16, 0.99598517330508),
        (200, 0.01, 0.05, 0.05227211774845),
        (2, 5.0, 0.05, 0.42096140914950),
    ):
        assert paired_t_power(n, d, alpha) == pytest.approx(power, rel=1e-8)


# -- cross-over -----------------------------------------------------------------------------------


def test_senns_trial():
    """Published there: 46.6 l/min, interval 22.9 to 70.3, standard error 10.78."""
    found = crossover(FIRST, SECOND, SEQUENCE, DRUGS)
    assert found.people == {"formoterol": 7, "salbutamol": 6}
    t = found.treatment
    assert (t.estimate, t.low, t.high, t.se) == pytest.approx((46.6, 22.9, 70.3, 10.78), abs=0.05)
    assert t.df == 11
    # The mixed model of complete data is the same estimate.
    long = mixed_model(
        FIRST + SECOND,
        [str(i) for i in range(13)] * 2,
        SEQUENCE + [DRUGS[1] if s == DRUGS[0] else DRUGS[0] for s in SEQUENCE],
        [1] * 13 + [2] * 13,
        DRUGS,
    )
    assert long.treatment == pytest.approx(t.estimate, rel=1e-6)
    assert long.treatment_se == pytest.approx(t.se, rel=1e-3)
    assert long.period == pytest.approx(found.period.estimate, rel=1e-6)
    assert long.between_sd > long.within_sd


@st.composite
def trials(draw):
    """Two periods of 4 to 24 people in tenths, full of ties; both sequences; the unit's size."""
    n = draw(st.integers(4, 24))
    values = st.lists(st.integers(-20, 20), min_size=n, max_size=n)
    one, two = (np.array(draw(values)) / 10 for _ in range(2))
    forward = np.array(draw(st.permutations([True, True] + [False] * (n - 2))))
    return one, two, forward, draw(st.sampled_from([1e-3, 0.3048, 25.4, 1e3, 1e-9, 2**20]))


def analysed(one, two, forward):
    return crossover(one, two, np.where(forward, "S", "E").tolist(), ("S", "E"))


@settings(max_examples=25, deadline=None)
@given(trials())
def test_crossover_in_any_unit_order_and_naming(trial):
    """Units, people's order, the two periods' and the two treatments' names change no p."""
    one, two, forward, unit = trial
    found = analysed(one, two, forward)
    order = np.random.default_rng(1).permutation(len(one))
    for other, signs, size in (
        (analysed(one * unit, two * unit, forward), (1, 1, 1), unit),
        (analysed(one[order], two[order], forward[order]), (1, 1, 1), 1),
        (analysed(two, one, ~forward), (1, -1, -1), 1),  # periods swapped
        (analysed(one, two, ~forward), (-1, 1, -1), 1),  # treatments swapped
    ):
        for name, sign in zip(("treatment", "period", "carry_over"), signs, strict=True):
            a, b = getattr(found, name), getattr(other, name)
            assert b.p == pytest.approx(a.p, rel=1e-6, nan_ok=True)
            assert b.estimate == pytest.approx(sign * size * a.estimate, rel=1e-9, abs=1e-12 * size)


@settings(max_examples=10, deadline=None)
@given(trials(), st.integers(0, 2**32 - 1))
def test_mixed_model_with_missing_periods(trial, seed):
    """Unit, order and names change nothing; where statsmodels converges, it gives the same."""
    one, two, forward, unit = trial
    rng = np.random.default_rng(seed)
    n = len(one)
    values = np.concatenate([one, two]) + rng.normal(0, 0.3, 2 * n)
    people, first = np.tile(np.arange(n), 2), np.concatenate([forward, ~forward])
    period = np.repeat([1, 2], n)
    kept = rng.permutation(2 * n)[: 2 * n - rng.integers(0, n)]

    def fitted(values, first, period, kept=kept):
        words = np.where(first, "S", "E")[kept].tolist()
        return mixed_model(values[kept], people[kept], words, period[kept], ("S", "E"))

    try:
        found = fitted(values, first, period)
    except NoStatisticError as error:
        assert "tell treatment and period apart" in str(error)  # noqa: PT017
        return
    for other, signs, size in (
        (fitted(values * unit, first, period), (1, 1), unit),
        (fitted(values, first, period, np.sort(kept)), (1, 1), 1),
        (fitted(values, ~first, period), (-1, 1), 1),
        (fitted(values, first, 3 - period), (1, -1), 1),
    ):
        assert other.treatment == pytest.approx(signs[0] * size * found.treatment, rel=1e-5)
        assert other.period == pytest.approx(signs[1] * size * found.period, rel=1e-5)
        assert other.treatment_se == pytest.approx(size * found.treatment_se, rel=1e-5)
        assert other.treatment_p == pytest.approx(found.treatment_p, rel=1e-4)
    design = np.column_stack([np.ones(2 * n), first - 0.5, period - 1.5])[kept]
    model = MixedLM(values[kept], design, groups=people[kept])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it often stops too early, which is why it is not used
        fit = model.fit()
    ratio = np.array([[max(1e-9, (found.between_sd / found.within_sd) ** 2)]])
    ours, theirs = (
        model.loglike(MixedLMParams.from_components(cov_re=r, fe_params=np.zeros(3)))
        for r in (ratio, np.maximum(fit.cov_re / fit.scale, 1e-9))
    )
    assert ours >= theirs - 1e-6
    effects, _ = model.get_fe_params(ratio, np.zeros(0))
    assert effects[1:] == pytest.approx([found.treatment, found.period], rel=1e-5, abs=1e-7)
    scale = model.get_scale(effects, ratio, np.zeros(0))
    assert found.within_sd**2 == pytest.approx(scale, rel=1e-5)


# -- belief, coders -------------------------------------------------------------------------------


def test_rs_bayes_factor():
    """BayesFactor, ttestBF on sleep: 17.25888; Rouder et al. 2009: t = 2.03, N = 80, r = 1."""
    found = bayes_paired(DRUG_1, DRUG_2)
    assert 1 / found.bayes_factor_01 == pytest.approx(17.25888, abs=1e-4)
    assert math.exp(log_bayes_factor_01(2.03, 80, 1.0)) == pytest.approx(1.56, abs=0.005)
    # Any strength of evidence has a logarithm: t of 1e6 and more, by mpmath.
    assert log_bayes_factor_01(1e6, 4) == pytest.approx(-25.960043884374, rel=1e-8)
    assert log_bayes_factor_01(1e9, 200) == pytest.approx(-3575.9579847773, rel=1e-8)
    # With a flat prior the interval is Student's.
    assert (found.low, found.high) == pytest.approx((-2.459886, -0.7001142))
    assert found.probability_positive == pytest.approx(0.002833 / 2, abs=1e-6)
    assert bayes_paired([1, 1.0001, 1.0002, 1.0003]).bayes_factor_01 > 0


def test_kappa():
    """The textbook's 20, 5, 10, 15: 0.7 observed, 0.5 by chance, kappa 0.4."""
    one = ["yes"] * 25 + ["no"] * 25
    found = cohens_kappa(one, ["yes"] * 20 + ["no"] * 5 + ["yes"] * 10 + ["no"] * 15)
    assert (found.observed, found.kappa) == pytest.approx((0.7, 0.4))
    assert found.low < 0.4 < found.high
    # Fleiss, Cohen and Everitt by hand: se 0.1270.
    assert (found.low, found.high) == pytest.approx((0.4 - 0.2489, 0.4 + 0.2489), abs=5e-4)
    assert cohens_kappa(one, one).kappa == 1
    # Three items on which all agree prove little: Wilson's low end of 3 of 3, n / (n + z^2), 5/9 by
    # chance.
    few = cohens_kappa(["yes", "no", "no"], ["yes", "no", "no"])
    share = 3 / (3 + 1.959964**2)
    assert (few.kappa, few.high) == (1, 1)
    assert few.low == pytest.approx((share - 5 / 9) / (4 / 9), abs=1e-6)
    assert found.table == ((15, 10), (5, 20))


# -- refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: signed_rank([1.0, 2], [1.0, 2]), "All differences are 0"),
        (lambda: signed_rank([1.0, 2], [1.0]), "2 people in one condition and 1"),
        (lambda: signed_rank([1.0, math.nan]), "1 of 2 are missing"),
        (lambda: standardised_difference([1.0, 1.0]), "no standard deviation"),
        (lambda: standardised_difference([1.0]), "at least 2"),
        (lambda: holm([0.1, 1.2]), "probabilities"),
        (lambda: crossover([1.0, 2], [1.0, 2], ["S", "E"], ("S", "E")), "at least 2 in each"),
        (lambda: crossover([1.0], [1.0], ["X"], ("S", "E")), "First treatments X"),
        (lambda: crossover([1.0, 2], [1.0], ["S", "E"], ("S", "E")), "same order"),
        (lambda: mixed_model([1.0] * 4, ["a"], ["S"] * 4, [1] * 4, ("S", "E")), "lengths"),
        (
            lambda: mixed_model(
                [1.0, 2.0, 2.0, 1.0], ["a", "b"] * 2, ["S", "E", "E", "S"], [1, 1, 2, 2], ("S", "E")
            ),
            "tell treatment and period apart",
        ),
        (lambda: mixed_model([1.0] * 4, "abab", "SSXX", [1, 1, 2, 2], ("S", "E")), "period X"),
        (lambda: mixed_model([1.0] * 4, "abab", "SSEE", [1, 1, 2, 3], ("S", "E")), "period 3"),
        (lambda: mixed_model([1.0] * 4, "aaab", "SSEE", [1, 1, 2, 2], ("S", "E")), "Average them"),
        (
            lambda: mixed_model(
                [1, 2, 3, 4, 2, 3, 4, 5], "abcd" * 2, "SSEEEESS", [1] * 4 + [2] * 4, ("S", "E")
            ),
            "no standard errors",
        ),
        (lambda: cohens_kappa(["a"], ["a", "b"]), "1 items of one coder, 2"),
        (lambda: cohens_kappa(["a", "a"], ["a", "a"]), "one code only"),
        (lambda: paired_t_power(10, math.nan), "d_z = nan"),
        (lambda: standardised_difference([1e200, 2.0]), "larger unit"),
        (lambda: effect_from_p(0.0, 10), "more than 0"),
        (lambda: power_statement(10, -1.0), "standard deviation of -1"),
    ],
)
def test_refusals(call, words):
    with pytest.raises(NoStatisticError, match=words):
        call()
