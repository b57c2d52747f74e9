"""Driver of a moteus drive: frames against the maker's codec, and the complete sequence."""

from __future__ import annotations

import io
import math
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from moteus import multiplex
from moteus.protocol import Register, Writer, scale_register

import esea_gen
from esea_gen.board.moteus import MoteusDrive
from esea_gen.emit.states import BOARD_FAULTS
from esea_host.simulated.moteus import MoteusJoint
from tests.moteus_bench import MoteusBoard

FAULTS = {f.name: f.value for f in BOARD_FAULTS}
FIELDS = {
    Register.MODE: ("mode", Writer.write_int),
    Register.POSITION: ("output_rev", Writer.write_position),
    Register.VELOCITY: ("output_rev_s", Writer.write_velocity),
    Register.TORQUE: ("torque_Nm", Writer.write_torque),
    Register.MOTOR_TEMPERATURE: ("motor_C", Writer.write_temperature),
    Register.VOLTAGE: ("voltage_V", Writer.write_voltage),
    Register.TEMPERATURE: ("board_C", Writer.write_temperature),
    Register.FAULT: ("fault", Writer.write_int),
    Register.ENCODER_VALIDITY: ("valid", Writer.write_int),
    Register.MILLISECOND_COUNTER: ("counter", Writer.write_int),
    Register.REGISTER_MAP_VERSION: ("registers", Writer.write_int),
}
KINDS = (multiplex.INT8, multiplex.INT16, multiplex.INT32, multiplex.F32)
FLOATS = st.floats(width=32)


@pytest.fixture(scope="module")
def c(built_drivers):
    return built_drivers.ffi, built_drivers.lib


def commanded(c, *given_):
    ffi, lib = c
    frame = ffi.new("uint8_t[64]")
    return bytes(ffi.buffer(frame, lib.esea_moteus_command(frame, *given_)))


@given(st.booleans(), FLOATS, FLOATS, FLOATS)
def test_the_maker_reads_a_bounded_torque_or_a_stop(c, on, torque, most, watchdog):
    frame = commanded(c, on, torque, most, watchdog)
    assert len(frame) in (8, 12, 16, 20, 24, 32, 48, 64)
    parts = list(multiplex.parse_frame(frame))
    writes = {p.register: p.value for p in parts if p.type is multiplex.SubframeType.WRITE}
    sound = on and all(map(math.isfinite, (torque, most, watchdog))) and watchdog > 0
    assert next(iter(writes)) == Register.MODE  # before any other
    assert writes.pop(Register.MODE) == (10 if sound else 0)
    assert bool(writes) == sound
    if sound:
        assert math.isnan(writes.pop(Register.COMMAND_POSITION))
        assert writes == {
            Register.COMMAND_VELOCITY: 0,
            Register.COMMAND_FEEDFORWARD_TORQUE: torque,
            Register.COMMAND_KP_SCALE: 0,
            Register.COMMAND_KD_SCALE: 0,
            Register.COMMAND_POSITION_MAX_TORQUE: most,
            Register.COMMAND_TIMEOUT: watchdog,
            Register.COMMAND_ILIMIT_SCALE: 0,
        }
    asked = {p.register for p in parts if p.type is multiplex.SubframeType.READ}
    assert asked == {*FIELDS, 0x050, 0x052, 0x054} - {Register.REGISTER_MAP_VERSION}


def replied(c, data, drive=None):
    ffi, lib = c
    if drive is None:
        drive = ffi.new("esea_moteus_t *")
        lib.esea_moteus_start(drive)
    return lib.esea_moteus_take(drive, data, len(data)), drive


@given(st.sampled_from([*FIELDS, 0x050, 0x052, 0x054]), st.sampled_from(KINDS), st.data())
def test_every_register_in_every_format_is_the_makers_value(c, register, kind, data):
    bits = (8, 16, 32)[kind] if kind != multiplex.F32 else None
    ends = (-(1 << bits - 1), (1 << bits - 1) - 1) if bits else None
    raw = data.draw(st.integers(*ends) | st.sampled_from(ends) if bits else FLOATS)
    out = io.BytesIO()
    writer = Writer(out)
    writer.write_int8(multiplex.REPLY_BASE | kind << 2 | 1)
    writer.write_varuint(register)
    writer.write(raw, kind)
    good, drive = replied(c, out.getvalue())
    assert good
    slot = (register - 0x050) // 2
    value = getattr(drive, FIELDS[register][0]) if register in FIELDS else drive.slot_rev[slot]
    scaled = Register.POSITION if register not in FIELDS else register
    missing = bits and raw == ends[0]
    exact = math.nan if missing else float(scale_register(scaled, kind, raw)) if bits else raw
    assert value == pytest.approx(np.float32(exact), rel=2e-7, nan_ok=True)


@given(st.binary(max_size=64))
def test_no_bytes_do_harm_and_what_is_cut_changes_nothing(c, data):
    ffi, lib = c
    drive = ffi.new("esea_moteus_t *")
    lib.esea_moteus_start(drive)
    before = bytes(ffi.buffer(drive))
    if not replied(c, data, drive)[0]:
        assert bytes(ffi.buffer(drive)) == before
    lib.esea_moteus_heard(b"rcv 100 " + data.replace(b"\0", b"") + b"\0", ffi.new("uint16_t *"),
                          ffi.new("uint8_t[64]"))  # fmt: skip
    length = ffi.new("size_t *")
    assert lib.esea_moteus_text(data, len(data), length) == ffi.NULL or length[0] + 3 <= len(data)


@given(st.binary(min_size=1, max_size=64), st.integers(0, 0xFFFF))
def test_lines_go_to_the_adapter_and_come_back(c, data, number):
    ffi, lib = c
    line = ffi.new("char[160]")
    sent = bytes(ffi.buffer(line, lib.esea_moteus_line(line, number, data, len(data)))).decode()
    assert sent == f"can send {number:04x} {data.hex()}\n"
    frame, came = ffi.new("uint8_t[64]"), ffi.new("uint16_t *")
    for end in ("", "\r\n", " E B F 1"):
        text = f"rcv {number:x} {data.hex().upper()}{end}".encode()
        assert lib.esea_moteus_heard(text, came, frame) == len(data)
        assert (came[0], bytes(ffi.buffer(frame, len(data)))) == (number, data)


@given(st.text(alphabet="0123456789abcdefx can sed", max_size=40) | st.binary(max_size=20))
def test_the_emulated_drive_answers_any_line(given_):
    words = given_ if isinstance(given_, str) else f"can send 8001 {given_.hex()}"
    assert MoteusDrive().line(words).startswith(("OK", "ERR"))


# -- on the application, in lockstep with the emulated drive ---------------------------------------


class Bench:
    """A board, and a virtual joint at its drive."""

    def __init__(self, board):
        self.board, self.joint = board, board.joint

    def ticks(self, count=1, wish_Nm=None):
        for k in range(count):
            if wish_Nm is not None and k % 5 == 0:
                self.board.want(mode=1.0, tau_desired_Nm=wish_Nm)
            self.board.step()
            self.joint.move()

    @property
    def state(self):
        return self.board.state_now


@contextmanager
def bench(person="none", rotor_side=False, can=False, **settings):
    joint = MoteusJoint("elbow_drive", person=person, rotor_side=rotor_side)
    joint.drive.settings |= settings
    board = MoteusBoard(esea_gen.load_device("elbow_drive"), joint, rotor_side, can)
    try:
        yield Bench(board)
    finally:
        board.close()


@contextmanager
def driven(person="none", wish_Nm=0.5, can=False):
    """Zeroed, armed, and at a torque."""
    with bench(person, can=can) as it:
        it.ticks(50)
        it.board.zero()
        it.ticks(250)
        assert it.state == "READY"
        it.board.arm()
        it.ticks(2)
        it.ticks(600, wish_Nm)
        assert it.state == "ACTIVE"
        yield it


@pytest.mark.parametrize(("wish_Nm", "can"), [(0.5, False), (-0.5, False), (0.5, True)])
def test_from_zero_to_torque_and_a_stop(wish_Nm, can):
    """Of SocketCAN the kernel's calls are a stand-in's."""
    with driven(wish_Nm=wish_Nm, can=can) as it:
        assert it.joint.plant.truth()["tau_e_Nm"] == pytest.approx(wish_Nm, abs=0.15)
        assert it.board.info().board.rstrip("\0") == "linux-sim"  # so that it is marked simulated
        assert it.joint.drive.torque_Nm * wish_Nm > 0
        it.board.stop()
        it.board.stop()  # the second switches off at once
        it.ticks(2)
        assert it.state == "STOPPED"
        assert (it.joint.drive.mode, it.joint.drive.torque_Nm) == (0, 0.0)


def test_a_dead_drive_latches_within_its_bound():
    with driven() as it:
        it.joint.drive.silent = True
        it.ticks(7)
        assert (it.state, it.board.lib.sim_fault()) == ("FAULT", FAULTS["DRIVE_SILENT"])


def test_an_unplugged_cable_ends_the_torque_at_both_ends():
    with driven() as it:
        it.board.cut = True  # the drive hears, the board does not
        it.ticks(7)
        assert it.state == "FAULT"
        assert it.joint.drive.torque_Nm == 0.0
        mode = it.joint.drive.mode
    with driven() as it:
        for _ in range(25):  # the board says nothing more
            it.joint.tick()
        assert it.joint.drive.torque_Nm == 0.0
        assert (mode, it.joint.drive.mode) == (0, 11)


def test_a_fault_of_the_drive_latches_at_once_and_a_limit_soon():
    with driven() as it:
        it.joint.drive.fail(33)
        it.ticks(2)
        assert (it.state, it.board.lib.sim_fault()) == ("FAULT", FAULTS["DRIVE"])
    with driven() as it:
        it.joint.drive.limit_Nm = 0.1
        it.ticks(25, 0.5)
        assert (it.state, it.board.lib.sim_fault()) == ("FAULT", FAULTS["DRIVE"])


def test_a_drive_that_was_away_is_not_armed_on_the_turns_it_forgot():
    """A rotor's whole turn is 4.9 deg of the joint; silence or a counter set back tells."""
    for away in (400, 2):
        with bench() as it:
            it.ticks(50)
            it.board.zero()
            it.ticks(250)
            it.board.cut = True
            it.ticks(away)
            it.board.cut = False
            it.joint.drive.restart()
            it.ticks(10)
            assert it.state == "FAULT"
            it.board.reset()
            it.ticks(30)
            assert it.state == "UNREFERENCED"


def test_without_an_encoder_on_the_motor_side_no_zero_is_kept(capfd):
    with bench(rotor_side=True):  # the board `sim` has a store
        assert "--keep" in capfd.readouterr().err
    with bench():
        assert "encoder 2" in capfd.readouterr().err


def test_late_answers_are_bridged_and_then_stop():
    with driven() as it:
        it.board.cut = True
        it.ticks(3, 0.5)
        it.board.cut = False
        it.ticks(50, 0.5)
        assert it.state == "ACTIVE"


@pytest.mark.parametrize(
    ("setting", "value"),
    [("servo.timeout_mode", "12"), ("motor_position.rotor_to_output_ratio", "0.1")],
)
def test_a_drive_that_is_set_up_wrongly_is_refused(setting, value, capfd):
    with bench(**{setting: value}):
        said = capfd.readouterr().err
    assert setting in said
    assert "conf set" in said
