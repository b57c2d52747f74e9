"""What a drive's page says, of small findings: every number and choice worked out by hand."""

from __future__ import annotations

from types import SimpleNamespace as Of

import pytest

from esea_gen.errors import UserError
from esea_gen.report import common, drive
from esea_gen.report.board import BoardRun

from .made_findings import COMPARISONS, Study, a_device, a_verification, case, comparison, findings


def simulations(**changes):
    tuning = (case("slow", 0.25, limited_share=0.125), case("fast", 0.75, unstable=True))
    made = {
        "tuning": Study("Tuning", *tuning, thesis={"smc-published": 0.59, "smc": 0.1}),
        "backdriven": Study("Backdriven", case("push", None), case("pull", 0.5)),
        "bread": Study("Bread", case("cut", 2.0, max_true_Nm=7.0, rms_model_Nm=1.5)),
        "impedance": Study("Impedance", case("soft", 1.0)),
        "step": Study("Step", content={"steps": [1, 2], "cases": "not taken"}),
        "frequency": Study("Frequency", content={"bandwidth": 9.0, "margins": [3], "x": 0}),
        "output-impedance": Study("Port", content={"impedance_fit": {"k": 2.0}}),
    }
    return made | changes


YARDSTICKS = {
    "tuning": Study("T", case("fast", 0.25), case("slow", 1.0, unstable=True)),
    "backdriven": Study("B", case("push", 4.0), case("pull", 0.0)),
}


def a_drive(**changes):
    return findings(**({"simulations": simulations(), "yardsticks": YARDSTICKS} | changes))


def test_experiments_stand_beside_what_was_published():
    rows = drive.SECTIONS[1].content(a_drive())["experiments"]
    keys = ("experiment", "case", "rms_true_Nm", "rms_model_Nm", "max_true_Nm", "unstable")
    assert [tuple(r[k] for k in keys) for r in rows] == [
        ("tuning", "slow", 0.25, 0.5, 3.0, False),
        ("tuning", "fast", 0.75, 0.5, 3.0, True),
        ("backdriven", "push", None, 0.5, 3.0, False),
        ("backdriven", "pull", 0.5, 0.5, 3.0, False),
        ("bread", "cut", 2.0, 1.5, 7.0, False),
        ("impedance", "soft", 1.0, 0.5, 3.0, False),
    ]
    assert [r["limited_share"] for r in rows] == [0.125, *[None] * 5]
    assert [r["printed_rms_true_Nm"] for r in rows] == [1.0, 0.25, 4.0, 0.0, None, None]
    assert [r["printed_unstable"] for r in rows] == [True, *[False] * 5]
    assert [r["ratio"] for r in rows] == [0.25, 3.0, None, None, None, None]
    # The thesis' figures are of the device that is shipped, and of its own controller.
    assert [r["thesis_rms_Nm"] for r in rows] == [0.59, 0.59, *[None] * 4]
    own = drive._experiments(a_drive(device=a_device(shipped=False)))["experiments"]
    assert [r["thesis_rms_Nm"] for r in own] == [None] * 6
    assert {len(r) for r in rows} == {11}


def test_a_summary_has_the_mean_error_of_each_experiment():
    board = BoardRun("b", "a board", skipped="no tool")
    assert drive.summary(a_drive(board=board)) == [
        "tuning: RMS of the true torque's error 0.500 Nm; as published 0.625 Nm",
        "backdriven: RMS of the true torque's error 0.500 Nm; as published 2.000 Nm",
        "bread: RMS of the true torque's error 2.000 Nm",
        "impedance: RMS of the true torque's error 1.000 Nm",
        "board b: skipped: no tool",
    ]


def test_a_run_that_failed_has_no_share_in_a_mean():
    ended = {"tuning": Study("T", case("fast", None), case("slow", 1.0))}
    none = {"bread": Study("Bread", case("cut", None))}
    told = drive.summary(a_drive(yardsticks=ended, simulations=simulations(**none)))
    assert told[0] == "tuning: RMS of the true torque's error 0.500 Nm; as published 1.000 Nm"
    assert told[2] == "bread: RMS of the true torque's error not known"


def test_runs_that_did_not_end_well_are_problems():
    bad = case("cut", 1.0, tripped=True, fault=True)
    lost = case("saw", None, failure="it broke", unstable=True)
    found = a_drive(simulations=simulations(bread=Study("Bread", bad, lost, case("on", 1.0))))
    assert drive.problems(found) == [
        "tuning, fast: unstable",
        "bread, cut: tripped, fault",
        "bread, saw: unstable, failure",
    ]


def test_figures_of_every_simulation_have_its_name_and_title(monkeypatch):
    monkeypatch.setattr(drive, "svg", lambda *a: a)
    shown = drive.SECTIONS[1].shown(a_drive())
    titles = {
        "tuning": "Tuning",
        "backdriven": "Backdriven",
        "bread": "Bread",
        "impedance": "Impedance",
        "step": "Step",
        "frequency": "Frequency",
        "output-impedance": "Port",
    }
    assert shown == {
        "captions": titles,
        "figures": {k: (f"figure of {t}", f"drive-{k}", t) for k, t in titles.items()},
        "compared": ("tuning", "backdriven", "bread", "impedance"),
        "yardstick": "smc-published",
    }


def test_the_response_is_taken_from_the_studies_without_a_yardstick():
    assert drive.SECTIONS[2].content(a_drive()) == {
        "response": {
            "bandwidth": 9.0,
            "margins": [3],
            "steps": [1, 2],
            "impedance_fit": {"k": 2.0},
        }
    }


def test_tasks_have_their_blocks_and_what_crosses_the_border():
    def names(*of):
        return [Of(name=n) for n in of]

    slow = Of(name="control", every=5, phase=3, release_ticks=4, blocks=("smc", "stamp"))
    fast = Of(name="sense", every=1, phase=0, release_ticks=0, blocks=("sensor",))
    system = Of(
        tasks=[fast, slow],
        task_inputs=lambda t: names("count") if t is fast else names("mode", "tau_d_Nm"),
        task_outputs=lambda t: names("tau_Nm", "status") if t is fast else names("u_Nm"),
        latches_read=lambda t: names("held") if t is slow else [],
    )
    found = findings(device=a_device(system=system, period_s=0.002))
    assert drive.SECTIONS[0].content(found) == {
        "tasks": [
            {
                "name": "sense",
                "period_ms": 2.0,
                "phase": 0,
                "release": 0,
                "blocks": ["sensor"],
                "inputs": ["count"],
                "outputs": ["tau_Nm", "status"],
                "latches": [],
            },
            {
                "name": "control",
                "period_ms": 10.0,
                "phase": 3,
                "release": 4,
                "blocks": ["smc", "stamp"],
                "inputs": ["mode", "tau_d_Nm"],
                "outputs": ["u_Nm"],
                "latches": ["held"],
            },
        ]
    }


def test_checks_have_each_block_s_steps_bits_and_worst_error():
    more = comparison("velocity", "x", "f64", steps=30, bit_identical=False)
    told = [
        *COMPARISONS,
        more,
        comparison("velocity", "y", "f32", {"omega_rad_s": 0.1}, steps=900, problems=["it is"]),
    ]
    # Of the Block's own full scales: 0.3 rad/s is 3 % of 10 rad/s.
    scales = {"velocity": {"omega_rad_s": 10.0}, "sensor": {"tau_r_Nm": 50.0}}
    found = findings(verification=a_verification(told, scales=scales))
    rate, torque = drive.SECTIONS[3].content(found)["checks"]
    assert rate == {
        "block": "velocity",
        "title": "Rate",
        "streams": 2,
        "steps": 37,
        "bits_equal": False,
        "passed": False,
        "rule": "CasADi's C, bit for bit",
        "output": "omega_rad_s",
        "unit": "rad/s",
        "error": 0.3,
        "limit": 0.5,
        "percent": pytest.approx(3.0),
        "stream": "steps",
    }
    # A state counts here: 2 of 50 Nm; the torque is of the device's 4 Nm, 0.02 of it less.
    assert (torque["streams"], torque["steps"]) == (1, 7)
    assert torque["bits_equal"] is torque["passed"] is True
    assert (torque["output"], torque["error"], torque["limit"]) == ("tau_r_Nm", 2.0, None)
    assert (torque["percent"], torque["stream"]) == (pytest.approx(4.0), "rough")
    alone = [*COMPARISONS[:3], comparison("sensor", "x", "f32", {"tau_Nm": 0.02}, {"tau_Nm": 1.0})]
    found = findings(verification=a_verification(alone, scales=scales))
    (_, torque) = drive._checks(found)["checks"]
    assert (torque["output"], torque["percent"]) == ("tau_Nm", pytest.approx(0.5))
    # float32 has no bits to be equal; a failure of it alone is one of the Block.
    failed = [comparison("sensor", "x", "f32", problems=["it is"], bit_identical=False)]
    found = findings(verification=a_verification(failed, scales=scales | {"velocity": {}}))
    (_, torque) = drive._checks(found)["checks"]
    assert (torque["bits_equal"], torque["passed"]) == (True, False)


def test_the_worst_of_a_block_by_its_residual_or_its_errors():
    scales = {"tau_Nm": 4.0, "free": 0.0, "omega_rad_s": 20.0}
    inverse = [
        comparison("i", "one", "f32", {"omega_rad_s": 9.0}, residual=(0.1, 0.3), rule="residual"),
        comparison("i", "three", "f32", residual=(0.2, 0.24), rule="residual"),
        comparison("i", "two", "f32", residual=(0.2, 0.25), rule="residual"),
        comparison("i", "zero", "f32", residual=(0.2, 0.25), rule="residual"),  # the first is told
        comparison("i", "four", "f32"),
    ]
    assert drive._worst(scales, inverse) == {
        "rule": "residual",
        "output": "tau_Nm",
        "error": 0.2,
        "limit": 0.25,
        "percent": pytest.approx(5.0),
        "stream": "two",
    }
    mixed = [
        comparison("m", "b", "f32", {"free": 7.0, "other": 9.0}, rule="one step"),
        comparison("m", "a", "f32", {"omega_rad_s": 5.0}, {"omega_rad_s": 6.0}, rule="lasting"),
    ]
    assert drive._worst(scales, mixed) == {
        "rule": "lasting, one step",
        "output": "omega_rad_s",
        "unit": "rad/s",
        "error": 5.0,
        "limit": 6.0,
        "percent": 25.0,
        "stream": "a",
    }
    # Without a full scale there is no share; what is no output or state is not looked at.
    assert drive._worst(scales, mixed[:1])["percent"] == 0.0
    assert drive._worst({}, mixed) == {"rule": "lasting, one step", "output": None}


def test_both_controllers_run_the_experiments_on_the_same_plant_and_person(monkeypatch):
    told, run = [], []
    person = {"bread": "uncertain"}
    monkeypatch.setattr(drive, "default_person", lambda e, plant: f"{person.get(e)}, {plant}")
    monkeypatch.setattr(drive, "simulate", lambda e, setting: run.append((e, setting)) or e.upper())
    monkeypatch.setattr(drive, "no_yardstick", lambda device: "")
    ours, theirs = drive.close_loop(a_device(given=("my_drive", "pid")), told.append)
    compared = ["tuning", "backdriven", "bread", "impedance"]
    every = [*compared, "step", "frequency", "output-impedance"]
    assert ours == {e: e.upper() for e in every}
    assert theirs == {e: e.upper() for e in compared}
    named = [(e, "pid@my_drive") for e in every] + [(e, "smc-published@my_drive") for e in compared]
    assert told == [f"{e}: {which}" for e, which in named]
    assert [(e, s.controller) for e, s in run] == named
    assert {s.plant for _, s in run} == {"real"}
    assert [s.person for e, s in run if e == "bread"] == ["uncertain, real"] * 2
    assert run[0][1].person == "None, real"
    # A device's own law, and one that the yardstick does not go with.
    monkeypatch.setattr(drive, "no_yardstick", lambda device: "too slow")
    run.clear()
    assert drive.close_loop(a_device(given=("my_drive", "")), told.append)[1] == {}
    assert [(e, s.controller) for e, s in run] == [(e, "my_drive") for e in every]


def test_why_there_is_no_yardstick_and_what_is_said_of_it(monkeypatch):
    def refused(name):
        raise UserError(f"{name} is too fast.", "Slow it.")

    asked = []
    monkeypatch.setattr(drive, "controller_device", lambda n: asked.append(n) or Of(system=1))
    assert drive.no_yardstick(a_device(given=("mine", "pid"))) == ""
    assert asked == ["smc-published@mine"]
    monkeypatch.setattr(drive, "controller_device", refused)
    assert drive.no_yardstick(a_device()) == "smc-published@elbow_drive is too fast."
    monkeypatch.setattr(common, "versions", lambda: {"esea-gen": "1"})
    board = BoardRun("b", "t", skipped="no tool")
    content = drive.SECTIONS[-1].content(a_drive(yardsticks={}, board=board))
    assert content["versions"] == {"esea-gen": "1"}
    notes = content["notes"]
    assert notes[0] == "2 values are assumed; they are listed with the parameters."
    assert [n.split()[0] for n in notes] == ["2", "No", "Torque", "Nothing", "An", "The"]
    assert notes[3] == (
        "Nothing stands beside “as published”: smc-published@elbow_drive is too fast."
    )
    assert notes[5] == "The firmware was not run: no tool"
    beside = drive._notes(a_drive())["notes"]
    assert len(beside) == 5
    assert beside[3] == (
        "“As published” is smc-published: the thesis' sliding mode control with its gaps filled, "
        "on the same plant and person. The thesis' own figures are of its own device, and shown "
        "for that one only."
    )
