"""Hand-written C under the value analysis: state machine, store, parser. Run by `make proof`."""

from __future__ import annotations

import re

import pytest

from tests.conftest import require_tool

from .firmware_proof import CONTRACTS, PARTS, prove_firmware

pytestmark = pytest.mark.slow

# What the analysis says, how often, and why it is not so.
ALARMS = {
    "parser": {
        r"mavlink_helpers\.h:\d+ signed downcast\. assert c . 127": (
            1,
            "a byte above 127 put into a char: defined by the compiler, which keeps its bits",
        )
    },
    "link": {
        r"link\.c:\d+ non-finite float value\. .*is_finite\(interval_us\)": (
            2,
            "the lines before leave for NaN and for what is above 1e9; it is above 0",
        ),
        r"link\.c:\d+ non-finite float value\. .*is_finite\(number\)": (
            1,
            "the comparison before it is false for NaN, and then 0 is taken",
        ),
        r"link\.c:\d+ (non-finite float value|overflow in conv).*command\.param1": (
            3,
            "only where can_be_asked found it equal to one of seven numbers",
        ),
        r"link\.c:\d+ trap representation of a _Bool lvalue": (
            2,
            "volatile, so that any bits are assumed; only true and false are written",
        ),
    },
}
# By part: how many assumptions; assertions and contracts that a part itself proves are none.
ASSUMED = {
    "machine": 8,  # guards are truth values
    "store": 1,  # who loads has the room that it says
    "store, a slot": 1,  # the same driver
    "store, a sum": 1,
    "parser": 2,  # it checks no signature; signing.c: the state is a known one
    "parser, the reader": 2,  # the same driver
    "parser, a signature": 2,
    "parser, a sum": 2,
    "link": 2,  # the state is a known one, reading gives no more than was asked for
}
ASSUMED |= {f"{p}, units of 32": n for p, n in ASSUMED.items() if p.startswith("store")}


@pytest.mark.parametrize("part", PARTS)
def test_no_alarm_but_those_explained(drive, part):
    require_tool("frama-c")
    found = prove_firmware(drive, part)
    rest = list(found.alarms)
    for pattern, (count, why) in ALARMS.get(part, {}).items():
        hits = [a for a in rest if re.match(pattern, a)]
        assert len(hits) == count, (why, hits)
        rest = [a for a in rest if a not in hits]
    assert rest == []
    assert found.unproven == ()
    assert len(found.assumptions) == ASSUMED[part]
    assert found.statements > 30


def test_what_is_taken_by_contract_is_proven_of_the_function_elsewhere():
    """The sum over bytes and the compression are called with their bodies in another part."""
    bodies = {
        "crc_over": "store, a slot",
        "look": "store, a slot",
        "blank": "store, a slot",
        "crc_in_flash": "store, a sum",
        "mavlink_sha256_calc": "parser, a sum",
    }
    taken = {name for part in PARTS.values() for name in part.taken}
    # Of MAVLink's own writer, link.c needs no more than that it writes what it is given.
    assert taken == set(bodies) | {"mavlink_finalize_message_buffer"}
    assert {c.rstrip("(").split()[-1] for c in CONTRACTS} == taken
    for name, part in bodies.items():
        assert name not in PARTS[part].taken


FAULTS = [
    # A part, a file, what stands there, what is put in its place, and what then is said.
    ("machine", "machine.c", "*state = ESEA_STATE_FAULT;", ";", "state_known"),
    ("machine", "machine.c", "*state = next;", "state[1] = next;", "out of bounds write"),
    ("store", "store.c", "store->set.encoder[place] = *encoder;",
     "store->set.encoder[place + 1u] = *encoder;", "out of bounds"),
    ("store", "store.c", "if (store->set.parameters > ESEA_STORE_PARAMETERS) {", "if (false) {",
     "parameters_fit"),
    ("store", "store.c", "*slot < all; ++*slot", "*slot <= all; ++*slot", "there"),
    ("store, units of 32", "store.c", "at + whole, unit, unit_of(flash));",
     "at + whole, unit, count - whole);", "whole_units"),
    ("store, a sum", "store.c", "n = head->bytes - done < CHUNK ? head->bytes - done : CHUNK;",
     "n = CHUNK;", "read_inside"),
    ("store, a slot", "store.c", "(flash->area_bytes - at - slot_bytes(flash, 0u))",
     "(flash->area_bytes - slot_bytes(flash, 0u))", "read_inside"),
    ("parser", "mavlink/mavlink_helpers.h", "status->signature_wait = MAVLINK_SIGNATURE_BLOCK_LEN;",
     "status->signature_wait = MAVLINK_SIGNATURE_BLOCK_LEN + 1;", "signature_fits"),
    ("parser, the reader", "reader.c", "reader->count == sizeof reader->bytes",
     "reader->count > sizeof reader->bytes", "out of bounds"),
    ("parser, the reader", "reader.c", "drop(reader, reader->next);",
     "drop(reader, reader->next + 1u);", "valid_"),
    ("parser, a signature", "signing.c", "none, sizeof none", "none, sizeof asked", "valid_"),
    ("link", "link.c", "side < ESEA_SIDES", "side <= ESEA_SIDES", "out of bounds index"),
    ("parser, a sum", "mavlink/mavlink_sha256.h", "s[i&15] = data;", "s[i&31] = data;",
     "out of bounds write"),
]  # fmt: skip


@pytest.mark.parametrize(("part", "file", "old", "new", "said"), FAULTS)
def test_a_fault_in_the_c_is_found(drive, part, file, old, new, said):
    require_tool("frama-c")

    def fault(name, text):
        if name != file:
            return text
        assert text.count(old) == 1
        return text.replace(old, new)

    found = prove_firmware(drive, part, fault)
    assert any(said in words for words in (*found.alarms, *found.unproven)), found


def test_a_call_of_what_is_not_there_is_refused(drive):
    """Else the analysis takes it to change next to nothing, or all it is given a pointer to."""
    require_tool("frama-c")

    def without(name, text):
        if name != "eva_link.c":
            return text
        return re.sub(r"void esea_send_life\(.*?\n\}\n", "", text, count=1, flags=re.DOTALL)

    with pytest.raises(RuntimeError, match="missing-spec"):
        prove_firmware(drive, "link", without)
