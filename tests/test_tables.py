"""What the tables of an identification say, and a family's terms: every line typed by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.identify.drive.encoder_table import EncoderTable
from esea_gen.identify.drive.friction import Friction
from esea_gen.identify.drive.regression import Estimate
from esea_gen.identify.family.compare import CompareRow, ModelComparison
from esea_gen.identify.next_experiment import Advice, CommandedMotion
from esea_gen.identify.reliability import Coefficient, PairAgreement, Reliability
from esea_gen.identify.specimens import JointFit
from esea_gen.model.family import Rise, Softening, Term

ENCODER = EncoderTable(
    side="motor",
    direction=-1,
    values=(Estimate(0.02, 0.01, 0.04), None, Estimate(-0.03, -0.05, -0.007)),
    zero_rad=0.3,
    play_rad=None,
    before_rad=0.5,
    after_rad=0.004,
    samples=640,
)


def test_an_encoders_table_is_in_degrees_of_a_turn():
    assert ENCODER.table() == [
        "  at deg   add deg           95 % interval",
        "    0.00    1.1459        0.5730 to 2.2918",
        "  120.00                       never there",
        "  240.00   -1.7189      -2.8648 to -0.4011",
        "effective error of the angle: 28.6479 deg without the table, 0.2292 with it; 640 samples",
    ]


def test_a_play_is_told_before_what_the_table_mends():
    lines = replace(ENCODER, play_rad=Estimate(0.1, 0.05, 0.25)).table()
    assert len(lines) == 6
    assert lines[4] == "play between the two: 5.7296 deg (95 %: 2.8648 to 14.3239)"
    assert lines[5].startswith("effective error of the angle: 28.6479 deg")


COMPARED = ModelComparison(
    source=SimpleNamespace(mapping=SimpleNamespace(device=SimpleNamespace(title="Knee"))),
    full_scale_Nm=12.5,
    rows=(
        CompareRow("published", "slow", 1.234, 2.346, None),
        CompareRow("published", "fast and loaded up", 0.517, 10.128, None),
        CompareRow("lin", "slow", 3.001, 4.009, 812.6),
        CompareRow("lin", "fast and loaded up", 5.551, 6.667, 99.0),
    ),
    chosen="lin",
    best="published",
    standard_error=0.126,
    devices={},
    notes=("warm", "few"),
)


def test_models_are_compared_held_out_before_training_and_the_chosen_one_is_marked():
    assert COMPARED.table() == [
        "Knee: held out / training, RMS in % of full scale (12.5 Nm)",
        "                           slow  fast and loaded up  instructions",
        "  published         2.35 / 1.23        10.13 / 0.52             -",
        "* lin               4.01 / 3.00         6.67 / 5.55           813",
        "* chosen: the cheapest that is as good as the best (published) within one standard error "
        "of the difference (0.13 %)",
        "note: warm",
        "note: few",
    ]


def test_the_best_is_chosen_where_no_cheaper_one_is_as_good():
    rows = tuple(replace(r, condition="slow") for r in COMPARED.rows[::2])
    best = replace(COMPARED, rows=rows, chosen="published", notes=())
    assert best.table()[1:] == [
        "                       slow  instructions",
        "* published     2.35 / 1.23             -",
        "  lin           4.01 / 3.00           813",
        "* chosen: the best; no cheaper one is as good within one standard error",
    ]


AGREEMENT = Reliability(
    specimens=("A", "B", "C"),
    rows=7,
    absolute=Coefficient(0.91234, 0.81239, 0.97771),
    consistent=Coefficient(0.95551, 0.90124, 0.98886),
    agreements=(
        PairAgreement("A", "B", -0.01236, -0.08711, 0.06243, 0.01192),
        PairAgreement("A", "C", 0.2, 0.10004, 0.30006, 0.02),
    ),
    apart_pct={"A": 1.234, "Bee": 12.346},
)
AGREEMENT_LINES = [
    "3 specimens at 7 conditions",
    "ICC(2,1), absolute agreement   0.9123, 95 % 0.8124 to 0.9777",
    "ICC(3,1), consistency          0.9555, 95 % 0.9012 to 0.9889",
    "limits of agreement, Nm (each limit +- its 95 % error)",
    "A - B                          -0.0124, -0.0871 to +0.0624 (+-0.0119)",
    "A - C                          +0.2000, +0.1000 to +0.3001 (+-0.0200)",
    "each against the mean of the others, RMS in % of the largest torque",
    "A                              1.23",
    "Bee                            12.35",
    "thesis, one model on other elastomers: RMS 2.93 % (worst of two), 3.30 to 3.72 %",
    "The intervals take conditions for independent: samples of one loop are not. Give one row a "
    "condition, not a whole recording.",
]


def test_agreement_is_told_with_its_intervals_pair_by_pair_and_one_by_one():
    assert AGREEMENT.table() == AGREEMENT_LINES


def test_one_model_for_all_stands_before_each_specimens_own():
    fits = JointFit("Knee", 12.5, {"A": 3.217, "Bee": 4.5}, {"Bee": 1.006, "A": 2.118}, AGREEMENT)
    assert fits.table() == [
        "Knee: held out, RMS in % of full scale (12.5 Nm)",
        "specimen                       one model for all   its own",
        "A                                           3.22      2.12",
        "Bee                                         4.50      1.01",
        *AGREEMENT_LINES,
    ]


FRICTION = Friction(
    load_Nm=Estimate(-0.0012346, -0.0021, 0.00034),
    fc_Nm=Estimate(0.5, 0.25, 0.75),
    fs_Nm=Estimate(0.125, 0.0625, 0.25),
    vs_rad_s=Estimate(8.0, 6.0, 12.0),
    fv_Nms_rad=Estimate(0.01, 0.005, 0.02),
    left_Nm=0.00246,
    moved_Nm=0.2,
    runs=14,
    used=2800,
    outside=37,
)


def test_friction_is_told_at_the_motor_shaft():
    assert FRICTION.table() == [
        "14 runs, 2800 samples; 37 far from their run's median left out",
        "load, one way: -0.001235 Nm (95 %: -0.0021 to 0.00034)",
        "Coulomb friction: 0.5 Nm (95 %: 0.25 to 0.75)",
        "Stribeck's rise towards rest: 0.125 Nm (95 %: 0.0625 to 0.25)",
        "speed over which it fades: 8 rad/s (95 %: 6 to 12)",
        "viscous friction: 0.01 Nms/rad (95 %: 0.005 to 0.02)",
        "left over: 0.00246 Nm effective, 1.23 % of the torque's",
    ]


def test_a_rise_that_is_not_seen_is_said_to_be_none():
    lines = replace(FRICTION, fs_Nm=None, vs_rad_s=None).table()
    assert lines[2:6] == [
        "Coulomb friction: 0.5 Nm (95 %: 0.25 to 0.75)",
        "Stribeck's rise towards rest: none seen: its 95 % interval holds 0",
        "speed over which it fades: none seen: its 95 % interval holds 0",
        "viscous friction: 0.01 Nms/rad (95 %: 0.005 to 0.02)",
    ]


def test_behind_a_gear_of_4_torques_are_4_times_speeds_a_quarter_damping_16_times():
    dry = {"fc_Nm": Estimate(2.0, 1.0, 3.0), "fv_Nms_rad": Estimate(0.16, 0.08, 0.32)}
    assert FRICTION.at_joint(4.0) == dry | {
        "stribeck_Nm": Estimate(0.5, 0.25, 1.0),
        "stribeck_rad_s": Estimate(2.0, 1.5, 3.0),
    }
    assert replace(FRICTION, fs_Nm=None, vs_rad_s=None).at_joint(4.0) == dry


FOUR = CommandedMotion("cycles", 0.15, 0.2, 9.0, 25.0)
SWEEP = CommandedMotion("sweep", 0.1, 0.05, 1.5, 65.0)


@pytest.mark.parametrize(
    ("motion", "said"),
    [
        (FOUR, "rest 5 s, then 4 cycles of a sine of 8.6 deg at 0.2 Hz"),
        (
            CommandedMotion("cycles", 0.05, 0.01, 0.01, 105.0),
            "rest 5 s, then 1 cycle of a sine of 2.9 deg at 0.01 Hz",
        ),
        (SWEEP, "rest 5 s, then a sine of 5.7 deg, from 0.05 to 1.5 Hz in 60 s"),
    ],
)
def test_a_motion_says_what_to_do(motion, said):
    assert motion.text == said


def test_a_hold_goes_to_one_side_and_then_the_other():
    motion = CommandedMotion("hold", 0.2, 0.0, 0.0, 125.0)
    there = "rest 5 s, then go to 11.5 deg in 0.5 s and hold 59 s; the same to the other side"
    assert motion.text == there
    # As its deflection does: in 100 samples a second.
    t, theta = motion.deflection()
    for side in (0.2, -0.2):
        held = t[np.isclose(theta, side)]
        assert held[-1] - held[0] == pytest.approx(59.0)


def test_advice_counts_its_motions_and_their_minutes():
    advice = Advice(
        "Knee",
        ((3, FOUR), (1, SWEEP)),
        {"k_Nm_rad": 0.12345, "c": 12.0},
        {"c": 3.456, "k_Nm_rad": 0.0456},
        ("inside the domain", "record the time"),
    )
    assert advice.table() == [
        "Knee: what to record next, 2.3 min",
        "  1. 3 times: rest 5 s, then 4 cycles of a sine of 8.6 deg at 0.2 Hz",
        "  2. rest 5 s, then a sine of 5.7 deg, from 0.05 to 1.5 Hz in 60 s",
        "expected standard deviations, of this recording and with these motions",
        "  k_Nm_rad            0.123     0.0456",
        "  c                      12       3.46",
        "note: inside the domain",
        "note: record the time",
    ]


@pytest.mark.parametrize(
    ("rise", "said"),
    [
        (Rise("power", 1), "x"),
        (Rise("power", 3), "x^3"),
        (Rise("power", 5, "positive"), "x^5, positive side"),
        (Rise("power", 1, "negative"), "x, negative side"),
        (Rise("bend", 0.25), "x/(1+|x|/0.25)"),
        (Rise("bend", 1, "negative"), "x/(1+|x|/1), negative side"),
    ],
)
def test_a_rise_is_a_formula_and_its_side(rise, said):
    assert rise.text == said


def test_a_softening_is_a_formula_of_the_largest_strain_or_the_path():
    assert Softening("strain", 0.35).text == "1/(1+m/0.35)"
    assert Softening("path", 12.5).text == "exp(-s/12.5)"


@pytest.mark.parametrize(
    ("term", "said"),
    [
        (Term("offset"), "offset"),
        (Term("spring", Rise("power", 3)), "spring of x^3"),
        (Term("stop", numbers=(0.123456,)), "stop of x, threshold 0.1235"),
        (
            Term("slip", Rise("bend", 0.4, "positive"), (2.0,), 0.0, Softening("path", 7)),
            "slip of x/(1+|x|/0.4), positive side, path 2, times exp(-s/7)",
        ),
        (
            Term("maxwell", numbers=(0.1, 2.5, 30.0), exponent=0.2),
            "maxwell of x, time, s 0.1 2.5 30, shares T^-0.2",
        ),
        (
            Term("maxwell", Rise("power", 5), (4.0,), 0.3, Softening("strain", 0.6)),
            "maxwell of x^5, time, s 4, shares T^-0.3, times 1/(1+m/0.6)",
        ),
    ],
)
def test_a_term_says_its_operator_its_numbers_and_its_softening(term, said):
    assert term.text == said
