"""What a drive's page, its numbers and its board say, of small findings worked out by hand."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace as Of

import numpy as np
import pytest

from esea_gen.devices.fields import field_facts
from esea_gen.errors import UserError
from esea_gen.report import board as boards
from esea_gen.report import builder, common, drive, sensing
from esea_gen.report.board import BoardRun
from esea_gen.report.builder import Report

from .made_findings import (
    COMPARISONS,
    a_device,
    a_mapping,
    a_verification,
    comparison,
    findings,
    said,
)


def case(name, rms, **more):
    made = {"name": name, "rms_true_Nm": rms, "rms_model_Nm": 0.5, "max_true_Nm": 3.0}
    return made | {"unstable": False} | more


class Study:
    """A closed-loop study that is over."""

    def __init__(self, title, *cases, thesis=None, content=None):
        self.study = Of(title=title, thesis_Nm=thesis or {})
        self.cases = lambda: list(cases)
        self.to_dict = lambda: content or {}
        self.figure = lambda: f"figure of {title}"


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
        comparison("i", "two", "f32", residual=(0.2, 0.25), rule="residual"),
        comparison("i", "three", "f32", residual=(0.2, 0.24), rule="residual"),
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


# -- what every device has -------------------------------------------------------------------------


def test_sections_stand_in_their_order():
    numbers = [("device/parameters", "Parameters"), ("device/equations", "Equations")]
    code, firmware = ("device/code", "Code"), ("device/firmware", "Firmware")
    notes = ("device/notes", "Notes and limits")
    assert [(s.part, s.title) for s in sensing.SECTIONS] == [
        ("sensing/way", "Data flow"),
        ("sensing/torque", "Torque"),
        *reversed(numbers),
        ("sensing/errors", "Errors"),
        ("sensing/bounds", "Bounds"),
        code,
        firmware,
        notes,
    ]
    assert [(s.part, s.title) for s in drive.SECTIONS] == [
        ("drive/tasks", "Tasks"),
        ("drive/experiments", "Experiments"),
        ("drive/response", "Response"),
        ("drive/checks", "Checks"),
        *(firmware, *numbers, code, notes),
    ]
    assert (sensing.HEAD.part, drive.HEAD.part) == ("sensing/head", "drive/head")
    assert drive.HEAD.content(None) == drive.HEAD.shown(None) == {}


def row(key, value, unit, status, source):
    text = field_facts(key)["text"]
    section = key.partition(".")[0]
    told = {"key": key, "value": value, "unit": unit, "status": status, "source": source}
    return told | {"meaning": text, "section": section}


ROWS = [
    row("elastomer.k1_Nm_rad", 9.5, "Nm/rad", "identified", "a fit"),
    row("elastomer.k3_Nm_rad3", -200.0, "Nm/rad^3", "assumed", "a guess"),
    row("timing.sense_rate_Hz", 1000.0, "Hz", "assumed", "a choice"),
    row("domain.theta_max_rad", 0.2, "rad", "published", "a table"),
]
ARM = {"key": "torque.scale_Nm_per_N", "value": 0.25, "unit": "Nm/N", "source": "an arm (rig.toml)"}


def test_every_number_stands_with_its_unit_and_source_by_section():
    found = findings()
    assumed = ["elastomer.k3_Nm_rad3", "timing.sense_rate_Hz"]
    assert common.PARAMETERS.content(found) == {"assumed": assumed, "parameters": ROWS}
    assert common.PARAMETERS.shown(found) == {
        "assumed": ROWS[1:3],
        "groups": {"elastomer": ROWS[:2], "timing": ROWS[2:3], "domain": ROWS[3:]},
    }


def test_what_a_mapping_assumes_counts_too():
    assert common.assumed(findings(mapping=a_mapping())) == [*ROWS[1:3], ARM]
    period = said(0.01, "assumed", "a clock")
    mapping = a_mapping(scale="assumed", period=period)
    deflection, arm, time = common.assumed(findings(mapping=mapping))[2:]
    assert deflection == {
        "key": "deflection.scale_rad_per_m",
        "value": 12.5,
        "unit": "rad/m",
        "source": "a ruler (rig.toml)",
    }
    assert arm == ARM
    assert (time["key"], time["value"], time["unit"]) == ("sampling.period_s", 0.01, "s")
    known = common.assumed(findings(mapping=a_mapping(period=said(0.01))))
    assert known == [*ROWS[1:3], ARM]


def test_equations_stand_by_block():
    def equation(number):
        return Of(number=number, text=f"text {number}", mathml=f"<m>{number}</m>")

    one = Of(name="b", equations=[equation("(3.2)"), equation("(3.1)")])
    system = Of(kinds=[one, Of(name="a", equations=[equation("(1)")])])
    found = findings(device=a_device(system=system, rate_terms="yes"))
    assert common.EQUATIONS.content(found) == {
        "rate_terms": "yes",
        "equations": [
            {"block": b, "number": n, "text": f"text {n}", "mathml": f"<m>{n}</m>"}
            for b, n in (("b", "(3.2)"), ("b", "(3.1)"), ("a", "(1)"))
        ],
    }


def test_files_have_their_sizes_and_kernels_their_operations(monkeypatch):
    costs = {"f64": {"mul": 2, "add": 1}, "f32": {"sqrt": 4, "add": 3}}

    def format_of(real):
        def passes(kernel):
            assert kernel.startswith("kernel of ")
            return Of(cost=lambda: dict(costs[real]))

        return Of(passes=passes)

    verbs = {"init": "no", "prepare": "kernel of prepare", "step": "kernel of step"}
    monkeypatch.setattr(common, "block_kernels", lambda block: dict(verbs))
    monkeypatch.setattr(common, "FORMATS", {real: format_of(real) for real in costs})
    kinds = [Of(name="z", kind="block"), Of(name="p", kind="program"), Of(name="a", kind="block")]
    bundles = (
        Of(folder="f32", files={"b.h": "ab\ncd\n", "a.c": "é\n"}),
        Of(folder="dialect", files={}),
    )
    device = a_device(system=Of(kinds=kinds))
    code = common.CODE.content(findings(device=device, bundles=bundles))["code"]
    assert code["folders"] == [
        {
            "folder": "f32",
            "files": [
                {"name": "a.c", "bytes": 3, "lines": 1},
                {"name": "b.h", "bytes": 6, "lines": 2},
            ],
            "bytes": 9,
            "lines": 3,
        },
        {"folder": "dialect", "files": [], "bytes": 0, "lines": 0},
    ]
    # Steps first, float64 first; nothing of a program, nor of what runs once.
    assert [(k["block"], k["kernel"], k["format"], k["total"]) for k in code["kernels"]] == [
        (block, verb, real, total)
        for block in "az"
        for verb in ("step", "prepare")
        for real, total in (("f64", 3), ("f32", 7))
    ]
    operations = code["kernels"][0]["operations"]
    assert list(operations.items()) == [("add", 1), ("mul", 2)]


class Ran:
    """What a board gave for a stream."""

    def __init__(self, identical=True, hash_matches=True, difference=None, instructions=None):
        self.board, self.steps, self.emulator = "netduinoplus2", 40, "QEMU 9"
        self.content_hash, self.expected_hash = "abc", "abc" if hash_matches else "def"
        self.identical, self.hash_matches = identical, hash_matches
        self.first_difference, self.instructions = difference, instructions or {}

    def to_dict(self):
        return {"identical": self.identical, "duration_s": 3.5, "steps": self.steps}


IMAGE = Of(to_dict=lambda: {"elf": "a.elf"}, compiler="gcc 14")
DIFFERENT = Of(output="tau_Nm", step=7, board="0x3f", host="0x40")


def test_the_firmware_s_section_has_what_the_board_gave():
    def content(board, laws=()):
        return common.FIRMWARE.content(findings(board=board, device=a_device(laws=laws)))["board"]

    board = BoardRun("netduinoplus2", "A board", IMAGE, {"up": Ran(), "down": Ran(False)})
    streams = {"up": {"identical": True, "steps": 40}, "down": {"identical": False, "steps": 40}}
    named = {"name": "netduinoplus2", "title": "A board"}
    assert content(board) == {
        **named, "skipped": "", "failed": "", "image": {"elf": "a.elf"}, "streams": streams,
    }  # fmt: skip
    assert content(board, ("smc",))["tasks"] == streams
    none = BoardRun("netduinoplus2", "A board", skipped="no tool", failed="silent")
    assert content(none) == {
        **named, "skipped": "no tool", "failed": "silent", "image": None, "streams": {},
    }  # fmt: skip


@pytest.mark.parametrize(
    ("board", "ran", "good"),
    [
        (BoardRun("x", "", results={"a": Ran(), "b": Ran()}), True, True),
        (BoardRun("x", "", results={"a": Ran(), "b": Ran(False)}), True, False),
        (BoardRun("x", "", results={"a": Ran()}, failed="silent"), True, False),
        (BoardRun("x", "", failed="silent"), False, False),
        (BoardRun("x", "", skipped="no tool"), False, None),
    ],
)
def test_a_board_that_did_not_run_is_neither_good_nor_bad(board, ran, good):
    shown = common.FIRMWARE.shown(findings(board=board))
    assert (shown["ran"], shown["board_good"]) == (ran, good)
    assert list(shown["results"]) == list(board.results or {})
    assert shown["emulated"] is False


def test_a_board_of_the_emulator_is_said_to_be_one():
    shown = common.FIRMWARE.shown
    assert shown(findings(board=BoardRun("netduinoplus2", "")))["emulated"] is True
    assert shown(findings(board=BoardRun("host", "")))["emulated"] is False


def test_versions_of_all_that_had_a_part(monkeypatch):
    monkeypatch.setattr(common, "versions", lambda: {"esea-gen": "1"})
    board = BoardRun("x", "", IMAGE, {"up": Ran()})
    both = {"esea-gen": "1", "firmware compiler": "gcc 14", "emulator": "QEMU 9"}
    assert common.made_with(findings(board=board)) == {"versions": both}
    assert common.made_with(findings()) == {"versions": {"esea-gen": "1"}}
    assert common.REAL_NAMES == {"f64": "float64", "f32": "float32"}
    assert common.board_note(findings(board=board)) == []


def test_a_board_passes_where_every_bit_and_the_content_are_right():
    def board(*ran, **more):
        results = dict(zip(("up", "down"), ran, strict=False)) if ran else None
        return BoardRun("x", "X", results=results, **more)

    wrong, other = Ran(False, difference=DIFFERENT), Ran(hash_matches=False)
    passed = (board(), board(Ran(), Ran()), board(skipped="no tool"))
    assert [b.passed for b in passed] == [True] * 3
    assert [b.problems for b in passed] == [[]] * 3
    for failed in (board(Ran(), wrong), board(other, Ran()), board(failed="silent")):
        assert not failed.passed
    where = "board netduinoplus2"
    assert board(wrong, other, failed="late").problems == [
        "board x: late",
        f"{where}, up: tau_Nm at step 7 is 0x3f, on the host 0x40",
        f"{where}, down: runs content abc, expected def",
    ]
    counted = Ran(instructions={"min": 1, "median": 250, "max": 900})
    assert board(counted, Ran(False), skipped="no tool").summary("run") == [
        "board x: skipped: no tool",
        "board netduinoplus2, up: 40 runs, every bit as on the host, "
        "250 instructions a run (median, emulated)",
        "board netduinoplus2, down: 40 runs, BITS DIFFER",
    ]
    assert board().summary("run") == []


def test_a_board_runs_tasks_of_a_law_and_every_deflection(monkeypatch):
    told, ran = [], []

    def tasks(device, image, inputs, progress):
        ran.append((image, inputs))
        progress(1, 8)
        return {"sense": "S", "control": "C"}

    def stream(device, image, given, progress):
        ran.append((image, given))
        progress(30, 40)
        return f"ran {given}"

    monkeypatch.setattr(boards, "build_firmware", lambda device, board, folder: f"for {board}")
    monkeypatch.setattr(boards, "record_drive", lambda device, ticks: Of(inputs=f"{ticks} ticks"))
    monkeypatch.setattr(boards, "run_tasks_in_emulator", tasks)
    monkeypatch.setattr(boards, "run_in_emulator", stream)
    monkeypatch.setattr(boards, "deflection_inputs", lambda system, theta: f"inputs {theta}")
    known = {"mine": Of(title="My board")}
    monkeypatch.setattr(boards, "firmware_boards", lambda: known)
    found = boards.run_board(a_device(laws=("smc",)), "mine", {}, told.append)
    assert found == BoardRun("mine", "My board", "for mine", {"sense": "S", "control": "C"})
    assert ran == [("for mine", "3000 ticks")]
    assert told == ["building firmware for mine", "emulating tasks: 12 %"]
    ran.clear()
    found = boards.run_board(a_device(), "other", {"up": 1, "down": 2}, told.append)
    results = {"up": "ran inputs 1", "down": "ran inputs 2"}
    assert found == BoardRun("other", "", "for other", results)
    assert ran == [("for other", "inputs 1"), ("for other", "inputs 2")]
    assert told[3:] == ["emulating up: 75 %", "emulating down: 75 %"]


# -- all of it -------------------------------------------------------------------------------------


def report(**changes):
    made = {
        "device": a_device(laws=("smc",)),
        "verification": a_verification(),
        "bundles": (),
        "board": BoardRun("x", "X"),
        "command": "again",
    }
    return Report(**(made | changes))


def test_everything_that_failed_is_a_problem():
    good = {"tuning": Study("T", case("slow", 0.25))}
    assert report(simulations=good).passed
    assert report(simulations=good).problems == []
    bad = comparison("sensor", "sweep", "f32", problems=["one", "two"], status_differences=3)
    bits = comparison("velocity", "rough", "f64", bit_identical=False)
    told = [
        "sensor, float32, sweep: one",
        "sensor, float32, sweep: two",
        "sensor, float32, sweep: status differs in 3 steps",
        "velocity, float64, rough: bits differ from CasADi's own C",
    ]
    equal = comparison("velocity", "x", "f64", bit_identical=True)
    failed = a_verification([bad, *COMPARISONS, equal, bits])
    assert builder.verification_problems(failed) == told
    lost = report(
        verification=failed,
        board=BoardRun("x", "X", failed="silent"),
        simulations={"tuning": Study("T", case("fast", 1.0, unstable=True))},
    )
    assert lost.problems == [*told, "board x: silent", "tuning, fast: unstable"]
    for part in ("verification", "board", "simulations"):
        only = report(**({"simulations": good} | {part: getattr(lost, part)}))
        assert not only.passed, part


def test_the_json_has_head_and_sections_of_its_kind(monkeypatch):
    assert report().kind is drive
    assert report(device=a_device()).kind is sensing
    monkeypatch.setattr(drive, "HEAD", common.PARAMETERS._replace(content=lambda f: {"head": 1}))
    sections = [common.CODE._replace(content=lambda f, k=k: {k: np.nan}) for k in "ab"]
    monkeypatch.setattr(drive, "SECTIONS", sections)
    told = report().to_dict()
    assert list(told.items()) == [
        ("device", {"name": "elbow", "title": "An elbow"}),
        ("content_hash", "abc"),
        ("passed", True),
        ("problems", []),
        ("head", 1),
        ("a", None),
        ("b", None),
        ("command", "again"),
    ]
    given = []
    monkeypatch.setattr(builder, "render", lambda *a, **k: given.append((a, k)) or "page")
    made = report()
    assert made.html() == "page"
    ((args, words),) = given
    assert args == (drive.HEAD, sections, made)
    assert words == {"title": "An elbow", "f": told, "reals": common.REAL_NAMES}


@pytest.mark.parametrize(
    ("shipped", "law", "recording", "data", "board", "said"),
    [
        (True, "", None, None, "netduinoplus2", "elbow"),
        (False, "", None, None, "host", "my/elbow.toml --board host"),
        (True, "pid", None, None, "netduinoplus2", "elbow --controller pid"),
        (True, "a/b.toml,c/d.toml", None, None, "netduinoplus2", "elbow --controller b.toml,d.toml"),
        (True, "", "x/rig.toml", None, "netduinoplus2", "elbow --recording rig.toml"),
        (True, "", "x/r.toml", "y", "host", "elbow --recording r.toml --data DIR --board host"),
    ],
)  # fmt: skip
def test_the_command_makes_the_page_again(shipped, law, recording, data, board, said):
    device = a_device(shipped=shipped, origin="my/elbow.toml", given=("elbow", law))
    paths = (None if p is None else Path(p) for p in (recording, data))
    assert builder._command(device, *paths, board) == f"esea-gen report {said}"


@pytest.mark.parametrize("law", [True, False])
def test_a_page_is_gathered_from_verification_board_and_runs(monkeypatch, law):
    told, verified, boarded = [], [], []
    runs = (Of(label="a", theta_rad=[1]), Of(label="b", theta_rad=[2]))
    monkeypatch.setattr(drive, "close_loop", lambda device, say: ({"tuning": 1}, {"tuning": 2}))
    monkeypatch.setattr(sensing, "deflect", lambda device, r, d, say: (runs, (r, d)))
    monkeypatch.setattr(builder, "render_device", lambda device, formats: formats)
    monkeypatch.setattr(builder, "render_dialect", lambda device: "dialect")
    monkeypatch.setattr(
        builder, "verify", lambda d, formats, given, progress: verified.append((formats, given))
    )
    monkeypatch.setattr(
        builder, "run_board", lambda d, board, given, say: boarded.append((board, given))
    )
    device = a_device(laws=("smc",) if law else ())
    if law:
        for given in ({"recording": Path("r")}, {"data": Path("d")}):
            with pytest.raises(UserError, match="elbow has a drive: .* takes no recording"):
                builder.gather(device, **given)
        found = builder.gather(device, progress=told.append)
        assert (found.simulations, found.yardsticks) == ({"tuning": 1}, {"tuning": 2})
        assert (found.runs, found.mapping) == ((), None)
        every = recorded = {}
    else:
        found = builder.gather(device, Path("r"), Path("d"), "host", told.append)
        assert (found.runs, found.mapping) == (runs, (Path("r"), Path("d")))
        assert found.simulations == found.yardsticks == {}
        every = recorded = {"a": [1], "b": [2]}
    assert told == ["generating"]
    assert found.bundles == ("f64", "f32", "dialect")
    assert verified == [(("f64", "f32"), recorded)]
    assert boarded == [("netduinoplus2" if law else "host", every)]
    if not law:
        # A chirp is no recording: verification has streams of its own.
        builder.gather(device)
        assert verified[1:] == [(("f64", "f32"), {})]
        assert boarded[1:] == [("netduinoplus2", every)]
