"""What all devices' pages say: numbers, code, firmware and problems, worked out by hand."""

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
    Study,
    a_device,
    a_mapping,
    a_verification,
    case,
    comparison,
    findings,
    said,
)


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


def test_a_number_of_a_section_within_a_section_stands_under_both_names():
    device = a_device(quantities=lambda: iter([("elastomer.maxwell.A_Nms_rad", said(2.0))]))
    (told,) = common.quantities(device)
    assert (told["section"], told["unit"]) == ("elastomer.maxwell", "Nm s/rad")


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
        progress(40, 40)
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
    assert told[3:] == ["emulating up: 100 %", "emulating down: 100 %"]


@pytest.mark.parametrize("required", [None, "0", "1"])
def test_a_missing_tool_skips_a_known_board_and_a_failure_is_told(monkeypatch, required):
    raised = [UserError("No compiler.", "Install it.")]

    def build(*_):
        raise raised[0]

    def run(board):
        return boards.run_board(a_device(), board, {"up": 1}, lambda _: None)

    monkeypatch.setattr(boards, "build_firmware", build)
    monkeypatch.setattr(boards, "firmware_boards", lambda: {"mine": Of(title="My board")})
    if required is None:
        monkeypatch.delenv("ESEA_REQUIRE_TOOLS", raising=False)
    else:
        monkeypatch.setenv("ESEA_REQUIRE_TOOLS", required)
    with pytest.raises(UserError, match="No compiler"):
        run("other")
    if required == "1":
        with pytest.raises(UserError, match="No compiler"):
            run("mine")
    else:
        assert run("mine") == BoardRun("mine", "My board", None, {}, str(raised[0]), "")
    raised[0] = RuntimeError("it is silent")
    for board, title in (("mine", "My board"), ("other", "")):
        assert run(board) == BoardRun(board, title, None, {}, "", "it is silent")


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
        (True, "a/b.toml,c/d", None, None, "netduinoplus2", "elbow --controller b.toml,d"),
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
            with pytest.raises(UserError, match=r"elbow has a drive: .* takes no recording"):
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
