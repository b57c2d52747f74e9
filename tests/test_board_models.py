"""Models of a board's chips, its black box and its tape: words and bits typed by hand."""

from __future__ import annotations

import struct
from types import SimpleNamespace

import pytest

from esea_gen.board import blackbox, scripted
from esea_gen.board.blackbox import BlackboxRecord
from esea_gen.board.chips import (
    WIRE_FAULTS,
    Amplifier,
    As5048a,
    BissEncoder,
    Workbench,
    declarations,
    even_parity,
)
from esea_gen.board.scripted import BoardTape, TapedBoard
from esea_gen.board.sim import SimBoard, SimTransport
from esea_gen.link.transport import LinkError


def thing(**parts):
    return SimpleNamespace(**parts)


# -- chips -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("word", "sent"),
    [(0, 0), (1, 0x8001), (3, 3), (0x4000, 0xC000), (0x7FFF, 0xFFFF), (0x2AAA, 0xAAAA)],
)
def test_bit_15_makes_the_number_of_ones_even(word, sent):
    assert even_parity(word) == sent


READ_ANGLE, READ_NOTHING = b"\xff\xff", b"\xc0\x00"
READ_DIAGNOSTICS, READ_MAGNITUDE, READ_ERRORS = b"\x7f\xfd", b"\x7f\xfe", b"\x40\x01"


def test_an_answer_comes_in_the_frame_after_its_command():
    chip = As5048a(angle=0x1234, magnitude=0x0D00)
    assert chip.frame(READ_ANGLE) == b"\x00\x00"
    assert chip.frame(READ_MAGNITUDE) == b"\x92\x34"  # five ones, and the parity
    assert chip.frame(READ_NOTHING) == b"\x8d\x00"
    assert chip.frame(READ_ANGLE) == b"\x00\x00"


@pytest.mark.parametrize(
    ("what", "bits"),
    [({}, 0x160), ({"compensated": False}, 0x060), ({"overflow": True}, 0x360),
     ({"strong": True}, 0x560), ({"weak": True}, 0x960), ({"gain": 0x81}, 0x181)],
)  # fmt: skip
def test_diagnostics_bit_by_bit(what, bits):
    chip = As5048a(**what)
    chip.frame(READ_DIAGNOSTICS)
    assert chip.frame(READ_NOTHING) == even_parity(bits).to_bytes(2, "big")


def test_a_wrong_frame_is_told_until_its_error_is_read():
    for wrong, bit in ((b"\x7f\xff", 4), (b"\x80\x02", 2), (b"\x12\x34\x56", 1), (b"", 1)):
        chip = As5048a(angle=3)
        chip.frame(READ_ANGLE)
        assert len(chip.frame(wrong)) == len(wrong)
        if bit == 1:  # the chip was not asked: what it would have answered stays
            assert chip.frame(READ_ANGLE) == b"\x00\x03"
        else:
            assert chip.frame(READ_ANGLE) == b"\xc0\x00"
        assert chip.frame(READ_ERRORS) == even_parity(0x4003).to_bytes(2, "big")
        assert chip.frame(READ_ANGLE) == even_parity(bit).to_bytes(2, "big")
        assert chip.frame(READ_ERRORS) == b"\x00\x03"
        assert chip.frame(READ_NOTHING) == b"\x00\x00"


def test_a_biss_frame_bit_by_bit():
    chip = BissEncoder(position=0b101, bits=3, waits=(1, 2))
    # Data 101, no error, no warning; its checksum by hand: 10111 000000 mod 1000011.
    value = 0b10111 << 6
    for k in range(10, 5, -1):
        if value >> k & 1:
            value ^= 0b1000011 << (k - 6)
    line = "1" + "00" + "10" + "101" + "11" + f"{value ^ 0b111111:06b}" + "0"
    assert chip.frame(bytes(3)) == int(line.ljust(24, "1"), 2).to_bytes(3, "big")
    assert chip.frame(bytes(1)) == int(line[:8], 2).to_bytes(1, "big")
    assert chip.crc("10111") == f"{value ^ 0b111111:06b}"
    assert BissEncoder().crc("0") == "111111"
    assert BissEncoder().crc("1") == "111100"  # x^6 is x + 1
    sick = BissEncoder(position=0b101, bits=3, waits=(1, 2), error=True, warning=True)
    first = int.from_bytes(sick.frame(bytes(2)), "big")
    assert f"{first:016b}"[:10] == "1" + "00" + "10" + "101" + "00"


def test_a_motors_current_and_its_converter():
    motor = Amplifier(full_A=5.0, A_count=0.005, lag=0.25, gain=0.8, duty=7000)
    motor.tick()
    assert (motor.current_A, motor.counts) == (0.0, 2048)
    motor.enabled = True
    motor.tick()  # half of the range is 2.5 A, of which 0.8 flow, a quarter of the way
    assert motor.current_A == pytest.approx(0.5)
    assert motor.counts == 2148
    motor.tick()
    assert motor.current_A == pytest.approx(0.5 + 0.25 * 1.5)
    motor.duty = 3000
    motor.tick()
    assert motor.current_A == pytest.approx(0.875 + 0.25 * (-2.0 - 0.875))
    for current_A, counts in ((10.235, 4095), (10.3, 4095), (-10.24, 0), (-11.0, 0), (-5.0, 1048)):
        motor.current_A = current_A
        assert motor.counts == counts
    motor.stuck_counts = 0
    assert motor.counts == 0


def test_a_chip_is_sound_as_it_comes():
    assert vars(As5048a()) == {
        **{"angle": 0x1234, "gain": 0x60, "magnitude": 0x0D00, "compensated": True},
        **dict.fromkeys(("overflow", "strong", "weak", "error_flag"), False),
        **{"errors": 0, "answer": 0},
    }
    assert vars(BissEncoder()) == {
        **{"position": 0x1A2B3, "bits": 17, "error": False, "warning": False, "waits": (2, 5)},
    }
    assert vars(Amplifier()) == {
        **{"full_A": 5.0, "A_count": 0.005, "lag": 0.03, "gain": 1.0, "enabled": False},
        **{"duty": 5000, "current_A": 0.0, "stuck_counts": None},
    }


def test_a_bench_has_lines_wires_and_an_order():
    bench = Workbench(lines={1: lambda sent: sent + b"\x01", 2: lambda sent: b"\x12\x34"})
    assert bench.exchange(0, b"a") is None
    assert bench.exchange(1, b"a") == b"a\x01"
    for fault, came in (("stuck_low", b"\0\0"), ("stuck_high", b"\xff\xff"), ("swapped", b"4\x12")):
        bench.wires[2] = WIRE_FAULTS[fault]
        assert bench.exchange(2, b"") == came
    bench.put("pin", 3, 1)
    bench.put("duty", 3, 5000)
    bench.put("pin", 4, 0)
    assert (bench.pins, bench.duties) == ({3: True, 4: False}, {3: 5000})
    assert bench.done == [("pin", 3, 1), ("duty", 3, 5000), ("pin", 4, 0)]
    assert bench.converter(0) is None


def test_what_headers_declare(tmp_path):
    one, two = tmp_path / "a.h", tmp_path / "b.h"
    one.write_text("#pragma once\n/* a\n * comment */\ntypedef struct { int a; } a_t;\n")
    two.write_text(
        "static inline int f(int x)\n{\n    return x; /* in it */\n}\nint g(a_t *a);\n#endif\n"
    )
    assert declarations(one, two).split("\n") == [
        *("", "typedef struct { int a; } a_t;", "int g(a_t *a);", ""),
    ]


# -- the black box ---------------------------------------------------------------------------------


def external(name, size=1):
    return thing(name=name, port=thing(size=size))


@pytest.fixture
def boards(monkeypatch):
    """A drive and a device that only measures."""
    wanted = [external(n, k) for n, k in (("mode", 1), ("tau_Nm", 1), ("stop", 1), ("ahead", 3),
                                          ("rearm", 1))]  # fmt: skip
    measured = [external("count_load"), external("frame_error")]
    axes = [thing(u=f"u_{n}_Nm", fault=f"fault_{n}") for n in "ab"]
    drive = thing(axes=axes, drive=True, wanted=wanted, measured=measured)
    plain = thing(axes=[], drive=False, wanted=[external("theta_rad")], measured=measured[:1])
    monkeypatch.setattr(blackbox, "board_roles", lambda system: system.roles)
    monkeypatch.setattr(blackbox, "STATES", (thing(name="READY", value=2),))
    return {n: thing(system=thing(roles=r, base_period_s=0.001)) for n, r in (
        ("drive", drive), ("plain", plain),
    )}  # fmt: skip


def test_a_record_by_its_bytes(boards):
    drive, plain = boards["drive"], boards["plain"]
    assert blackbox.record_bytes(drive) == 16 + 4 * (2 + 1 + 3 + 2)
    assert blackbox.record_bytes(plain) == 16 + 4 * (2 + 1)
    assert blackbox.blackbox_records(drive) == 2000
    assert blackbox.blackbox_records(drive, 48 * 7 + 47) == 7
    assert blackbox.blackbox_records(drive, 10**6) == 2000
    flags = 2 | 1 << 2 | 5 << 3 | 0x40
    data = struct.pack(
        "<IHHBBBBB3x8f", 77, 88, 40001, 2, 9, flags, 0, 9, *(0.25, -2, 1.5, 2, 3, 4, 500, 1)
    )
    record = blackbox.read_record(drive, data)
    assert record == BlackboxRecord(
        *(40001, "READY", 9, True, False),
        {"u_a_Nm": 0.25, "u_b_Nm": -2.0},
        {"fault_a": 0, "fault_b": 9},
        {"mode": 2.0, "stop": 1.0, "rearm": 5.0, "tau_Nm": 1.5, "ahead": (2.0, 3.0, 4.0)},
        {"count_load": 500.0, "frame_error": 1.0},
    )
    data = struct.pack("<IHHBBBxf3f", 0, 0, 3, 7, 0, 0x80, -1.0, 0.5, 1.0, 600)
    other = blackbox.read_record(plain, data)
    assert (other.state, other.on, other.stop_held) == ("unknown 7", False, True)
    assert (other.wanted, other.measured) == (
        *({"theta_rad": 0.5, "mode": 1.0}, {"count_load": 600.0}),
    )
    lines = blackbox.blackbox_csv([record, record]).splitlines()
    assert lines == [
        "tick,state,fault,on,stop_held,u_a_Nm,u_b_Nm,limits_fault_a,limits_fault_b,"
        "mode,stop,rearm,tau_Nm,ahead[0],ahead[1],ahead[2],count_load,frame_error",
        *2 * ["40001,READY,9,1,0,0.25,-2.0,0,9,2.0,1.0,5.0,1.5,2.0,3.0,4.0,500.0,1.0"],
    ]
    assert blackbox.blackbox_csv([other]).splitlines()[1] == "3,unknown 7,0,0,1,0.5,1.0,600.0"
    assert blackbox.blackbox_csv([]) == "\n"


# -- the tape --------------------------------------------------------------------------------------


def numbers(text: str, name: str) -> list[list[int]]:
    """Rows of a table of the drivers that are compiled in."""
    body = text.split(f"{name}", 1)[1].split("= {", 1)[1].split(";", 1)[0]
    rows = body.replace("{", "|").replace("}", "|").split("|")
    return [[int(w.strip().rstrip("u"), 0) for w in r.split(",") if w.strip()]
            for r in rows if r.strip(" ,\n")]  # fmt: skip


def test_a_tape_as_the_drivers_of_a_board():
    tape = BoardTape(
        measured=[[1.0, -2.0], [0.5, 0.0], [3.0, 4.0]],
        frames={0: b"\x01\x02", 2: b"\x03", 3: b"\xff"},
        troubles={1: 5},
    )
    text = scripted._drivers(tape)
    assert "#define TICKS 3u\n" in text
    assert numbers(text, "measured[TICKS][ESEA_LINK_MEASURED]") == [
        [0x3F800000, 0xC0000000], [0x3F000000, 0], [0x40400000, 0x40800000],
    ]  # fmt: skip
    assert numbers(text, "bytes[]") == [[1, 2, 3, 255]]
    assert numbers(text, "until[TICKS + 1u]") == [[2, 2, 3, 4]]
    assert numbers(text, "troubles[TICKS]") == [[0, 5, 0]]
    assert "return at >= 4294967295u;" in text
    assert "at % 100u == 0u || at == TICKS" in text
    tape.stop_from = 0
    assert "return at >= 0u;" in scripted._drivers(tape)


@pytest.mark.parametrize(("ticks", "looks"), [(100, 1), (101, 2), (199, 2), (200, 2), (250, 3)])
def test_a_played_tape_gives_the_boards_own_motor_and_fault(monkeypatch, ticks, looks):
    done = []

    class Held:
        def __init__(self, image):
            assert image == "image"

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def hold_at(self, address):
            done.append(address)

        def run(self):
            done.append("run")

        def read(self, address, count):
            if address == 0x200:
                return struct.pack(f"<{count // 4}f", *range(count // 4))
            return bytes(k % 2 for k in range(count))

        def read_word(self, address):
            return address

    at = {"script_mark": 0x100, "script_motor": 0x200, "script_on": 0x300, "script_fault": 7}
    monkeypatch.setattr(scripted, "HeldProcessor", Held)
    monkeypatch.setattr(scripted, "addresses", lambda image: at)
    monkeypatch.setattr(scripted, "build_firmware", lambda d, board, folder, drivers: "image")
    tape = BoardTape([[float(k)] for k in range(ticks)], {1: b"f"}, {2: 3}, 4)
    found = scripted.play("device", "netduinoplus2", tape)
    assert done == [0x100, *looks * ["run"]]
    assert found.motor == [(k % 2 == 1, struct.pack("<f", k)) for k in range(ticks)]
    assert (found.fault, found.measured, found.frames) == (7, tape.measured, tape.frames)
    assert (found.troubles, found.stop_from) == ({2: 3}, 4)


def test_what_is_taped_of_a_run(monkeypatch):
    for name in ("restart", "measure", "send_bytes", "trouble"):
        monkeypatch.setattr(SimBoard, name, lambda self, *_, **__: None)
    told = iter([(True, 0.5), (False, -1.0), (True, 2.0), (True, 9.0)])
    monkeypatch.setattr(SimBoard, "motor", property(lambda self: next(told)))
    board = TapedBoard.__new__(TapedBoard)
    board.inputs = ["a", "b"]
    board.lib = thing(sim_fault=lambda: 12, sim_unique=lambda number: None)
    board.send_bytes(b"early")
    board.restart()
    board.send_bytes(b"0")
    board.measure(b=2.0)
    board.send_bytes(b"1")
    board.measure(a=1.0)
    board.trouble(4)
    board.send_bytes(b"2")
    board.send_bytes(b"3")
    board.measure(a=5.0, b=6.0)
    tape = board.taken()
    assert tape.measured == [[0.0, 2.0], [1.0, 0.0], [5.0, 6.0]]
    assert tape.frames == {0: b"01", 1: b"23"}
    assert tape.troubles == {1: 4}
    assert tape.motor == [(on, struct.pack("<f", u)) for on, u in (
        (True, 0.5), (False, -1.0), (True, 2.0),
    )]  # fmt: skip
    assert (tape.fault, board.taken().motor) == (12, tape.motor)


# -- the board in this process ---------------------------------------------------------------------


class Library:
    """A board's functions, which note how they are called."""

    def __init__(self) -> None:
        self.done: list[tuple] = []
        self.out = b""

    def __getattr__(self, name):
        def called(*arguments):
            self.done.append((name, *arguments))
            return 0

        return called

    def sim_take(self, into, most):
        assert most == 65536
        into[: len(self.out)] = self.out
        return len(self.out)


def test_a_serial_line_that_never_waits():
    lib = Library()
    ffi = thing(new=lambda kind: bytearray(65536), buffer=lambda b, n: b[:n])
    line = SimTransport(lib, ffi)
    lib.out = b"abc"
    assert line.read(0.0) == b"abc"
    lib.out = b""
    assert line.read(0.0) == b""
    with pytest.raises(LinkError, match="nothing more"):
        line.read(0.1)
    line.write(b"four", 1.0)
    assert lib.done[-2:] == [("sim_feed", b"four", 4), ("sim_poll",)]
    assert line.said() == ""


def test_ticks_readings_and_counts():
    board = SimBoard.__new__(SimBoard)
    board.lib = lib = Library()
    board.inputs, board.drivers = ["frame_a", "count_a", "x", "count_b"], [9.0] * 5
    board._encoders, board._words = [1, 3], "words"
    board.ticks(2)
    assert lib.done == 2 * [("sim_tick", 1, True), ("sim_poll",)]
    lib.done.clear()
    board.ticks(poll=False)
    assert lib.done == [("sim_tick", 1, True)]
    board.measure(x=2.0, frame_a=1.0)
    assert board.drivers == [1.0, 0.0, 2.0, 0.0, 9.0]
    with pytest.raises(ValueError, match=r"\['z'\] is not measured"):
        board.measure(z=1.0)
    board.show(iter([11, 12, 13]))
    assert board.drivers == [1.0, 11, 2.0, 12, 9.0]
    board.step()
    board.trouble(6)
    assert lib.done[-2:] == [("sim_step", board.drivers, "words"), ("sim_trouble", 6)]
