"""What the tables of analyses, fixed point and faults say: every line typed by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.analysis.frequency import FrequencyResponse
from esea_gen.analysis.gain_region import GainRegion
from esea_gen.analysis.impedance import ImpedanceFit, OutputImpedance
from esea_gen.analysis.journal import Configuration, Result
from esea_gen.analysis.monte_carlo import MonteCarlo, Percentiles
from esea_gen.analysis.passivity import Hand, PassivityMap
from esea_gen.analysis.step import StepMetrics
from esea_gen.emit.error_bounds import Bound
from esea_gen.emit.fixed.report import EXPLODED, BlockRanges, RangeReport
from esea_gen.emit.fixed.table import RangeRow
from esea_gen.language.ports import Flag, Port
from esea_gen.verify.bare import BareResult
from esea_gen.verify.chain import ChainError, ChainReport
from esea_gen.verify.faults.bounds import LimbEnvelope
from esea_gen.verify.faults.campaign import FaultCampaign, FaultRun
from esea_gen.verify.faults.emulated import EmulatedFault
from esea_gen.verify.fixed_report import BlockResult, FixedReport, SignalResult
from esea_gen.verify.proof import EvaResult
from esea_gen.verify.traces import Trace

PLAN = SimpleNamespace(
    block=SimpleNamespace(
        outputs=(
            Port("y_Nm", -2.0, 1.0, "Torque."),
            Port("status", -1.0, 8.0, "Bits.", flags=(Flag("LOW", "Low."),)),
            Port("part", -0.5, 4.0, "Share."),
        )
    )
)
RANGES = (
    RangeRow("x_rad", "input", -0.5, 0.25, 32, 30, 2.0, -(2**29), 2**28, "rad"),
    RangeRow("sum_q40", "value", -2.0, 3.0, 64, 40, 20.5, -(2**41), 3 * 2**40, why="is a root"),
    RangeRow("low_q10", "value", 0.125, 5.0, 32, 10, 18.7, 128, 5120, note="7 bits coarser"),
    RangeRow("share", "output", -1.5, 1.0, 32, 29, 1.4, -805306368, 536870912),
)
KEPT = BlockRanges(
    "sensor",
    PLAN,
    RANGES,
    Bound("q31", math.inf, {"y_Nm": 1.5e-4, "part": 2e-3}, {}, "linear", ("a <= b", "c < d")),
    "",
)
KEPT_LINES = [
    "sensor",
    "          kind         format                raw range                     range"
    "  one unit bits  room",
    "  x_rad   input         Q1.30  -536870912 to 268435456          -0.5 to 0.25 rad"
    "  9.31e-10   32   2.0",
    "  sum_q40 value        Q23.40      -2.2e+12 to 3.3e+12                   -2 to 3"
    "  9.09e-13   64  20.5  is a root",
    "  low_q10 value        Q21.10              128 to 5120                0.125 to 5"
    "  9.77e-04   32  18.7  7 bits coarser",
    "  share   output        Q2.29  -805306368 to 536870912                 -1.5 to 1"
    "  1.86e-09   32   1.4",
    "  proven error for any number of steps (linear):",
    "    y_Nm: 1.50e-04 Nm, 0.0075 % of its range",
    "    part: 2.00e-03, 0.05 % of its range",
    "    taken as equal: a <= b",
    "    taken as equal: c < d",
]


def test_a_block_says_its_ranges_formats_and_proven_error():
    assert KEPT.lines() == KEPT_LINES
    one = Bound("q31", 1, {"y_Nm": 0.02, "part": 0.0}, {}, "one step", ())
    assert replace(KEPT, bound=one, refusal="no more").lines() == [
        "sensor",
        "  no more",
        *KEPT_LINES[1:6],
        "  proven error of one step (one step):",
        "    y_Nm: 2.00e-02 Nm, 1 % of its range",
        "    part: 0.00e+00, 0 % of its range",
    ]
    assert replace(KEPT, bound=None).lines() == KEPT_LINES[:6]


def test_a_report_ends_with_what_to_look_at_first():
    one = Bound("q31", 1, {"y_Nm": 0.02, "part": 0.0}, {}, "one step", ())
    wide = tuple(replace(RANGES[1], name=f"w{k}_q40", why=f"why {k}") for k in range(5))
    adds = BlockRanges("adds", PLAN, wide, one, "")
    lost = BlockRanges("lost", None, (), None, "holds zero")
    lines = RangeReport("elbow", (KEPT, lost, adds), ("loops", "more")).table()
    assert lines[: len(KEPT_LINES) + 4] == [*KEPT_LINES, "", "lost", "  holds zero", ""]
    assert lines[lines.index("    part: 0.00e+00, 0 % of its range") + 1 :] == [
        "",
        "not covered, a program of loops: loops, more",
        "cannot be lowered: lost",
        "does not forget its errors, bound of one step: adds",
        "to look at first:",
        "  sensor, sum_q40: 64 bits: is a root",
        "  sensor, low_q10: 7 bits coarser",
        "  adds, w0_q40: 64 bits: why 0",
        "  adds, w1_q40: 64 bits: why 1",
        "  adds, w2_q40: 64 bits: why 2",
        "  adds, w3_q40: 64 bits: why 3",
        "  adds: and 1 more, marked above",
        "",
        *EXPLODED,
    ]
    four = RangeReport("elbow", (replace(adds, rows=wide[:4]),)).table()
    assert four[-len(EXPLODED) - 2] == "  adds, w3_q40: 64 bits: why 3"
    quiet = RangeReport("elbow", (replace(KEPT, rows=RANGES[::3], bound=None),)).table()
    assert quiet[-1] == ""
    assert len(quiet) == 5
    assert RangeReport("elbow", (lost,)).table() == [
        "lost",
        "  holds zero",
        "",
        "cannot be lowered: lost",
        "",
        *EXPLODED,
    ]


CHAIN = ChainReport(
    "elbow",
    25.0,
    60,
    (
        ChainError("f32", 0.0123, 0.0031, (0.1,), (0.2,), 0),
        ChainError("q31", 0.25, 0.06, (0.1,), (0.2,), 14),
    ),
)
CHAIN_LINES = [
    "sensing task against f64, worst of 60 searched motions (reach and rest); searched, not "
    "proven; aims 0.05 %, RMS 0.02 %",
    "f32      0.012 Nm, 0.049 % of full scale; RMS 0.012 %; encoders ideal",
    "q31       0.25 Nm, 1 % of full scale; RMS 0.24 %; encoders 14 bit",
]


def test_the_worst_motion_is_told_in_newton_metres_and_of_full_scale():
    assert CHAIN.table() == CHAIN_LINES


CORE = BareResult(
    *("an500", "m4f", "q31", "sense", 200, True, ""),
    {"min": 700.0, "mean": 811.6, "max": 1204.3},
    5120,
    96,
    248,
)


def test_fixed_point_is_told_by_block_signal_core_and_proof():
    report = FixedReport(
        "elbow",
        [
            BlockResult("sensor", "ever", 0.000123, 0.0000456, 12, 0, []),
            BlockResult("inverse", "one step", 0.023, 0.0089, 0, 3, ["bits", "above", "third"]),
        ],
        [SignalResult("a chirp", 60000, 0.1, 0.00034, 0.00012)],
        [CORE, replace(CORE, core="m7", real="f64", identical=False, first_difference="tau at 7")],
        [
            EvaResult("elbow", "sensor", (), (), ("gain 1 to 2", "n 0 to 9"), 431, 7),
            EvaResult("elbow", "inverse", ("overflow",), ("low", "high"), (), 88, 5),
        ],
        CHAIN,
    )
    assert report.table() == [
        "elbow in q31, shares of the ports' ranges",
        "block               proven       for  measured  64 bit  bits",
        "sensor              0.012%      ever   0.0046%      12  equal",
        "inverse               2.3%  one step     0.89%       0  bits; above",
        "torque against f64, of full scale (aim 0.05 %)",
        "a chirp                                          60000 steps     0.034%, "
        "last minute 0.012%",
        *CHAIN_LINES,
        "instructions a step (not cycles), bytes",
        "core         format     mean  largest   flash    RAM  stack  bits",
        "m4f             q31      812     1204    5120     96    248  equal",
        "m7              f64      812     1204    5120     96    248  tau at 7",
        "value analysis under any bit pattern of inputs and states",
        "sensor           no alarm, 431 statements, 2 assumed ranges",
        "    gain 1 to 2",
        "    n 0 to 9",
        "inverse          overflow; low, 88 statements, 0 assumed ranges",
    ]
    assert FixedReport("elbow", report.blocks[:1]).table() == report.table()[:3]


STUCK = FaultRun(
    *("encoder load", "stuck high", 1.5, "reach", 900, 3),
    *(True, 5, 4, 6, 1.26, 2.37, 0.126, True),
)
RUNS = (
    STUCK,
    replace(
        STUCK, bound_ticks=7, found_ticks=6, torque_then_Nm=0.84, peak_torque_Nm=3.58, inside=False
    ),
    FaultRun(
        *("memory.sensor.state[2]", "bit", 0.25, "hold", 950, 11),
        *(False, None, None, 0, 0.52, 4.44, 0.234, True),
    ),
    FaultRun(
        *("memory.sensor.rate", "bit", 0.25, "hold", 950, 11),
        *(True, 9, 12, 2, 2.19, 5.57, 16.66, False),
    ),
    replace(STUCK, input="current", kind="drift", bound_ticks=None, found_ticks=20),
    replace(STUCK, input="current", kind="drift", bound_ticks=None, found_ticks=17),
)
CAMPAIGN = FaultCampaign("elbow_drive", "hash", LimbEnvelope(8.0, 13.2, 15.5), RUNS)
CAMPAIGN_LINES = [
    "| where | what | runs | found | bound, ticks | latest | until then, Nm | peak, Nm | energy, J "
    "| not found: peak, Nm | energy, J |",
    "|---|---|---|---|---|---|---|---|---|---|---|",
    "| encoder load | stuck high | 2 | 2 | 7 | 6 | 1.3 | 3.6 | 0.13 | – | – |",
    "| memory of sensor | bit | 2 | 1 | – | 12 | 2.2 | 5.6 | 16.66 | 4.4 | 0.23 |",
    "| current | drift | 2 | 2 | – | 20 | 1.3 | 2.4 | 0.13 | – | – |",
    "elbow_drive, simulated: 6 faults, 5 found; 3 with a stated bound.",
    "Envelope 8 Nm until the motor is off, 13.2 Nm after, 15.5 J; largest 2.2 Nm, 5.6 Nm, 16.7 J.",
    "OUTSIDE: encoder load stuck high 1.5, reach, seed 3, tick 900: found after 6 ticks, bound 7, "
    "3.6 Nm, 0.1 J",
    "OUTSIDE: memory.sensor.rate bit 0.25, hold, seed 11, tick 950: found after 12 ticks, "
    "bound 9, 5.6 Nm, 16.7 J",
    "2 outside.",
]


def test_a_campaign_says_by_place_what_was_found_and_run_by_run_what_was_outside():
    assert CAMPAIGN.table() == CAMPAIGN_LINES
    lost = replace(CAMPAIGN, runs=(replace(RUNS[2], inside=False),)).table()
    assert lost[-2] == (
        "OUTSIDE: memory.sensor.state[2] bit 0.25, hold, seed 11, tick 950: not found, 4.4 Nm, "
        "0.2 J"
    )
    inside = replace(CAMPAIGN, runs=RUNS[:1]).table()
    assert inside[2:] == [
        "| encoder load | stuck high | 1 | 1 | 5 | 4 | 1.3 | 2.4 | 0.13 | – | – |",
        "elbow_drive, simulated: 1 faults, 1 found; 1 with a stated bound.",
        "Envelope 8 Nm until the motor is off, 13.2 Nm after, 15.5 J; largest 1.3 Nm, 2.4 Nm, "
        "0.1 J.",
        "0 outside.",
    ]


def test_a_campaign_says_which_runs_differ_in_the_emulator():
    same = EmulatedFault("current", "stuck", "reach", 1200, 904, 6, 6, None)
    other = EmulatedFault("encoder load", "drift", "hold", 800, 901, 6, 2, 77)
    reason = replace(other, first_difference=None)
    assert replace(CAMPAIGN, emulated=(reason,)).table()[-1] == (
        "DIFFERS in the emulator: encoder load drift, hold: motor command the same, fault 2 for 6"
    )
    assert replace(CAMPAIGN, emulated=(same, other, same)).table() == [
        *CAMPAIGN_LINES,
        "In the emulator: 2 of 3 runs (3200 ticks) with the same motor command in every bit of "
        "every tick, and the same fault.",
        "DIFFERS in the emulator: encoder load drift, hold: motor command from tick 77, fault 2 "
        "for 6",
    ]


def test_a_trace_is_text_with_its_tick_above():
    trace = Trace(
        "elbow",
        1 / 3000,
        np.array([19, 39]),
        {"x_rad": np.array([-0.0, 2 / 3])},
        {"word": np.array([5.0, 0.0]), "y_Nm": np.array([-1.5, 123456.78901])},
        {"word": ("A", "B", "C")},
        {"y_Nm": 4.0},
    )
    assert trace.text() == (
        "# esea-gen trace: elbow, a tick of 0.000333333333 s, every 20th step.  A status word has "
        "all bits set since the row above.\n"
        "step,x_rad,word,y_Nm\n"
        "19,0,5,-1.5\n"
        "39,0.6666666667,0,123456.789\n"
    )


RESPONSE = FrequencyResponse(
    np.array([1.0, 10.0, 100.0, 500.0]), np.array([2, -0.5j, -1, 0.1j]), None, None, "by hand"
)


def test_a_driving_point_is_fitted_in_the_band_that_is_asked_for(monkeypatch):
    def fit(self, low_Hz, high_Hz):
        return ImpedanceFit(0.01234, -0.25, 3.5, 0.00045, 0.0067, 0.089, low_Hz, high_Hz, 0.236)

    monkeypatch.setattr(OutputImpedance, "fit", fit)
    assert OutputImpedance(RESPONSE).table(3, 1.25, 40.0) == [
        "by hand",
        "        Hz   gain dB  phase deg  coherence",
        "         1      6.02        0.0",
        "        10     -6.02      -90.0",
        "       500    -20.00     -270.0",
        "fit from 1.25 to 40 Hz, torque that the moving needs:",
        "inertia 0.01234 +- 0.00045 kg m2",
        "damping -0.25 +- 0.0067 Nms/rad",
        "stiffness 3.5 +- 0.089 Nm/rad",
        "relative misfit 0.24, above 0.2: not one mass, damper and spring",
    ]


def test_a_step_that_is_stable_says_how_good():
    found = StepMetrics(
        *("stable", "settles", 0.1, 1.1, 0.012346, None, 0.0456),
        *(4.25, 0.037, -3.7, 0.00123, 17.0),
    )
    assert found.table() == [
        "stable: settles",
        "  rise, 10 to 90 %    0.01235 s",
        "  settling, 2 %       none within the record",
        "  settling, 5 %       0.0456 s",
        "  overshoot           4.25 %",
        "  steady error        -3.7 % of the step",
        "  tail RMS            0.00123",
    ]
    assert replace(found, settling_2_s=0.25).table()[2] == "  settling, 2 %       0.25 s"
    assert replace(found, verdict="growing", reason="more").table() == ["growing: more"]


def ends(*values: float) -> dict[float, float]:
    return dict(zip((5.0, 25.0, 50.0, 75.0, 95.0), values, strict=True))


RMS = Percentiles(
    *("rms_Nm", 2, 1, ends(0.11, 0.22, 0.33, 0.44, 0.55)),
    *(ends(0.1, 0.2, 0.3, 0.4, 0.51), ends(0.12, 0.23, 0.34, 0.45, 0.666666), 0.777777),
)


def test_many_cases_are_told_by_percentiles_failures_first(monkeypatch):
    monkeypatch.setattr(MonteCarlo, "summary", lambda self: {"rms_Nm": RMS})
    good = [Result({"seed": k}, {"rms_Nm": 0.5}) for k in range(2)]
    lost = [Result({"seed": k, "load": 2.5}, None, f"tripped {k}") for k in range(12)]
    heads = [
        " " * 28 + "       5 %      25 %      50 %      75 %      95 %         95 % interval"
        "       max",
        "rms_Nm                            0.11      0.22      0.33      0.44      0.55"
        "        0.51 .. 0.6667    0.7778",
    ]

    def told(count: int) -> list[str]:
        return MonteCarlo(Configuration({}), (*lost[:count], *good)).table()

    assert told(0) == ["2 cases, 0 failed", *heads]
    failed = [f'  FAILED {{"load":2.5,"seed":{k}}}: tripped {k}' for k in range(10)]
    assert told(1) == ["3 cases, 1 failed", failed[0], *heads]
    assert told(10) == ["12 cases, 10 failed", *failed, *heads]
    assert told(12) == ["14 cases, 12 failed", *failed, "  ... 2 more", *heads]


KP, KD = np.array([10.0, 250.2]), np.array([0.05, 1.5, 12.0])
LEGEND = [
    "P passive, s stable with every hand, . unstable with one",
    "   Kp | Kd    0.05     1.5      12",
]


def test_a_map_of_energies_is_in_letters_a_line_a_stiffness():
    index, diverging = np.zeros((2, 3, 2)), np.zeros((2, 3, 2), dtype=bool)
    index[0, 0] = 0.01, -0.3
    index[0, 1] = index[1, 2] = 0.0, 0.011
    diverging[0, 2, 1] = diverging[1, 0, 0] = True
    hands = (Hand("free"), Hand("heavy", 0.3))
    assert PassivityMap(KP, KD, hands, index, index, diverging, 0.01).table() == [
        *LEGEND,
        "        10       P       s       .",
        "       250       .       P       s",
    ]


@pytest.mark.parametrize("unstable", [True, False])
def test_a_map_of_loops_names_the_hand_that_is_worst_most_often(unstable):
    radius = np.full((2, 3, 3), 0.5)
    radius[:, :, 0] = 0.75
    if unstable:
        radius[0, 2] = 0.5, 1.0, 0.9
        radius[1, 0] = 1.25, 1.5, 1.75
        radius[1, 1] = 0.5, 0.5, 1.5
    passive = np.array([[True, False, False], [False, False, True]])
    hands = (Hand("free"), Hand("heavy", 0.3), Hand("stiff", 0.0, 0.0, 90.0))
    told = GainRegion(KP, KD, hands, radius, passive, radius[:, :, 1], radius[:, :, 2]).table()
    if unstable:
        assert told == [
            *LEGEND,
            "        10       P       s       .",
            "       250       .       .       P",
            "unstable first with: stiff",
        ]
    else:
        assert told == [
            *LEGEND,
            "        10       P       s       s",
            "       250       s       s       P",
        ]
