"""Non-volatile data over the link: zeros by serial number, use counters, the black box."""

from __future__ import annotations

import re
import zlib
from contextlib import nullcontext
from types import SimpleNamespace

import cffi
import pytest
from typer.testing import CliRunner

from esea_gen.board.blackbox import blackbox_csv, read_record
from esea_gen.emit.states import BOARD_FAULTS
from esea_gen.link.kept import kept_use, name_encoders, read_blackbox, release_blackbox
from esea_gen.link.transport import LinkError
from esea_host.cli import app
from esea_host.cli import board as commands
from tests.sim_drive import ANGLES, active, texts, zeroed

WATCHDOG = next(f.value for f in BOARD_FAULTS if f.name == "WATCHDOG")


@pytest.fixture
def board(powered):
    """A board that has never been used."""
    powered.lib.sim_stop_line(False)
    powered.lib.sim_blackbox_release()
    powered.restart(blank=True)
    powered.measure(**ANGLES)
    powered.ticks(20)
    return powered


def again(board, **angles: float) -> str:
    """Power off and on; the state that it comes to."""
    board.restart()
    board.measure(**ANGLES | angles)
    board.ticks(20)
    return board.state_now


def test_a_zero_of_encoders_that_nobody_named_lasts_until_power_off(board):
    zeroed(board)
    assert kept_use(board).zero == "taken"
    assert kept_use(board).encoders == ((0, None), (0, None))
    assert again(board) == "UNREFERENCED"
    assert kept_use(board).zero == "none"


def test_the_zero_of_named_encoders_is_put_back(board):
    assert name_encoders(board, [11, 12]).encoders == ((11, None), (12, None))
    board.ticks(20)
    assert board.state_now == "UNREFERENCED"
    zeroed(board)
    taken = board.parameter("encoder_motor.zero_rad"), board.parameter("encoder_load.zero_rad")
    assert taken[0] != taken[1]
    assert again(board) == "READY"
    told = kept_use(board)
    assert told.zero == "put back"
    assert told.encoders == ((11, taken[0]), (12, taken[1]))
    assert board.parameter("encoder_motor.zero_rad") == taken[0]
    assert board.parameter("encoder_load.zero_rad") == taken[1]
    active(board, 0.2, 5)  # it can be worked with
    board.disarm()
    board.ticks(600)
    board.reset()  # and a reset puts it back too
    board.ticks(20)
    assert board.state_now == "READY"


def test_a_zero_belongs_to_the_encoder_not_to_its_place(board):
    name_encoders(board, [11, 12])
    board.ticks(20)
    zeroed(board)
    zeros = dict(kept_use(board).encoders)
    for serials, state in (([11, 13], "UNREFERENCED"), ([12, 11], "READY"), ([0, 12], None)):
        name_encoders(board, serials)
        assert board.state_now == (state or "UNREFERENCED")
    name_encoders(board, [12, 11])
    assert board.parameter("encoder_motor.zero_rad") == zeros[12]


def test_what_makes_a_kept_zero_invalid(board):
    name_encoders(board, [11, 12])
    board.ticks(20)
    zeroed(board)
    # A zeroing that does not succeed: somebody found the old one wrong.
    board.zero()
    for k in range(230):
        board.measure(**ANGLES | {"count_motor": 700.0 + k})
        board.ticks(1)
    assert board.state_now == "UNREFERENCED"
    assert again(board) == "UNREFERENCED"
    # A fault of the sensors under torque.
    zeroed(board)
    assert again(board) == "READY"
    active(board, 0.2, 5)
    board.measure(**ANGLES | {"frame_error_load": 64.0})
    board.ticks(20)
    assert board.state_now == "FAULT"
    assert again(board) == "UNREFERENCED"
    # An encoder that slips while the motor is off.
    zeroed(board)
    board.measure(**ANGLES | {"count_load": 1900.0})
    board.ticks(60)
    assert board.state_now == "READY"
    assert kept_use(board).encoders == ((11, None), (12, None))
    assert again(board, count_load=1900.0) == "UNREFERENCED"


def test_a_fault_that_has_nothing_to_do_with_sensors_leaves_the_zero(board):
    name_encoders(board, [11, 12])
    board.ticks(20)
    zeroed(board)
    active(board, 0.2, 5)
    board.lib.sim_tick(5, True)  # lost ticks: CLOCK
    board.ticks(20)
    assert board.state_now == "FAULT"
    assert again(board) == "READY"


def test_encoders_are_named_with_the_motor_off_and_once_each(board):
    with pytest.raises(LinkError, match="one serial number"):
        name_encoders(board, [11, 11])
    for wrong in ([1, 2, 3, 4, 5], [-1, 2], [2**32, 1]):
        with pytest.raises(LinkError, match="not serial numbers"):
            name_encoders(board, wrong)
    zeroed(board)
    active(board, 0.2, 5)
    with pytest.raises(LinkError, match="motor off"):
        name_encoders(board, [11, 12])
    assert kept_use(board).encoders == ((0, None), (0, None))


def test_of_what_is_kept_it_says_what_is_so(board):
    def moved() -> list[str]:
        board.zero()
        for k in range(230):
            board.measure(**ANGLES | {"count_motor": 700.0 + k})
            board.ticks(1)
        board.measure(**ANGLES)
        return texts(board)

    def named() -> tuple[list[str], list[int]]:
        board.send(board.message("ESEA_KEPT", [11, 12, 13, 0], [0.0] * 4, *[0] * 9))
        answers = board.pending()
        told = next(m for m in answers if m.get_type() == "ESEA_KEPT")
        return [m.text for m in answers if m.get_type() == "STATUSTEXT"], list(told.serial)

    texts(board)
    assert moved() == []  # nothing was kept that could be forgotten
    assert named() == ([], [11, 12, 0, 0])  # the drive has two; it is saved, so that none is said
    zeroed(board)
    assert texts(board) == []
    assert moved() == ["the kept zero is no longer used"]


def test_a_cut_while_a_zero_is_kept_leaves_the_old_one_or_the_new_one(board):
    """The zero is in the set that the store keeps whole; here: half of its bytes are not there."""
    name_encoders(board, [11, 12])
    board.ticks(20)
    zeroed(board)
    old = dict(kept_use(board).encoders)
    whole = [bytes(a) for a in board.flash]
    board.measure(**ANGLES | {"count_motor": 740.0})
    board.ticks(60)
    zeroed(board, count_motor=740.0)
    new = dict(kept_use(board).encoders)
    assert new[11] != old[11]
    after = [bytes(a) for a in board.flash]
    seen = set()
    changed = [(k, i) for k in range(2) for i in range(len(whole[k])) if whole[k][i] != after[k][i]]
    for cut in range(0, len(changed) + 1, 40):
        for area, content in zip(board.flash, whole, strict=True):
            area[:] = content
        for k, i in changed[:cut]:
            board.flash[k][i] = after[k][i : i + 1]
        assert again(board) == "READY"
        seen.add(dict(kept_use(board).encoders)[11])
    for area, content in zip(board.flash, after, strict=True):
        area[:] = content
    again(board)
    seen.add(dict(kept_use(board).encoders)[11])
    assert seen == {old[11], new[11]}


def test_use_is_counted_and_outlasts_the_power(board):
    assert kept_use(board).counters["starts"] == 1
    zeroed(board)
    board.arm()
    for _ in range(11):  # 2.2 s with the motor on
        board.want(mode=0.0)
        board.ticks(200)
    assert board.state_now == "ARMED"
    board.lib.sim_tick(5, True)
    board.ticks(5)
    assert again(board) == "UNREFERENCED"
    board.trouble(WATCHDOG)
    board.restart()
    board.ticks(5)
    told = kept_use(board).counters
    saves = told.pop("saves")
    assert told == {"starts": 3, "armings": 1, "faults": 2, "watchdog_resets": 1, "active_s": 2}
    assert saves >= 3  # a start and a fault each


@pytest.mark.parametrize("place", [0, 17, 31])
def test_a_key_of_one_byte_that_is_not_zero_is_a_key(board, place):
    enum = board.dialect
    key = bytearray(32)
    key[place] = 1
    board.send(board.message("SETUP_SIGNING", 1, 1, list(key), 0))
    board.restart()
    assert board.command(enum.MAV_CMD_USER_1) == enum.MAV_RESULT_DENIED
    board.sign_with(bytes(key))
    board.reset()
    board.sign_with(None)


# -- black box -------------------------------------------------------------------------------------


def sets(board):
    """Every set in the flash: its area and where in it."""
    for area in board.flash:
        size = 28 + int.from_bytes(area[8:12], "little")
        for at in range(0, len(area) - size + 1, size):
            if area[at : at + 4] == b"1ASE":
                yield area, at, size


def test_counters_do_not_replace_the_set_of_another_device(board):
    zeroed(board)
    for area, at, size in sets(board):
        area[at + 12] = bytes([area[at + 12][0] ^ 1])  # the device
        whole = bytes(area[at : at + 20]) + bytes(area[at + 24 : at + size - 4])
        area[at + 20 : at + 24] = zlib.crc32(whole).to_bytes(4, "little")
    before = [bytes(area) for area in board.flash]
    assert again(board) == "UNREFERENCED"
    assert [bytes(area) for area in board.flash] == before


@pytest.fixture
def frozen(board):
    """A board whose black box holds a fault."""
    zeroed(board)
    active(board, 0.2, 5)
    board.ticks(30)
    board.lib.sim_tick(5, True)
    board.ticks(3)
    assert board.state_now == "FAULT"
    return board


def test_the_black_box_comes_over_the_link_as_it_is(frozen, drive):
    told = []
    found = read_blackbox(frozen, lambda done, all_: told.append((done, all_)))
    assert found.fault == 13  # CLOCK
    assert [read_record(drive, r) for r in found.records] == frozen.blackbox()
    assert len(found.records) == frozen.lib.sim_blackbox_count() > 250
    assert told[-1] == (len(found.records),) * 2
    assert found.tick == frozen.lib.sim_blackbox_tick()
    table = blackbox_csv([read_record(drive, r) for r in found.records]).splitlines()
    assert len(table) == 1 + len(found.records)
    last = dict(zip(table[0].split(","), table[-1].split(","), strict=True))
    assert (last["state"], last["fault"], last["count_motor"]) == ("FAULT", "13", "700.0")


def test_a_record_that_is_corrupt_is_told(frozen):
    size = frozen.lib.sim_blackbox_bytes()
    memory = cffi.FFI().buffer(frozen.lib.sim_blackbox_memory(), size)
    memory[36 + 52 * 20 + 30] = bytes([memory[36 + 52 * 20 + 30][0] ^ 4])
    assert [k for k, r in enumerate(read_blackbox(frozen).records) if r is None] == [20]


def test_it_is_released_by_who_may_command(frozen, tmp_path):
    release_blackbox(frozen)
    assert read_blackbox(frozen) is None
    assert frozen.lib.sim_blackbox_count() == 0


def test_a_stranger_reads_it_and_does_not_release_it(frozen, tmp_path):
    frozen.pair(tmp_path / "key")
    frozen.sign_with(None)
    assert len(read_blackbox(frozen).records) > 250
    with pytest.raises(LinkError, match="not released"):
        release_blackbox(frozen)
    assert frozen.lib.sim_blackbox_count() > 250
    frozen.use_key(tmp_path / "key")
    release_blackbox(frozen)


# -- the commands ----------------------------------------------------------------------------------


@pytest.fixture
def run(board, drive, monkeypatch):
    about = {"identity": SimpleNamespace(device=drive), "simulated": True}
    stand_in = SimpleNamespace(session=board, **about)
    monkeypatch.setattr(commands, "open_device", lambda *_: nullcontext(stand_in))
    return lambda *asked: CliRunner().invoke(app, [*asked])


def test_the_commands_show_and_name_and_read(run, board, tmp_path):
    assert "not named" in run("kept", "sim:elbow_drive").output
    named = run("kept", "sim:elbow_drive", "--encoder", "11", "--encoder", "12")
    assert "encoder_motor: serial 11, no zero" in named.output
    board.ticks(20)
    zeroed(board)
    told = run("kept", "sim:elbow_drive").output
    assert "zero in force: taken" in told
    assert "serial 12, zero " in told
    assert "watchdog resets 0" in told
    few = run("kept", "sim:elbow_drive", "--encoder", "11")
    assert "encoder_motor, encoder_load" in str(few.exception)
    table = tmp_path / "box.csv"
    assert "not frozen" in str(run("blackbox", "sim:elbow_drive", "--out", str(table)).exception)
    active(board, 0.2, 5)
    board.lib.sim_tick(5, True)
    board.ticks(3)
    done = run("blackbox", "sim:elbow_drive", "--out", str(table), "--release")
    assert "frozen by fault 13" in done.output
    head = "tick,state,fault,on,stop_held,u_Nm,limits_fault,mode,.*,simulated\n"
    assert re.match(f"{head}[0-9].*,1\n", table.read_text())
    assert board.lib.sim_blackbox_count() == 0
