"""Use of a coupling: cycles against the package ``rainflow``, storage, report, warning."""

from __future__ import annotations

import csv
import json
import subprocess
from contextlib import nullcontext
from types import SimpleNamespace

import cffi
import numpy as np
import pytest
import rainflow
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from esea_gen import load_device
from esea_gen.board.sim import SimBoard
from esea_gen.device import Device
from esea_gen.devices.fields import Fatigue
from esea_gen.devices.numbers import Quantity
from esea_gen.link.kept import coupling_lives, forget_coupling, name_coupling
from esea_gen.link.transport import LinkError
from esea_gen.targets import APP_FLAGS, firmware_folder
from esea_host.cli import app
from esea_host.cli import board as commands
from esea_host.connection.opening import warn_of_life
from tests.conftest import ROOT, require_tool
from tests.result_schemas import held

CLASSES, STEPS, POINTS = 48, 32, 64
TOP = CLASSES * STEPS // 2


@pytest.fixture(scope="module")
def counting(tmp_path_factory):
    """The board's counting, with sanitizer."""
    require_tool("gcc")
    app, target = firmware_folder() / "app", tmp_path_factory.mktemp("life") / "rainflow.so"
    command = [
        *("gcc", *APP_FLAGS, "-Wpedantic", "-Wshadow", "-Wdouble-promotion", "-shared", "-fPIC"),
        *("-fsanitize=undefined", "-fsanitize-undefined-trap-on-error"),
        *(f"-I{app}", f"-I{app.parent / 'port'}", app / "rainflow.c", "-o", target),
    ]
    subprocess.run(command, check=True)
    ffi = cffi.FFI()
    ffi.cdef(
        f"""typedef struct {{ uint32_t serial, place, seconds, joules; float part_J;
            uint32_t full, points; int16_t point[{POINTS}]; uint32_t halves[{CLASSES}];
        }} esea_store_life_t;
        bool esea_rainflow_take(esea_store_life_t *, int32_t);
        void esea_rainflow_halves(const esea_store_life_t *, uint32_t *);"""
    )
    return SimpleNamespace(ffi=ffi, lib=ffi.dlopen(str(target)))


def board_halves(counting, steps, life=None):
    """Half cycles by class, as the board has them after so many steps."""
    life = counting.ffi.new("esea_store_life_t *") if life is None else life
    for x in steps:
        counting.lib.esea_rainflow_take(life, int(x))
    halves = counting.ffi.new(f"uint32_t[{CLASSES}]")
    counting.lib.esea_rainflow_halves(life, halves)
    return list(halves), life


def read_columns(path):
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    return {n: np.array([float(r[n]) for r in rows]) for n in rows[0]}


def package_halves(steps):
    """The same by the package, without ranges below a class."""
    found = [0] * CLASSES
    # The last point twice: of a history of two points the package sees one.
    for size, _, cycles, *_ in rainflow.extract_cycles([int(x) for x in [*steps, *steps[-1:]]]):
        found[min(int(size) // STEPS, CLASSES - 1)] += round(2 * cycles)
    return [0, *found[1:]]


# The example of ASTM E1049-85, figure 6: ranges 3, 4, 6, 8, 8, 9 as halves, and 4 once whole.
STANDARD = [-2, 1, -3, 5, -1, 3, -4, 4, -2]


def test_the_example_of_the_standard(counting):
    halves, _ = board_halves(counting, [STEPS * x for x in STANDARD])
    assert {k: n for k, n in enumerate(halves) if n} == {3: 1, 4: 3, 6: 1, 8: 2, 9: 1}


steps = st.integers(-TOP, TOP)
# Drawn anywhere; or small moves, so that ranges of about a class and ties are common.
walks = st.lists(st.integers(-70, 70), max_size=300).map(
    lambda moves: np.clip(np.cumsum([0, *moves]), -TOP, TOP).tolist()
)
coarse = st.lists(st.integers(-6, 6).map(lambda x: STEPS * x), max_size=200)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(st.one_of(st.lists(steps, max_size=200), walks, coarse))
def test_counts_are_the_package_s_at_any_time(counting, history):
    """Fed one by one and read after a third: as if the history ended there."""
    life = None
    for end in (len(history) // 3, len(history)):
        start = 0 if life is None else len(history) // 3
        halves, life = board_halves(counting, history[start:end], life)
        if life.full == 0:
            assert [0, *halves[1:]] == package_halves(history[:end])
        assert halves[0] == 0
        assert life.points <= POINTS


@pytest.mark.parametrize(
    ("path", "column", "cycles"),
    [("data/hdrb/hdrb.csv", "displacement_cm", 10), ("traces/elbow_drive.csv", "theta_rad", 1)],
)
def test_counts_of_recorded_streams_are_the_package_s(counting, path, column, cycles):
    """A rubber bearing's test in a laboratory, and the closed loop's simulated run."""
    moved = read_columns(ROOT / "tests" / path)[column]
    for scale in (0.95, 0.3):
        told = np.rint(moved / np.abs(moved).max() * scale * TOP).astype(int)
        halves, life = board_halves(counting, told)
        assert halves == package_halves(told)
        assert sum(halves) >= 2 * cycles
        assert life.full == 0


def converging(points):
    """Turning points whose ranges shrink step by step, down to about a class."""
    sizes = np.linspace(2 * TOP - 2, STEPS + 2, points - 1).astype(int)
    return np.cumsum([TOP - 1, *(np.where(np.arange(points - 1) % 2, 1, -1) * sizes)]).tolist()


def test_when_there_is_no_room_the_oldest_range_is_half_a_cycle(counting):
    history = converging(POINTS + 9)
    halves, life = board_halves(counting, history)
    assert (life.full, life.points) == (9, POINTS)
    assert halves == package_halves(history)  # as in the package, unless it closes later
    # Closed by the largest range that there can be, each that was left out is off by half a cycle.
    closed = [*history, TOP if history[-1] < history[-2] else -TOP]
    halves, life = board_halves(counting, closed)
    assert 0 < np.abs(np.subtract(halves, package_halves(closed))).sum() <= 2 * life.full
    # Where there is room nothing is off.
    short = converging(POINTS - 1)
    halves, life = board_halves(counting, [*short, -TOP])
    assert (halves, life.full) == (package_halves([*short, -TOP]), 0)


# -- on the board, which measures ------------------------------------------------------------------


MOST_rad = 0.35
CURVE = {"range_rad": 0.3, "cycles": 100.0, "exponent": 5.0, "warn_share": 0.5}


@pytest.fixture(scope="module", params=["sim", pytest.param("sim-q31", marks=pytest.mark.ci)])
def powered(request, elbow):
    require_tool("gcc")
    board = SimBoard(elbow, board=request.param)
    yield board
    board.close()


@pytest.fixture
def board(powered):
    """A board that has never been used."""
    powered.restart(blank=True)
    return powered


def bear(board, angles):
    """Deflect the coupling so; its torques as told."""
    torques = []
    for angle in angles:
        board.measure(theta_rad=angle)
        board.step()
        torques.append(board.values[board.places["tau_Nm"]])
    return np.array(torques)


def swings(count, most_rad=0.2):
    """So many swings, of 40 samples each, within a slow rise."""
    at = np.arange(40 * count)
    return most_rad * np.sin(2 * np.pi * at / 40) * (0.4 + 0.6 * at / at[-1])


def rest(board, seconds=11):
    board.ticks(1000 * seconds)


def test_the_board_counts_what_its_sensor_measures(board, elbow):
    angles = np.float32(swings(30))
    angles[200:210] = np.nan  # not believed: counted neither as cycle nor as energy
    torques = bear(board, angles)
    (told,) = coupling_lives(board)
    known = angles[~np.isnan(angles)].astype(np.float64)
    assert told.halves == tuple(package_halves(np.rint(known * TOP / MOST_rad)))
    assert sum(told.halves) == pytest.approx(2 * 30, abs=2)
    assert (told.serial, told.axis, told.full) == (0, 0, 0)
    assert told.width_rad == pytest.approx(2 * MOST_rad / CLASSES, rel=1e-6)
    steps = np.diff(angles) * (torques[1:] + torques[:-1]) / 2
    assert told.energy_J == pytest.approx(np.nansum(steps), abs=2e-5)
    assert told.energy_J > 0.1
    assert told.seconds == 1


def test_what_it_bore_is_kept_through_a_power_cut_at_any_byte(board):
    """Saved while the joint rests; a set that is cut gives the one before, whole."""
    bear(board, swings(20))
    rest(board, 61)
    (before,) = coupling_lives(board)
    board.restart()
    (first,) = coupling_lives(board)
    assert (first.halves, first.seconds) == (before.halves, 60)
    assert first.energy_J == pytest.approx(before.energy_J, abs=1e-3)
    old = [bytes(a) for a in board.flash]
    bear(board, swings(10, 0.3))
    rest(board, 61)
    new = [bytes(a) for a in board.flash]
    board.restart()
    (second,) = coupling_lives(board)
    assert second.halves != first.halves
    changed = [(k, i) for k in range(2) for i in range(len(old[k])) if old[k][i] != new[k][i]]
    seen = set()
    for cut in [*range(0, len(changed), 31), len(changed) - 1, len(changed)]:
        for area, content in zip(board.flash, old, strict=True):
            area[:] = content
        for k, i in changed[:cut]:
            board.flash[k][i] = new[k][i : i + 1]
        board.restart()
        (told,) = coupling_lives(board)
        assert (told.halves, told.seconds) in (
            (first.halves, first.seconds),
            (second.halves, second.seconds),
        )
        seen.add(told.halves)
    assert seen == {first.halves, second.halves}


def test_each_coupling_has_its_own_count_by_its_number(board):
    bear(board, swings(12))
    (unnamed,) = coupling_lives(board)
    name_coupling(board, 0, 71)  # what it bore before anybody said is its own
    (named,) = coupling_lives(board)
    assert (named.serial, named.halves) == (71, unnamed.halves)
    name_coupling(board, 0, 72)
    fitted, aside = coupling_lives(board)
    assert (fitted.serial, fitted.axis, sum(fitted.halves)) == (72, 0, 0)
    assert (aside.serial, aside.axis, aside.halves) == (71, None, unnamed.halves)
    bear(board, swings(3))
    board.restart()
    name_coupling(board, 0, 71)
    fitted, aside = coupling_lives(board)
    assert (fitted.serial, fitted.halves, aside.serial) == (71, unnamed.halves, 72)
    for serial in (73, 74):
        name_coupling(board, 0, serial)
    with pytest.raises(LinkError, match="no room"):
        name_coupling(board, 0, 75)
    with pytest.raises(LinkError, match="no coupling in store"):
        forget_coupling(board, 74)  # it is fitted
    forget_coupling(board, 72)
    name_coupling(board, 0, 75)
    board.restart()
    assert [x.serial for x in coupling_lives(board)] == [75, 71, 73, 74]
    for axis, serial, why in ((0, 0, "a serial"), (0, 2**32, "a serial"), (1, 5, "stores no")):
        with pytest.raises(LinkError, match=why):
            name_coupling(board, axis, serial)


# -- the host --------------------------------------------------------------------------------------


def with_curve(device):
    given = {n: Quantity(value=v, status="assumed", source="a test") for n, v in CURVE.items()}
    return Device(device.file.model_copy(update={"fatigue": Fatigue(**given)}), device.origin)


def test_the_command_tells_and_warns(board, elbow, monkeypatch, tmp_path):
    stand_in = SimpleNamespace(session=board, simulated=True, address=SimpleNamespace(kind="sim"))
    monkeypatch.setattr(commands, "open_device", lambda *_: nullcontext(stand_in))
    bear(board, swings(60))

    def run(device, *asked):
        stand_in.identity = SimpleNamespace(device=device)
        return CliRunner().invoke(app, ["life", "sim:elbow", *asked])

    target = tmp_path / "life.json"
    plain = run(elbow, "--coupling", "71", "--json", str(target))
    assert "not known (the device file has no [fatigue])" in plain.output
    assert "coupling 71, axis 0:" in plain.output
    assert "A simulated board" in plain.output
    assert warn_of_life(stand_in) == []
    content = json.loads(target.read_text())
    held("host-life", content)
    assert content["couplings"][0]["life_used"] is None
    assert content["fatigue"] is None
    known = with_curve(elbow)
    told = run(known, "--json", str(target))
    content = json.loads(target.read_text())
    held("host-life", content)
    used = content["couplings"][0]["life_used"]
    assert content["fatigue"] == known.file.fatigue.model_dump()
    cycles = [n for _, _, n, *_ in rainflow.extract_cycles(swings(60))]
    ranges = [r for r, *_ in rainflow.extract_cycles(swings(60))]
    whole = sum(n * (r / 0.3) ** 5 / 100 for r, n in zip(ranges, cycles, strict=True))
    assert used["least"] < whole < used["most"] < 1.4 * whole
    assert used["most"] > 0.5
    assert "WARNING: life used: " in told.output
    (said,) = warn_of_life(stand_in)
    assert said.startswith("WARNING, coupling 71: life used: ")
    assert "2 serial numbers for 1 couplings" in str(
        run(known, "--coupling", "1", "--coupling", "2").exception
    )


def test_a_coupling_can_move_to_the_axis_of_another(monkeypatch):
    device = load_device("wrist")
    stand_in = SimpleNamespace(session=SimBoard(device), simulated=True)
    stand_in.identity = SimpleNamespace(device=device)
    monkeypatch.setattr(commands, "open_device", lambda *_: nullcontext(stand_in))
    for serials in (("11", "12"), ("12", "13")):
        asked = [word for s in serials for word in ("--coupling", s)]
        assert not CliRunner().invoke(app, ["life", "sim:wrist", *asked]).exception
    assert [x.serial for x in coupling_lives(stand_in.session)] == [12, 13, 11]
    twice = CliRunner().invoke(app, ["life", "sim:wrist", *["--coupling", "14"] * 2])
    assert "2 serial numbers for 2 couplings: 14, 14." in str(twice.exception)
    assert [x.serial for x in coupling_lives(stand_in.session)] == [12, 13, 11]
    error = CliRunner().invoke(app, ["life", "sim:wrist", "--forget", "12"]).exception
    assert "another number first" in error.fix
