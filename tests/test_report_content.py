"""What the page of a measuring device says, of small findings: each number worked out by hand."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace as Of

import numpy as np
import pytest

from esea_gen.emit.error_bounds import Bound
from esea_gen.report import common, figures, sensing
from esea_gen.report.board import BoardRun

from .made_findings import (
    COMPARISONS,
    a_device,
    a_mapping,
    a_recording,
    a_run,
    a_set,
    a_verification,
    comparison,
    findings,
)


def test_the_worst_output_of_each_format_and_its_shares_of_full_scale():
    assert sensing.HEAD.content(findings()) == {
        "worst": {
            "f64": {
                "percent": pytest.approx(2.0),  # 0.08 of 4 Nm
                "error": 0.08,
                "output": "tau_Nm",
                "unit": "Nm",
                "block": "sensor",
                "stream": "sweep",
                "bound_percent": pytest.approx(3.0),
                "torque_percent": pytest.approx(2.0),
            },
            "f32": {
                "percent": pytest.approx(1.5),  # 0.3 of 20 rad/s; a state is no output
                "error": 0.3,
                "output": "omega_rad_s",
                "unit": "rad/s",
                "block": "velocity",
                "stream": "steps",
                "bound_percent": pytest.approx(2.5),
                "torque_percent": pytest.approx(0.5),
            },
        }
    }
    alone = findings(verification=a_verification(COMPARISONS[2:3]))
    assert sensing._worst(alone, "f32")["torque_percent"] == 0


def test_a_summary_names_worst_errors_board_fit_and_what_is_missing(monkeypatch):
    board = BoardRun("netduinoplus2", "A board", skipped="no tool")
    found = findings(board=board)
    worst = [
        "float64: worst error 2 % of full scale (sensor.tau_Nm, sweep), limit 3 %",
        "float32: worst error 1.5 % of full scale (velocity.omega_rad_s, steps), limit 2.5 %",
        "board netduinoplus2: skipped: no tool",
    ]
    assert sensing.summary(found) == [*worst, "2 values are assumed"]
    means = {"training": 1.25, "held_out": 3.5}
    monkeypatch.setattr(sensing, "_fit", lambda _: {"mean_rms_percent": means})
    fit = "fit to the measured torque, RMS in % of full scale: "
    still = findings(board=board, device=a_device(rate_terms=False))
    end = ["2 values are assumed", "rate terms not identified"]
    both = f"{fit}1.25 % training, 3.50 % held out"
    assert sensing.summary(still) == [*worst, both, *end]
    means["held_out"] = None
    assert sensing.summary(still) == [*worst, f"{fit}1.25 % training", *end]


def test_a_fit_tells_each_set_by_its_recording_amplitude_and_cycles():
    cycles = {"training": 2, "held_out": 1}
    r = a_recording([a_set("up", 0.3, (0, 1), (2,), cycles), a_set("down", 0.2, (), (0, 2))])
    # The C gives 1.5 Nm, 2 and -0.5 where -1, -2 and -3 Nm were measured.
    found = findings(runs=(a_run(), a_run("file", r)), mapping=a_mapping())
    fit = sensing._fit(found)
    first, second = fit["sets"]
    assert (first["recording"], first["label"], first["amplitude_rad"]) == ("file", "up", 0.3)
    assert list(first["cycles"].items()) == [("held_out", 1), ("training", 2)]
    assert first["training"] == {
        "rms_Nm": pytest.approx(np.sqrt((2.5**2 + 4**2) / 2)),
        "rms_percent": pytest.approx(25 * np.sqrt((2.5**2 + 4**2) / 2)),
        "max_Nm": 4.0,
        "max_percent": 100.0,
    }
    assert first["held_out"]["rms_Nm"] == 2.5
    assert second["training"] is None
    assert second["held_out"]["rms_percent"] == pytest.approx(62.5)
    means = {"training": first["training"]["rms_percent"], "held_out": pytest.approx(62.5)}
    assert fit["mean_rms_percent"] == means
    # Half way between 0.125 and 0, 0, and a half of 0: float32 is 0.0625 more at the most.
    assert fit["f32_minus_f64_max_Nm"] == pytest.approx(0.0625)
    none = sensing._fit(findings(runs=(a_run(),), mapping=a_mapping()))
    assert none["mean_rms_percent"] == {"training": None, "held_out": None}
    assert (none["sets"], none["f32_minus_f64_max_Nm"]) == ([], 0.0)
    assert sensing._fit(findings(runs=(a_run("file", r),))) is None
    stranger = findings(runs=(a_run("file", r),), mapping=a_mapping("knee"))
    assert sensing._fit(stranger) is None


def test_flags_are_told_in_the_steps_in_which_their_bit_is_set():
    quiet = a_run("quiet", status=(0, 0, 2, 0, 0))
    told = sensing._flags_seen(findings(runs=(a_run("loud"), quiet)))
    where = {"status": "joint_status", "of": 5}
    assert told == [
        {"stream": "loud", "flag": "COLD", "meaning": "too cold", "steps": 2, **where},
        {"stream": "loud", "flag": "FAR", "meaning": "far", "steps": 3, **where},
        {"stream": "quiet", "flag": "FAR", "meaning": "far", "steps": 1, **where},
    ]


def test_float32_against_float64_end_to_end_of_what_is_no_status():
    found = findings(runs=(a_run("one"),), verification=a_verification())
    content = dict(sensing.SECTIONS[4].content(found))
    assert content["end_to_end"] == [
        {
            "stream": "one",
            "output": "joint_tau_Nm",
            "unit": "Nm",
            "max_error": 0.25,
            "percent": 6.25,
        },
        {
            "stream": "one",
            "output": "joint_omega_rad_s",
            "unit": "rad/s",
            "max_error": 0.5,
            "percent": 2.5,
        },
    ]
    assert content["status_seen"] == sensing._flags_seen(found)
    assert content["verification"] == found.verification.to_dict()
    assert set(content) == {"end_to_end", "status_seen", "verification"}


def test_the_overview_has_the_torque_of_each_stream_and_the_fit(monkeypatch):
    given = []
    monkeypatch.setattr(figures, "error_overview", lambda *a: given.append(a) or "drawn")
    lost = comparison("sensor", "lost", "f32", {}, {"tau_Nm": 0.4})
    found = findings(verification=a_verification([*COMPARISONS, lost]))
    shown = sensing.SECTIONS[4].shown(found)
    assert shown == {"overview": "drawn", "tolerance": sensing.F64_TOLERANCE}
    for means in ({"held_out": 3.0, "training": 2.0}, {"held_out": None, "training": 2.0}):
        monkeypatch.setattr(sensing, "_fit", lambda _, m=means: {"mean_rms_percent": m})
        sensing._overview(found)
    # Stream, float64, float32, and the limit of float32: the velocity is no torque.
    rows = [
        ("sweep", 2.0, 0.25, 1.0),
        ("rough", None, 0.5, 1.5),
        ("lost", None, None, pytest.approx(10.0)),
    ]
    assert given == [(rows, fit, "overview") for fit in (None, 3.0, 2.0)]


def test_bounds_stand_with_their_ranges_and_the_worst_seen_below_them():
    wide = Bound("f32", 1, {"tau_Nm": 0.06, "tau_spring_Nm": 0.4}, {}, "intervals", ("a = b",))
    tight = Bound("f32", 1, {"tau_Nm": 0.04}, {}, "in the domain", ())
    bounds = {"sensor": {"port ranges": wide, "identified domain": tight}}
    spring = comparison("sensor", "more", "f32", {"tau_spring_Nm": 0.2}, {"tau_spring_Nm": 0.3})
    found = findings(verification=a_verification([*COMPARISONS, spring], bounds))
    assert sensing._bounds(found) == {
        "bounds": [
            {
                "block": "sensor",
                "domain": "port ranges",
                "method": "intervals",
                "assumptions": ["a = b"],
                "ranges": [
                    {"name": "theta_rad", "high": 0.5, "unit": "rad"},
                    {"name": "omega_rad_s", "high": 9.0, "unit": "rad/s"},
                ],
                "outputs": [
                    {"output": "tau_Nm", "unit": "Nm", "bound": 0.06, "percent": 1.5, "seen": 0.02},
                    {
                        "output": "tau_spring_Nm",
                        "unit": "Nm",
                        "bound": 0.4,
                        "percent": 5.0,
                        "seen": 0.2,  # no stream was held against it: the worst of all
                    },
                ],
            },
            {
                "block": "sensor",
                "domain": "identified domain",
                "method": "in the domain",
                "assumptions": [],
                "ranges": [
                    {"name": "theta_rad", "high": 0.2, "unit": "rad"},
                    {"name": "omega_rad_s", "high": 7.0, "unit": "rad/s"},
                    {"name": "tau_r_Nm", "high": 4.0, "unit": "Nm"},
                ],
                "outputs": [
                    {"output": "tau_Nm", "unit": "Nm", "bound": 0.04, "percent": 1.0, "seen": 0.01}
                ],
            },
        ]
    }
    # The tighter bound applied to no stream: nothing was seen below it.
    alone = findings(verification=a_verification(COMPARISONS[:4], bounds))
    wide_row, tight_row = sensing._bounds(alone)["bounds"]
    assert tight_row["outputs"][0]["seen"] is None
    assert wide_row["outputs"][1]["seen"] is None
    held = comparison("sensor", "x", "f32", {}, {"tau_Nm": 0.04})
    found = findings(verification=a_verification([held], bounds))
    assert sensing._bounds(found)["bounds"][1]["outputs"][0]["seen"] is None


def test_a_recording_is_drawn_with_what_was_measured_and_held_out():
    up = a_set("up", np.radians(12.5), (0,), (2,))
    down = a_set("down", np.radians(5.0), (), (1,))

    def trace(*sets):
        return sensing._trace(a_run("file", a_recording(sets)), True)

    drawn = trace(up, down)
    assert (drawn.label, drawn.model_name, drawn.components) == ("file", "C, float32", ())
    assert drawn.time_s.tolist() == [1.0, 2.0, 3.0]
    assert drawn.theta_rad.tolist() == [0.5, 1.0, 1.5]
    assert drawn.model_Nm.tolist() == [1.5, 2.0, -0.5]  # half way between what the C gave
    assert drawn.measured_Nm.tolist() == [-1.0, -2.0, -3.0]
    assert drawn.held_out.tolist() == [False, True, True]
    assert [(t, at.tolist()) for t, at in drawn.parts] == [
        ("up, amplitude 12.5°", [0, 2]),
        ("down, amplitude 5°", [1]),
        ("whole recording", [0, 1, 2]),
    ]
    # None held out, or nothing else: no two colours.
    assert trace(a_set(training=(0, 1, 2))).held_out is None
    assert trace(a_set(held_out=(0, 1, 2))).held_out is None


def test_what_was_not_measured_is_drawn_as_the_c_and_its_parts():
    r = a_recording([a_set(training=(0,), held_out=(2,))])
    for run, same in ((a_run("chirp"), True), (a_run("chirp"), False), (a_run("chirp", r), False)):
        drawn = sensing._trace(run, same)
        assert drawn.label == "chirp"
        assert drawn.time_s.tolist() == [0.0, 2.0, 4.0, 6.0, 8.0]
        assert drawn.theta_rad == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
        assert drawn.model_Nm.tolist() == [1.0, 2.0, -3.0, 0.5, 0.0]
        assert drawn.measured_Nm is drawn.held_out is None
        assert [(t, at.tolist()) for t, at in drawn.parts] == [("torque", [0, 1, 2, 3, 4])]
        # The hysteresis is 0 throughout, and left out.
        assert [(name, y.tolist()) for name, y in drawn.components] == [
            ("spring", [2.0, 4.0, -6.0, 1.0, 0.0]),
            ("rate terms", [-1.0, -2.0, 3.0, -0.5, 0.0]),
        ]
    assert sensing.PARTS[1] == ("hysteresis", "tau_hysteresis_Nm")


def test_plots_are_given_full_scale_and_float32_less_float64(monkeypatch):
    given = []

    def plots(*a):
        given.append(a)
        return [{"label": t.label} for t in a[0]]

    monkeypatch.setattr(figures, "plots", plots)
    found = findings(runs=(a_run("one"), a_run("two", tau=(0, 0, 0, 0, 1.5))))
    shown = sensing.SECTIONS[1].shown(found)
    assert shown == {"plots": [{"label": "one", "steps": 5}, {"label": "two", "steps": 5}]}
    ((traces, full_scale, differences),) = given
    assert ([t.label for t in traces], full_scale) == (["one", "two"], 4.0)
    assert len(differences) == 2
    for t, difference in differences:
        assert t.tolist() == [0.0, 2.0, 4.0, 6.0, 8.0]
        assert difference.tolist() == [0.125, 0.0, 0.0, 0.25, 0.0]
    assert sensing.SECTIONS[1].content(found) == {"fit": None}


BOARD = (
    "No real hardware was run. The board is emulated: it shows the bits of every result, "
    "how many instructions a step takes, and how much stack, never a time in seconds."
)
ENCODER = (
    "Recorded deflections are interpolated to the sensing rate and rounded to float32; the "
    "14 bit steps of the device's encoder are not simulated here."
)
NOT_RECORDED = "No recording was given: nothing here is compared with a measured torque."


def test_notes_say_what_is_assumed_missing_and_flagged(monkeypatch):
    monkeypatch.setattr(common, "versions", lambda: {"esea-gen": "1"})
    found = findings(runs=(a_run("one", status=(1,) * 1200),), board=BoardRun("b", "t"))
    content = sensing.SECTIONS[-1].content(found)
    assert content["versions"] == {"esea-gen": "1"}
    assumed, board, recording, encoder, chain, seen = content["notes"]
    assert assumed == "2 values are assumed; they are listed with the parameters."
    assert (board, recording, encoder) == (BOARD, NOT_RECORDED, ENCODER)
    assert chain.startswith("float32 bounds hold for each Block with exact inputs.")
    assert seen == "one: COLD in 1\u202f200 of 1\u202f200 steps (too cold)."
    skipped = findings(
        device=a_device(rate_terms=False), board=BoardRun("b", "t", skipped="no tool")
    )
    rate, *others = sensing._notes(skipped)["notes"]
    assert others == [assumed, board, "The firmware was not run: no tool", *content["notes"][2:5]]
    start = "Rate terms not identified: the device has no Maxwell element"
    end = ", and its torque does not depend on the rate."
    assert rate == f"{start}, equations (3.3) and (3.4) are not in its code{end}"
    skipped.device.file.elastomer = None
    assert sensing._notes(skipped)["notes"][0] == start + end


def test_notes_on_a_recording_say_whose_it_is_and_whether_it_has_a_time():
    fit = (
        "The fit to the measured torque judges the model and its parameters, not the C; "
        "it does not enter pass or fail."
    )
    untimed = a_run("file", a_recording([], timed=False))
    timed = a_run("file", a_recording([], timed=True))
    for runs, more in (
        ((timed, untimed), ["The recording has no time: its sampling period is assumed."]),
        ((timed, a_run()), []),
    ):
        notes = sensing._recording_notes(findings(runs=runs, mapping=a_mapping()))
        assert notes == [fit, *more]
    assert sensing._recording_notes(findings(runs=(untimed,), mapping=a_mapping("knee"))) == [
        "The deflection was recorded on 'The other one' (knee). Its measured torque is "
        "another specimen's, so it is not compared with this device's model."
    ]
    assert sensing._recording_notes(findings(runs=(untimed,))) == [NOT_RECORDED]


class Library:
    """A device's C that doubles a deflection, in float32 and one more in float64."""

    def __init__(self, real, prepared):
        self.real, self.prepared = real, prepared

    def task(self, name):
        assert name == "sense"
        return self

    def prepare(self, tunables):
        self.prepared.append((self.real, tunables))

    def run(self, inputs, trace):
        assert trace is False
        tau = 2 * inputs["theta_rad"] + (self.real == "f64")
        return {"joint_tau_Nm": tau}, "no trace"


@pytest.fixture
def library(monkeypatch):
    """Tunables that the C was given, by format."""
    prepared = []
    monkeypatch.setattr(sensing, "compile_device", lambda device, real: Library(real, prepared))
    monkeypatch.setattr(sensing, "deflection_inputs", lambda system, t: {"theta_rad": t})
    monkeypatch.setattr(sensing, "first_axis", lambda system, out: {"tau_Nm": out["joint_tau_Nm"]})
    monkeypatch.setattr(
        sensing, "temperature_tunables", lambda d, s, r: s is d.system and f"of {r}"
    )
    monkeypatch.setattr(sensing, "domain_chirp", lambda device: np.array([0.5, 0.25, -1.0]))
    return prepared


def test_without_a_recording_a_chirp_runs_through_both_formats(library):
    told = []
    runs, mapping = sensing.deflect(a_device(), None, None, told.append)
    (run,) = runs
    assert (mapping, library, run.recording) == (None, [], None)
    assert run.label == sensing.CHIRP == "chirp in the domain"
    assert told == ["running the C: chirp in the domain"]
    assert run.time_s.tolist() == [0.0, 0.002, 0.004]
    assert run.theta_rad.tolist() == [0.5, 0.25, -1.0]
    assert run.outputs["f32"]["joint_tau_Nm"].tolist() == [1.0, 0.5, -2.0]
    assert run.sensor["f64"]["tau_Nm"].tolist() == [2.0, 1.5, -1.0]
    assert list(run.outputs) == list(run.sensor) == ["f64", "f32"]


def test_recordings_run_at_the_sensing_rate_rounded_and_at_their_temperature(library, monkeypatch):
    asked = []

    def replays(device, path, data):
        asked.append((path, data))
        return [Of(label=k, theta_rad=np.array([0.1 * i])) for i, k in enumerate("ab", 1)]

    monkeypatch.setattr(sensing, "load_mapping", lambda path, data: ("map", path, data))
    monkeypatch.setattr(sensing, "recordings_for", replays)
    monkeypatch.setattr(sensing, "load_recordings", lambda source: ["A", "B"])
    runs, mapping = sensing.deflect(a_device(), Path("m.toml"), Path("d"), lambda _: None)
    assert mapping == ("map", Path("m.toml"), Path("d"))
    assert asked == [(Path("m.toml"), Path("d"))]
    assert [(r.label, r.recording) for r in runs] == [("a", "A"), ("b", "B")]
    assert [r.theta_rad.tolist() for r in runs] == [[float(np.float32(x))] for x in (0.1, 0.2)]
    assert library == [(real, f"of {r}") for r in "AB" for real in ("f64", "f32")]


def test_a_run_s_torque_at_other_times_and_whose_recording_it_is():
    run = a_run()
    assert run.torque_at("f32", np.array([1.0, 3.5, 6.0])).tolist() == [1.5, -1.75, 0.5]
    assert run.torque_at("f64", np.array([6.0, 7.0])).tolist() == [0.25, 0.125]
    assert [findings(mapping=m).same_specimen for m in (None, a_mapping(), a_mapping("knee"))] == [
        *(False, True, False)
    ]
    picked = findings().comparisons("sensor", "f32")
    assert [c.stream for c in picked] == ["rough", "sweep"]
