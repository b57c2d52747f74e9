"""What a refitted inverse tells its reader: every note where it applies, with its numbers."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from esea_gen.identify.inverse import InverseFit, _notes
from esea_gen.identify.plays import play_bounds

LOW, HIGH = -6.0, -2.0  # logarithm of chi
PHI = play_bounds("phi_1_rad")


def errors(trained, held_out):
    return SimpleNamespace(mean_rms=lambda which: held_out if which else trained)


def told(
    sigma=0.01,
    value=1.0,
    correlation=None,
    reach=(10.0, 10.0),
    x=-4.0,
    ours=(0.01, 0.01),
    published=(0.02, 0.02),
):
    return _notes(
        {"kappa_rad": value},
        {"kappa_rad": sigma},
        correlation or {},
        reach,
        ([PHI[0], LOW], [PHI[1], HIGH]),
        [10.0, x],
        errors(*ours),
        errors(*published),
    )


def test_a_sound_fit_is_told_in_one_line_how_the_filter_is_chosen():
    (only,) = told()
    assert "rate neglected as published" in only
    assert "inverse.filter" in only


@pytest.mark.parametrize(
    ("x", "words"),
    [
        (LOW, "as small as allowed"),
        (LOW + 3.99e-3, "as small as allowed"),
        (LOW + 4.01e-3, None),
        (HIGH - 4.01e-3, None),
        (HIGH - 3.99e-3, "as large as the recorded range"),
    ],
)
def test_thresholds_within_a_thousandth_of_an_end(x, words):
    first, *rest = told(x=x)
    assert (words in first if words else rest == []) is True


@pytest.mark.parametrize(("sigma", "said"), [(0.49, False), (0.51, True), (None, False)])
def test_a_number_that_is_poorly_known_or_at_its_bound(sigma, said):
    for value, s in ((1.0, sigma), (0.1, sigma and 0.1 * sigma)):
        notes = told(sigma=s, value=value)
        assert any("poorly determined" in n for n in notes) == said
        if said:
            assert f"(standard deviation {s:.2g})" in notes[0]
    ends = play_bounds("kappa_rad")
    for value, name in zip(ends, ("lower", "upper"), strict=True):
        assert f"at its {name} bound" in told(value=value, sigma=9 * value)[0]


def test_a_wide_range_of_phi_and_numbers_that_go_together():
    half = 0.5 * (PHI[1] - PHI[0])
    assert len(told(reach=(10.0, 10.0 + 0.99 * half))) == 1
    first, _ = told(reach=(10.0, 10.0 + 1.01 * half))
    assert "phi is not identifiable" in first
    assert "less than 1 %" in first
    assert len(told(correlation={"kappa_rad chi_rad": 0.94})) == 1
    for c in (0.96, -0.96):
        first, _ = told(correlation={"kappa_rad chi_rad": c})
        assert f"kappa_rad and chi_rad are correlated by {c:+.3f}" in first


def test_held_out_cycles_against_table_4_2_and_against_training():
    first, _ = told(ours=(0.03, 0.03), published=(0.02, 0.029))
    assert "table 4.2 does better (0.029 rad) than the refit (0.03 rad)" in first
    assert len(told(ours=(0.03, 0.03), published=(0.02, 0.031))) == 1
    first, _ = told(ours=(0.01, 0.0151))
    assert "held out 0.0151 rad against 0.01 rad in training" in first
    assert len(told(ours=(0.01, 0.0149))) == 1
    # Without held-out cycles neither can be said.
    nothing = float("nan")
    assert len(told(ours=(0.01, nothing), published=(0.01, nothing))) == 1


def test_a_refitted_inverse_line_by_line():
    def means(training, held_out):
        def of(full_scale):
            assert full_scale == 0.25
            return {"training_percent": training, "held_out_percent": held_out}

        return SimpleNamespace(means=of)

    domain = SimpleNamespace(theta_max_rad=SimpleNamespace(value=0.25))
    fit = InverseFit(
        device=SimpleNamespace(file=SimpleNamespace(domain=domain)),
        values={"kappa_rad": 0.1234567, "phi_1_rad": PHI[1], "chi_rad": 0.0025},
        sigma={"kappa_rad": 0.01234, "phi_1_rad": None, "chi_rad": None},
        correlation={},
        phi_range_1_rad=(1.0, 2.0),
        sets=means(1.234, 12.5),
        published=means(3.0, None),
        seed=1,
        population=64,
        evaluations=7,
        runner_up=1.0,
        notes=("one", "two"),
    )
    assert fit.summary() == [
        "inverse, play operators refitted (table 4.2 in brackets):",
        "  kappa_rad  0.12346 (0.106), standard deviation 0.012",
        f"  phi_1_rad  {PHI[1]:.5g} (4.84), at its upper bound",
        "  chi_rad    0.0025 (0.00233), not determined",
        "  refitted   training  1.23 %, held out 12.50 % of the largest deflection, RMS",
        "  table 4.2  training  3.00 % of the largest deflection, RMS",
        "note: one",
        "note: two",
    ]
