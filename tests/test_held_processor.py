"""A processor that is held, by the words of the debugger's protocol: the other end is made up."""

from __future__ import annotations

import re

import pytest

from esea_gen.board.gdb import HeldProcessor
from esea_gen.link.transport import LinkError


class Target:
    """A processor with registers, memory and a list of places where it stops.

    asked: packets as they came, without the words round them.
    """

    def __init__(self, stops=(), steps=()) -> None:
        self.registers = {n: 0x11111111 * (n % 15) for n in range(26)}
        self.memory: dict[int, int] = {}
        self.stops, self.steps = list(stops), list(steps)
        self.asked: list[str] = []
        self.out = b""
        self.pieces = 1 << 16

    def answer(self, text: str) -> str:
        if text in ("c", "s"):
            following = self.stops if text == "c" else self.steps
            if following:
                self.registers[15] = following.pop(0)
            return "T05"
        if found := re.fullmatch(r"p([0-9a-f]+)", text):
            return self.registers[int(found[1], 16)].to_bytes(4, "little").hex() + "00"
        if found := re.fullmatch(r"P([0-9a-f]+)=([0-9a-f]{8})", text):
            value = int.from_bytes(bytes.fromhex(found[2]), "little")
            self.registers[int(found[1], 16)] = value
        if found := re.fullmatch(r"m([0-9a-f]+),([0-9a-f]+)", text):
            at, count = (int(x, 16) for x in found.groups())
            return bytes(self.memory.get(at + k, (at + k) % 251) for k in range(count)).hex()
        if found := re.fullmatch(r"M([0-9a-f]+),([0-9a-f]+):([0-9a-f]*)", text):
            at, data = int(found[1], 16), bytes.fromhex(found[3])
            assert int(found[2], 16) == len(data)
            self.memory |= {at + k: b for k, b in enumerate(data)}
        return "E22" if text.startswith("Z1,bad") else "OK"

    def sendall(self, data: bytes) -> None:
        if data == b"+":
            return
        found = re.fullmatch(rb"\$(.*)#([0-9a-f]{2})", data, re.DOTALL)
        assert found is not None
        assert int(found[2], 16) == sum(found[1]) % 256
        text = found[1].decode()
        self.asked.append(text)
        said = self.answer(text).encode()
        self.out += b"+$" + said + b"#%02x" % (sum(said) % 256)

    def recv(self, most: int) -> bytes:
        count = min(self.pieces, most)
        data, self.out = self.out[:count], self.out[count:]
        return data


def held(target: Target) -> HeldProcessor:
    made = HeldProcessor.__new__(HeldProcessor)
    made._link, made._read, made._breaks, made.at = target, b"", set(), 0
    made._process = type("Ended", (), {"said": lambda self: "it burns"})()
    return made


@pytest.mark.parametrize("pieces", [1, 2, 7, 1 << 16])
def test_registers_and_words_are_little_endian(pieces):
    target = Target()
    target.pieces = pieces
    target.memory = dict(enumerate((0x78, 0x56, 0x34, 0x12, 0xFF), start=0x20))
    cpu = held(target)
    assert (cpu.register(3), cpu.register(25)) == (0x33333333, 0xAAAAAAAA)
    cpu.set_register(10, 0x01020304)
    assert cpu.register(10) == 0x01020304
    assert cpu.read_word(0x20) == 0x12345678
    assert target.asked == ["p3", "p19", "Pa=04030201", "pa", "m20,4"]


def test_memory_goes_in_pieces_of_a_thousand_and_24_bytes():
    target = Target()
    cpu = held(target)
    data = bytes(k * 7 % 256 for k in range(2500))
    cpu.write(0x1000, data)
    assert [t.split(":")[0] for t in target.asked] == ["M1000,400", "M1400,400", "M1800,1c4"]
    target.asked.clear()
    assert cpu.read(0x1000, 2500) == data
    assert target.asked == ["m1000,400", "m1400,400", "m1800,1c4"]
    target.asked.clear()
    assert cpu.read(0x1001, 1024) == data[1:1025]
    assert cpu.read(0x1000, 0) == b""
    cpu.write(0x1000, b"")
    assert target.asked == ["m1001,400"]


def test_it_leaves_a_breakpoint_by_one_step_and_runs_to_the_next():
    target = Target(stops=[0x100, 0x200, 0x100], steps=[0x102, 0x104])
    cpu = held(target)
    cpu.hold_at(0x100)
    assert (cpu.run(), cpu.at) == (0x100, 0x100)
    assert cpu.run() == 0x200
    cpu.no_more_at(0x300)  # none was there
    assert cpu.run() == 0x100
    cpu.no_more_at(0x100)
    cpu.no_more_at(0x100)
    target.stops = [0x400]
    assert cpu.run() == 0x400
    assert target.asked == [
        *("Z1,100,2", "c", "pf", "s", "c", "pf", "c", "pf", "z1,100,2", "c", "pf"),
    ]


def test_steps_are_counted_to_the_first_of_some_places():
    places = [0x10, 0x12, 0x14, 0x10, 0x16]
    cpu = held(Target(steps=places))
    assert (cpu.steps_to(0x14, 0x16), cpu.at) == (3, 0x14)
    # From a place to itself is once round.
    assert (cpu.steps_to(0x14, 0x10), cpu.at) == (1, 0x10)
    assert cpu.steps_to(0x16) == 1


def test_a_store_by_the_processor_leaves_it_as_it_was():
    target = Target(steps=[0x5002])
    cpu = held(target)
    target.registers |= {0: 0xA0, 1: 0xA1, 15: 0x8000, 25: 0x6700FC03}
    before = dict(target.registers)
    cpu.store(0xE000E010, 0x12345678, 0x5000)
    assert target.registers == before
    step = target.asked.index("s")
    given = target.asked[step - 5 : step]
    assert given == [
        "M5000,2:0160",
        *("P0=10e000e0", "P1=78563412", "Pf=00500000", "P19=03000061"),
    ]
    assert target.asked[step + 1 :] == ["P0=a0000000", "P1=a1000000", "Pf=00800000", "P19=03fc0067"]


def test_a_refusal_and_an_end_are_told():
    cpu = held(Target())
    with pytest.raises(LinkError, match=r"the emulator refuses Z1,bad00,2: E22"):
        cpu.hold_at(0xBAD00)
    cpu.no_more_at(0xBAD00)
    assert cpu._link.asked == ["Z1,bad00,2"]
    silent = Target()
    silent.pieces = 0
    with pytest.raises(LinkError, match="the emulator has stopped") as error:
        held(silent).run()
    assert error.value.said == "it burns"
