"""Black box: content after a reset, and detection of changed memory.

Its C stands alone here, in a library of 20 records.
"""

from __future__ import annotations

import subprocess
from random import Random

import cffi
import pytest

from esea_gen.emit.states import BOARD_FAULTS
from esea_gen.targets import APP_FLAGS, firmware_folder
from tests.conftest import require_tool

FAULTS = {f.name: f.value for f in BOARD_FAULTS}
SENSING = 6
RECORDS = 20
LINK = """
#include <stdint.h>
#include <stdbool.h>
typedef struct { uint32_t mode, stop, rearm; float tau_desired_Nm; } esea_link_wanted_t;
#define ESEA_LINK_AXES 1u
#define ESEA_LINK_MEASURED 2u
#define ESEA_LINK_TICK_US 100000u
"""
DECLARED = """
typedef struct {
    uint32_t check; uint16_t serial, tick; uint8_t state, fault, flags, faults[1];
    float u_Nm[1]; float desired[1]; float measured[2];
} esea_blackbox_record_t;
typedef struct {
    uint32_t layout, epoch, frozen, fault, tick, check, next, count; uint16_t serial;
    esea_blackbox_record_t records[20];
} esea_blackbox_t;
typedef struct { uint32_t mode, stop, rearm; float tau_desired_Nm; } esea_link_wanted_t;
void esea_blackbox_start(esea_blackbox_t *box, uint32_t fault);
void esea_blackbox_want(esea_blackbox_record_t *record, const esea_link_wanted_t *wanted);
void esea_blackbox_add(esea_blackbox_t *box, esea_blackbox_record_t *record);
void esea_blackbox_freeze(esea_blackbox_t *box, uint32_t fault, uint32_t tick);
void esea_blackbox_release(esea_blackbox_t *box);
uint32_t esea_blackbox_count(const esea_blackbox_t *box);
bool esea_blackbox_read(const esea_blackbox_t *box, uint32_t index, esea_blackbox_record_t *out);
"""
ON, STOP = 0x40, 0x80


def build(folder, content: str = "a1b2"):
    """The box alone; a library of 20 records."""
    require_tool("gcc")
    (folder / "link.h").write_text(f'{LINK}#define ESEA_LINK_CONTENT_HASH "{content}"\n')
    app, target = firmware_folder() / "app", folder / f"{content}.so"
    command = [
        *("gcc", *APP_FLAGS, "-Wpedantic", "-Wshadow", "-Wdouble-promotion", "-shared", "-fPIC"),
        *("-fsanitize=undefined", "-fsanitize-undefined-trap-on-error"),
        *(f"-I{folder}", f"-I{app}", '-DESEA_LINK_HEADER="link.h"'),
        *(app / "blackbox.c", "-o", target),
    ]
    subprocess.run(command, check=True)
    ffi = cffi.FFI()
    ffi.cdef(DECLARED)
    return ffi, ffi.dlopen(str(target))


class Box:
    """A black box in memory of any content."""

    def __init__(self, library, memory: bytes | None = None):
        self.ffi, self.lib = library
        self.box = self.ffi.new("esea_blackbox_t *")
        self.memory = self.ffi.buffer(self.box)
        if memory is not None:
            self.memory[:] = memory

    def add(self, tick: int, flags: int = 0) -> None:
        record = self.ffi.new("esea_blackbox_record_t *")
        record.tick, record.flags, record.u_Nm[0] = tick & 0xFFFF, flags, tick / 8
        record.measured[1] = tick
        self.lib.esea_blackbox_add(self.box, record)

    def ticks(self) -> list[int]:
        """Of the records that can be read, in their order."""
        record = self.ffi.new("esea_blackbox_record_t *")
        found = []
        for k in range(self.lib.esea_blackbox_count(self.box)):
            if self.lib.esea_blackbox_read(self.box, k, record):
                assert record.measured[1] == 8 * record.u_Nm[0]
                assert int(record.measured[1]) & 0xFFFF == record.tick
                found.append(int(record.measured[1]))
        assert not self.lib.esea_blackbox_read(self.box, len(found) + 99, record)
        return found


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return build(tmp_path_factory.mktemp("box"))


@pytest.fixture
def box(library):
    made = Box(library)
    library[1].esea_blackbox_start(made.box, 0)
    return made


def after_reset(library, box: Box, fault: int = 0, memory: bytes | None = None) -> Box:
    again = Box(library, bytes(box.memory) if memory is None else memory)
    library[1].esea_blackbox_start(again.box, fault)
    return again


@pytest.mark.parametrize("ticks", [1, 2, 19, 20, 21, 39, 40, 41, 70000])
def test_the_last_twenty_are_there_after_a_reset(library, box, ticks):
    for tick in range(ticks):
        box.add(tick)
    assert box.ticks() == []  # it runs: nothing stands still to be read
    library[1].esea_blackbox_freeze(box.box, SENSING, ticks - 1)
    wanted = list(range(max(0, ticks - RECORDS), ticks))
    assert box.ticks() == wanted
    again = after_reset(library, box)
    assert again.ticks() == wanted
    assert (again.box.fault, again.box.tick) == (SENSING, ticks - 1)
    # And after another.
    assert after_reset(library, again, 107).ticks() == wanted


def test_what_comes_after_the_fault_changes_nothing(library, box):
    box.add(1)
    library[1].esea_blackbox_freeze(box.box, SENSING, 1)
    box.add(2)
    library[1].esea_blackbox_freeze(box.box, 9, 2)
    assert box.ticks() == [1]
    assert (box.box.fault, box.box.tick) == (SENSING, 1)


def test_released_it_forgets_and_records_again(library, box):
    for tick in range(30):
        box.add(tick)
    library[1].esea_blackbox_freeze(box.box, SENSING, 29)
    library[1].esea_blackbox_release(box.box)
    assert box.ticks() == []
    assert (box.box.fault, box.box.tick) == (0, 0)  # nor of what froze it
    for tick in range(100, 103):
        box.add(tick, ON)
    # Also when a reset must find them among the old ones.
    assert after_reset(library, box, 107).ticks() == [100, 101, 102]
    library[1].esea_blackbox_freeze(box.box, 8, 102)
    assert box.ticks() == [100, 101, 102]
    assert box.box.fault == 8


@pytest.mark.parametrize("flags", [0, ON, STOP, ON | STOP])
@pytest.mark.parametrize("fault", [0, FAULTS["WATCHDOG"]])
def test_a_reset_freezes_what_was_under_torque_or_came_by_the_watchdog(library, box, flags, fault):
    for tick in range(33):
        box.add(tick, flags)
    again = after_reset(library, box, fault)
    if fault or flags & ON:
        assert again.ticks() == list(range(13, 33))
        assert (again.box.fault, again.box.tick) == (fault, 32)
    else:
        assert again.ticks() == []
        again.add(50)
        library[1].esea_blackbox_freeze(again.box, 1, 50)
        assert again.ticks() == [50]


@pytest.mark.parametrize("frozen", [True, False])
@pytest.mark.parametrize("ticks", [27, 65536 + 7])
def test_any_bit_that_changed_costs_its_record_or_the_whole_box(library, box, frozen, ticks):
    for tick in range(ticks):
        box.add(tick, ON)
    if frozen:
        library[1].esea_blackbox_freeze(box.box, SENSING, ticks - 1)
    kept, whole = bytes(box.memory), set(range(ticks - RECORDS, ticks))
    records, size = 36, 28
    assert len(kept) == records + RECORDS * size
    head, counters = 24, 36
    for bit in range(8 * len(kept)):
        memory = bytearray(kept)
        memory[bit // 8] ^= 1 << bit % 8
        found = after_reset(library, box, 0, bytes(memory)).ticks()
        assert found == sorted(found)
        if bit // 8 < head:
            assert found == []
        elif bit // 8 < counters:
            assert set(found) == whole  # counted anew from the records
        else:
            place = (bit // 8 - records) // size
            lost = next(t for t in whole if t % RECORDS == place)
            # Counted from the newest back to the gap.
            assert set(found) == {t for t in whole if t > lost} if lost != max(whole) else True
            assert lost not in found


def test_memory_that_changes_while_it_is_frozen_is_not_read(library, box):
    for tick in range(RECORDS):
        box.add(tick)
    library[1].esea_blackbox_freeze(box.box, SENSING, 19)
    box.box.records[7].measured[0] = 3.0
    assert box.ticks() == [t for t in range(RECORDS) if t != 7]


@pytest.mark.parametrize("ticks", [5, 20, 33])
def test_a_reset_at_any_byte_of_a_record_costs_the_oldest_at_most(library, box, ticks):
    for tick in range(ticks):
        box.add(tick, ON)
    before = bytes(box.memory)
    box.add(ticks, ON)
    after = bytes(box.memory)
    changed = [k for k in range(36, len(after)) if before[k] != after[k]]
    for k in range(len(changed) + 1):
        memory = bytearray(before)
        for at in changed[:k]:
            memory[at] = after[at]
        found = after_reset(library, box, 0, bytes(memory)).ticks()
        least = range(max(0, ticks + 1 - RECORDS), ticks)
        assert set(least) <= set(found) <= {*range(max(0, ticks - RECORDS), ticks), ticks}


def test_memory_of_a_cold_start_is_no_record(library):
    draw = Random(4)
    for _ in range(300):
        box = Box(library, draw.randbytes(36 + RECORDS * 28))
        library[1].esea_blackbox_start(box.box, FAULTS["WATCHDOG"])
        assert box.ticks() == []
        box.add(9)
        assert after_reset(library, box, FAULTS["WATCHDOG"]).ticks() == [9]


def test_another_firmware_takes_nothing_from_it(library, box, tmp_path):
    for tick in range(5):
        box.add(tick, ON)
    library[1].esea_blackbox_freeze(box.box, SENSING, 4)
    assert after_reset(build(tmp_path, "a1b3"), box).ticks() == []
    assert len(after_reset(library, box).ticks()) == 5


@pytest.mark.parametrize(
    ("mode", "stop", "rearm", "flags"),
    [
        (0, 0, 0, 0),
        (1, 0, 7, 1 | 7 << 3),
        (2, 1, 3, 2 | 1 << 2 | 3 << 3),
        (4, 2, 8, 63),
        (*[2**32 - 1] * 3, 63),
    ],
)
def test_what_is_wanted_is_packed(library, mode, stop, rearm, flags):
    ffi, lib = library
    record = ffi.new("esea_blackbox_record_t *", {"flags": ON})
    lib.esea_blackbox_want(record, ffi.new("esea_link_wanted_t *", (mode, stop, rearm, 0.25)))
    assert (record.flags, record.desired[0]) == (ON | flags, 0.25)
