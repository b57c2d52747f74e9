"""Non-volatile store: sets of parameters in flash with a power cut at any byte.

The flash is modelled as it is: an erased byte is 0xFF, what is programmed at once is a unit of 1,
4, 8 or 32 bytes, written whole and once between erasures, and where the power goes one unit is left
half written, or reads as anything.
"""

from __future__ import annotations

import binascii
import re
import struct
import subprocess
from random import Random

import cffi
import pytest

from esea_gen.board.chips import declarations
from esea_gen.targets import APP_FLAGS, firmware_folder
from tests.conftest import require_tool

EMPTY, LOADED, OTHER_LAYOUT, OTHER_DEVICE = range(4)
# parameters, encoders; lives of couplings, with their classes and points
SMALL = (4, 2, 1, 3, 2)
HEAD, LAST = 24, 4


def set_bytes(size) -> int:
    parameters, encoders, lives, classes, points = size
    use, key, life = 6 * 4, 4 + 8 + 32, 7 * 4 + 2 * points + 4 * classes
    return 4 + 8 * parameters + encoders * (8 + 4) + use + key + lives * life


def build(folder, size):
    require_tool("gcc")
    app, target = firmware_folder() / "app", folder / f"store{size[0]}.so"
    names = ("STORE_PARAMETERS", "STORE_ENCODERS", "STORE_LIVES", "LIFE_CLASSES", "LIFE_POINTS")
    defined = [f"-DESEA_{n}={v}u" for n, v in zip(names, size, strict=True)]
    command = [
        *("gcc", *APP_FLAGS, "-Wpedantic", "-Wshadow", "-Wdouble-promotion", "-shared", "-fPIC"),
        *(
            "-fsanitize=undefined",
            "-fsanitize-undefined-trap-on-error",
            f"-I{app}",
            f"-I{app.parent / 'port'}",
            *defined,
        ),
        *(app / "store.c", "-o", target),
    ]
    subprocess.run(command, check=True)
    ffi = cffi.FFI()
    port = declarations(app.parent / "port" / "port.h")
    flash = re.search(
        r"typedef struct \{\s+uint32_t area_bytes;.*?\} esea_flash_t;", port, re.DOTALL
    )
    text = flash[0] + declarations(app / "store.h")
    for name, value in zip(names, size, strict=True):
        text = text.replace(f"ESEA_{name}]", f"{value}]")
    ffi.cdef(text)
    return ffi, ffi.dlopen(str(target)), size


class Flash:
    """Two areas that hold so many sets each; the power may be cut after so many units."""

    def __init__(self, library, slots=2, seed=0, unit=4):
        self.ffi, self.lib, self.size = library
        self.unit = unit
        self.set_at, *rest = (-(-n // unit) * unit for n in (HEAD, set_bytes(self.size), LAST))
        self.slot = self.set_at + sum(rest)
        self.areas = [bytearray(b"\xff" * (slots * self.slot + 12)) for _ in range(2)]
        self.left = None  # units until the power is cut
        self.draw = Random(seed)
        self.broken = False
        self.erased = [0, 0]
        self.written = [set(), set()]  # units since the last erasure
        ffi = self.ffi
        self.kept = (
            ffi.callback("void(uint32_t, uint32_t, void *, size_t)", self.read),
            ffi.callback("bool(uint32_t, uint32_t, const void *, size_t)", self.write),
            ffi.callback("bool(uint32_t)", self.erase),
        )
        self.c = ffi.new("esea_flash_t *", (len(self.areas[0]), *self.kept, unit))

    def read(self, area, at, to, count):
        assert at + count <= len(self.areas[area])
        self.ffi.buffer(to, count)[:] = self.areas[area][at : at + count]

    def change(self, area, at, value):
        """One unit; False once the power is gone, and half of it, or anything, where it goes."""
        if self.left is not None and self.left < 0:
            return False
        if self.left == 0:
            old = self.areas[area][at : at + len(value)]
            some = self.draw.randbytes(len(value))
            mixed = bytes(o & m | v & ~m & 0xFF for o, v, m in zip(old, value, some, strict=True))
            value = self.draw.choice([mixed, mixed, some, old])
        self.areas[area][at : at + len(value)] = value
        if self.left is not None:
            self.left -= 1
        return self.left is None or self.left >= 0

    def write(self, area, at, data, count):
        units = range(at, at + count, self.unit)
        if at % self.unit or count % self.unit or self.written[area] & set(units):
            return False
        assert at + count <= len(self.areas[area])
        new = bytes(self.ffi.buffer(data, count))
        if self.broken:
            return False
        for k in units:
            self.written[area].add(k)
            if not self.change(area, k, new[k - at : k - at + self.unit]):
                return False
        return True

    def erase(self, area):
        self.erased[area] += 1
        order = list(range(0, len(self.areas[area]), self.unit))
        if self.left is not None:
            self.draw.shuffle(order)  # an erasure has no order
        size = len(self.areas[area])
        done = all(self.change(area, at, b"\xff" * min(self.unit, size - at)) for at in order)
        if done:
            self.written[area].clear()
        return done


class Store:
    """A store on a flash, opened."""

    def __init__(self, flash, device=b"elbow_drive"):
        self.flash, self.ffi, self.lib = flash, flash.ffi, flash.lib
        self.c = self.ffi.new("esea_store_t *")
        self.status = self.lib.esea_store_open(self.c, flash.c, device)

    def save(self, values: dict[int, float]) -> bool:
        pairs = self.ffi.new("esea_store_parameter_t[]", list(values.items()))
        return bool(self.lib.esea_store_save(self.c, pairs, len(values)))

    def load(self, capacity=None) -> dict[int, float]:
        most = self.flash.size[0] if capacity is None else capacity
        pairs = self.ffi.new("esea_store_parameter_t[]", most + 1)
        count = self.lib.esea_store_load(self.c, pairs, most)
        return {pairs[k].id: pairs[k].value for k in range(count)}


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return build(tmp_path_factory.mktemp("store"), SMALL)


def a_set(number: int, count: int = 4) -> dict[int, float]:
    return {0x1000 * k + 7: number + k / 4 for k in range(count)}


@pytest.mark.parametrize("saves", range(1, 12))
@pytest.mark.parametrize(
    ("slots", "unit"), [(1, 4), (2, 1), (2, 4), (3, 4), (2, 8), (3, 16), (2, 32)]
)
def test_the_last_set_that_was_saved_is_there_at_power_up(library, slots, unit, saves):
    flash = Flash(library, slots, unit=unit)
    store = Store(flash)
    for number in range(saves):
        assert store.save(a_set(number, number % 5))
    again = Store(flash)
    assert again.status == LOADED
    assert again.load() == a_set(saves - 1, (saves - 1) % 5)
    assert again.c.sequence == again.c.set.use.saves == saves
    # An area is erased once for each of its fillings.
    assert sum(flash.erased) == -(-saves // slots)
    assert again.save({1: 0.5})
    assert Store(flash).load() == {1: 0.5}


@pytest.mark.parametrize("unit", [1, 4, 8, 32])
def test_bytes_in_flash_are_as_the_header_says(library, unit):
    """Head, set, last word, each in units of its own; the checksum is that of binascii."""
    flash = Flash(library, unit=unit)
    assert Store(flash).save({0x11223344: 0.5})
    data = bytes(flash.areas[0])
    magic, layout, size, device, sequence, crc = struct.unpack_from("<6I", data)
    assert (magic, layout, size, sequence) == (0x45534131, 3, set_bytes(SMALL), 1)
    assert device == binascii.crc32(b"elbow_drive")
    at = flash.set_at
    assert crc == binascii.crc32(data[:20] + data[at : at + size])
    assert struct.unpack_from("<IIf", data, at) == (1, 0x11223344, 0.5)
    rest = data[24:at] + data[at + size : flash.slot]
    assert rest.replace(b"\xff", b"") == bytes.fromhex("dec00d60")
    assert (at, flash.slot) == {1: (24, 200), 4: (24, 200), 8: (24, 208), 32: (32, 256)}[unit]
    assert set(data[flash.slot :]) == {0xFF}


def cut_everywhere(flash, wanted_old, wanted_new, step=1):
    """A save whose power is cut after each unit; how often each of the two was there after it."""
    before, written = [bytes(a) for a in flash.areas], [set(w) for w in flash.written]
    found = {"old": 0, "new": 0}
    at = 0
    while True:
        flash.areas, flash.written = [bytearray(a) for a in before], [set(w) for w in written]
        flash.left, flash.draw = None, Random(at)
        store = Store(flash)
        flash.left = at
        done = store.save(wanted_new)
        ended = flash.left is not None and flash.left >= 0
        flash.left = None
        again = Store(flash)
        values = again.load()
        assert values in (wanted_old, wanted_new), at
        assert again.status == (LOADED if values or wanted_old or values == wanted_new else EMPTY)
        found["new" if values == wanted_new else "old"] += 1
        # Whatever was left there, the next save is taken.
        if at % 7 == 0:
            assert again.save({9: 9.0})
            assert Store(flash).load() == {9: 9.0}
        if ended:
            assert done
            return found
        at += step


@pytest.mark.parametrize("saves", range(6))
@pytest.mark.parametrize("slots", [1, 2])
@pytest.mark.parametrize("unit", [1, 4, 8, 32])
def test_a_power_cut_at_any_unit_leaves_the_old_set_or_the_new_one(library, unit, slots, saves):
    """Also while an area is erased; with and without a set before."""
    flash = Flash(library, slots, unit=unit)
    store = Store(flash)
    old = {}
    for number in range(saves):
        old = a_set(number)
        assert store.save(old)
    found = cut_everywhere(flash, old, a_set(77))
    # New once the last word stands: the run that ended, and perhaps a last unit that was all there.
    assert 1 <= found["new"] <= 3
    cut = flash.slot + (len(flash.areas[0]) if saves % slots == 0 else 0)
    assert found["old"] >= cut // unit - 2


@pytest.mark.parametrize("saves", [1, 2, 3])
@pytest.mark.parametrize("unit", [1, 4, 8, 32])
def test_two_power_cuts_in_a_row(library, unit, saves):
    """The second at any unit of a save after the first, drawn."""
    draw = Random(8)
    for first in range(0, 160, 3) if unit == 1 else range(0, 500 // unit, 2):
        flash = Flash(library, 1, seed=first, unit=unit)
        store = Store(flash)
        for number in range(saves):
            assert store.save(a_set(number))
        old = a_set(saves - 1)
        for cut, values in ((first, a_set(50)), (draw.randrange(320 // unit), a_set(60))):
            store = Store(flash)
            old = store.load()
            flash.left = cut
            store.save(values)
            flash.left = None
            assert Store(flash).load() in (old, values)


def test_any_bit_that_flips_loses_the_set_and_gives_the_one_before(library):
    flash = Flash(library, 2)
    store = Store(flash)
    assert store.save(a_set(1))
    assert store.save(a_set(2))
    kept = bytes(flash.areas[0])
    for bit in range(8 * flash.slot):
        at = flash.slot + bit // 8
        flash.areas[0][at] ^= 1 << bit % 8
        assert Store(flash).load() == a_set(1), bit
        flash.areas[0][:] = kept
    assert Store(flash).load() == a_set(2)


def sealed(flash, slot=0, area=0, **changed):
    """Changes words of a head and makes its checksum fit."""
    names = ("magic", "layout", "bytes", "device", "sequence")
    data, at = flash.areas[area], slot * flash.slot
    words = dict(zip(names, struct.unpack_from("<5I", data, at), strict=True)) | changed
    head = struct.pack("<5I", *words.values())
    size = words["bytes"]
    crc = binascii.crc32(head + bytes(data[at + 24 : at + 24 + size]))
    data[at : at + 24] = head + struct.pack("<I", crc)
    struct.pack_into("<I", data, at + 24 + size, 0x600DC0DE)


@pytest.mark.parametrize(
    ("layout", "grown"), [(0, 0), (2, -8), (2, 0), (3, -4), (4, 0), (4, 40), (99, 40)]
)
def test_an_older_or_newer_layout_is_refused_and_then_replaced(library, layout, grown):
    flash = Flash(library, 2)
    assert Store(flash).save(a_set(1))
    sealed(flash, layout=layout, bytes=set_bytes(SMALL) + grown)
    store = Store(flash)
    assert (store.status, store.load()) == (OTHER_LAYOUT, {})
    kept = bytes(flash.areas[0])
    assert store.save(a_set(2))
    # The other firmware's set stands as it was, until the areas are changed again.
    assert bytes(flash.areas[0]) == kept
    again = Store(flash)
    assert (again.status, again.load()) == (LOADED, a_set(2))


def test_another_device_s_set_is_refused(library):
    flash = Flash(library)
    assert Store(flash).save(a_set(1))
    other = Store(flash, b"elbow_mpc")
    assert (other.status, other.load()) == (OTHER_DEVICE, {})
    assert other.save(a_set(2))
    assert Store(flash, b"elbow_mpc").load() == a_set(2)
    assert Store(flash).status == OTHER_DEVICE


@pytest.mark.parametrize("sequence", [2**31 - 1, 2**32 - 2, 2**32 - 1, 0])
def test_the_number_may_pass_its_end(library, sequence):
    flash = Flash(library, 1)
    store = Store(flash)
    assert store.save(a_set(0))
    sealed(flash, sequence=sequence)
    for number in range(1, 5):
        store = Store(flash)
        assert store.load() == a_set(number - 1)
        assert store.save(a_set(number))
    assert Store(flash).c.sequence == (sequence + 4) % 2**32


def test_too_many_parameters_in_a_set_that_is_whole_are_refused(library):
    flash = Flash(library)
    assert Store(flash).save(a_set(1))
    struct.pack_into("<I", flash.areas[0], 24, 5)
    sealed(flash)
    store = Store(flash)
    assert (store.status, store.load()) == (OTHER_LAYOUT, {})


@pytest.mark.parametrize(
    "values",
    [
        [(k, 0.0) for k in range(5)],
        [(1, 1.0), (2, 2.0), (1, 1.0)],
        [(1, float("nan"))],
        [(1, 1.0), (2, float("inf"))],
        [(1, -float("inf"))],
    ],
    ids=["too many", "twice", "nan", "inf", "-inf"],
)
def test_what_cannot_be_saved_changes_nothing(library, values):
    flash = Flash(library)
    store = Store(flash)
    assert store.save(a_set(1))
    pairs = store.ffi.new("esea_store_parameter_t[]", values)
    before = [bytes(a) for a in flash.areas]
    assert not store.lib.esea_store_save(store.c, pairs, len(values))
    assert store.load() == a_set(1)
    assert [bytes(a) for a in flash.areas] == before


def test_a_flash_that_does_not_take_it_leaves_the_old_set(library):
    flash = Flash(library)
    store = Store(flash)
    assert store.save(a_set(1))
    flash.broken = True
    assert not store.save(a_set(2))
    flash.broken = False
    assert Store(flash).load() == a_set(1)


@pytest.mark.parametrize("unit", [3, 12, 64, 2**31])
def test_a_flash_of_other_units_keeps_nothing(library, unit):
    flash = Flash(library)
    flash.c.unit_bytes = unit
    store = Store(flash)
    assert (store.status, store.save(a_set(1)), flash.erased) == (EMPTY, False, [0, 0])


@pytest.mark.parametrize("unit", [4, 8, 32])
def test_a_unit_that_looks_erased_and_takes_nothing_costs_its_area_only(library, unit):
    """As a power cut may leave one, where each has its own error correction."""
    flash = Flash(library, 3, unit=unit)
    store = Store(flash)
    assert store.save(a_set(1))
    flash.written[0].add(flash.slot + unit)
    for number in range(2, 8):
        assert store.save(a_set(number))
        assert Store(flash).load() == a_set(number)


@pytest.mark.parametrize("at", range(0, 144, 3))
def test_a_cell_that_cannot_be_set_is_found_when_it_is_read_back(library, at):
    flash = Flash(library, 2)
    store = Store(flash)
    assert store.save(a_set(1))
    clean = flash.write

    def worn(area, where, data, count):
        ok = clean(area, where, data, count)
        flash.areas[area][flash.slot + at] |= 0xFF
        return ok

    kept = flash.ffi.callback("bool(uint32_t, uint32_t, const void *, size_t)", worn)
    flash.c.write = kept
    assert store.save(a_set(2))  # to the other area, whose second slot it comes to next
    assert flash.erased == [1, 1]
    assert Store(flash).load() == a_set(2)
    flash.areas[1][:] = bytes(len(flash.areas[1]))
    assert Store(flash).load() == a_set(1)


@pytest.mark.parametrize(("slots", "erased"), [(2, [1, 1]), (3, [1, 0])])
@pytest.mark.parametrize("at", range(0, 144, 5))
def test_a_slot_with_one_byte_in_it_is_passed_over(library, at, slots, erased):
    flash = Flash(library, slots)
    assert Store(flash).save(a_set(1))
    flash.areas[0][flash.slot + at] = 0x7F
    assert Store(flash).save(a_set(2))
    assert flash.erased == erased
    assert Store(flash).load() == a_set(2)


def test_an_erasure_that_fails_is_told(library):
    flash = Flash(library)
    flash.kept = (*flash.kept, flash.ffi.callback("bool(uint32_t)", lambda area: False))
    flash.c.erase = flash.kept[-1]
    assert not Store(flash).save(a_set(1))
    assert Store(flash).status == EMPTY


@pytest.mark.parametrize("room", [0, 4, 100])
def test_an_area_that_is_too_small_takes_nothing(library, room):
    flash = Flash(library)
    flash.areas = [bytearray(b"\xff" * room) for _ in range(2)]
    flash.c.area_bytes = room
    store = Store(flash)
    assert store.status == EMPTY
    assert not store.save(a_set(1))


# -- encoders and counters -------------------------------------------------------------------------


def encoder(store, serial, zero_rad=0.25):
    made = store.ffi.new("esea_store_encoder_t *", (serial, zero_rad))
    return bool(store.lib.esea_store_put_encoder(store.c, made))


def known(store, serial):
    found = store.lib.esea_store_encoder(store.c, serial)
    return None if found == store.ffi.NULL else found.zero_rad


def test_an_encoder_is_known_by_its_serial_number_alone(library):
    flash = Flash(library)
    store = Store(flash)
    store.c.set.fitted = [4711, 4712]
    assert known(store, 0) is None
    assert encoder(store, 4711)
    assert encoder(store, 4712, -1.5)
    assert encoder(store, 4711, 0.75)
    assert not encoder(store, 4713)  # there is room for two, and both are fitted
    assert store.lib.esea_store_commit(store.c)
    again = Store(flash)
    assert list(again.c.set.fitted) == [4711, 4712]
    assert (known(again, 4711), known(again, 4712)) == (0.75, -1.5)
    assert known(again, 4713) is known(again, 0) is None
    # Parameters and encoders do not disturb each other.
    assert again.save(a_set(5))
    assert known(Store(flash), 4711) == 0.75


@pytest.mark.parametrize("stays", [1, 2])
def test_whichever_place_is_not_fitted_makes_room(library, stays):
    store = Store(Flash(library))
    assert encoder(store, 1)
    assert encoder(store, 2)
    store.c.set.fitted = [stays, 3]
    assert encoder(store, 3, 0.5)
    assert (known(store, stays), known(store, 3 - stays), known(store, 3)) == (0.25, None, 0.5)


def test_what_is_known_of_an_encoder_can_be_forgotten(library):
    store = Store(Flash(library))
    assert encoder(store, 1)
    assert not store.lib.esea_store_forget_encoder(store.c, 2)
    assert not store.lib.esea_store_forget_encoder(store.c, 0)
    assert store.lib.esea_store_forget_encoder(store.c, 1)
    assert known(store, 1) is None


@pytest.mark.parametrize(
    ("serial", "zero_rad"), [(0, 0.0), (1, float("nan")), (1, float("inf")), (1, -float("inf"))]
)
def test_what_is_no_encoder_is_refused(library, serial, zero_rad):
    store = Store(Flash(library))
    assert not encoder(store, serial, zero_rad)
    assert known(store, 1) is None
