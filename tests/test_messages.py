"""Rules that every message of a dialect keeps, by MAVLink's own definition of a frame."""

from __future__ import annotations

import re

import numpy as np
import pytest

from esea_gen.control.limits.faults import OPTIONAL, Fault
from esea_gen.device import load_device
from esea_gen.emit.messages import fault_codes, mavlink_units, messages, status_words
from esea_gen.emit.roles import board_roles

# MAVLink 2: types and their sizes, largest payload, most fields, range of ids.
TYPES = {
    "uint64_t": np.uint64,
    "uint32_t": np.uint32,
    "uint16_t": np.uint16,
    "uint8_t": np.uint8,
    "float": np.float32,
    "char": "S1",
}
PAYLOAD, FIELDS, IDS = 255, 64, 2**24


@pytest.fixture(scope="module", params=["elbow", "elbow_drive"])
def system(request):
    return load_device(request.param).system


def test_every_message_can_be_sent(system):
    found = messages(system)
    assert len({m.id for m in found}) == len({m.name for m in found}) == len(found)
    for m in found:
        assert 256 <= m.id < IDS
        assert re.fullmatch(r"ESEA(_[A-Z0-9]+)+", m.name)
        assert m.description
        assert 1 <= len(m.fields) <= FIELDS
        assert len({f.name for f in m.fields}) == len(m.fields)
        sizes = [np.dtype(TYPES[f.c_type]).itemsize * f.size for f in m.fields]
        assert [f.bytes for f in m.fields] == sizes
        assert m.payload_bytes == sum(sizes) <= PAYLOAD
        for f in m.fields:
            assert re.fullmatch(r"[a-z]\w*", f.name)
            assert f.name not in TYPES
            assert 1 <= f.size <= PAYLOAD
            assert len(f.description.split()) > 1 or f.description.endswith(".")
            assert f.units in {"", *mavlink_units()}
            assert re.fullmatch(r"(ESEA|MAV)(_[A-Z0-9]+)+", f.enum) or not f.enum
            # An enum is a whole number; text is of letters.
            assert not f.enum or f.c_type.startswith("uint")
            assert f.bitmask == (f.enum in {s.enum for s in status_words(system)})


def test_a_tasks_messages_carry_its_ports_in_order(system):
    by_name = {m.name: m for m in messages(system)}
    ids = []
    for task in system.tasks:
        given = by_name[f"ESEA_{task.name}_IN".upper()]
        made = by_name[f"ESEA_{task.name}_OUT".upper()]
        ids += [given.id, made.id]
        ports = [x.name for x in system.task_inputs(task)]
        assert [f.name for f in given.fields] == ["sequence", *ports]
        ports = [x.name for x in system.task_outputs(task)]
        assert [f.name for f in made.fields] == ["sequence", *ports, "step_ticks"]
        for x in (*system.task_inputs(task), *system.task_outputs(task)):
            f = next(f for f in (*given.fields, *made.fields) if f.name == x.name)
            assert (f.c_type, f.size) == (
                ("uint32_t", 1) if x.port.whole else ("float", x.port.size)
            )
            assert bool(f.enum) == bool(x.port.flags or x.port.choices)
        period_ms = task.every * system.base_period_s * 1000
        assert f"(period {period_ms:g} ms)" in given.description
    first = by_name["ESEA_INFO"].id
    assert ids == list(range(first + 1, first + 1 + 2 * len(system.tasks)))


def test_what_the_host_gives_and_what_the_board_measures(system):
    roles = board_roles(system)
    every = {x.name for t in system.tasks for x in system.task_inputs(t)}
    measured, wanted = ({x.name for x in r} for r in (roles.measured, roles.wanted))
    assert measured | wanted == every
    assert not measured & wanted
    words = {m.name: m for m in messages(system)}
    assert roles.drive == ("rearm" in every) == ("ESEA_WANTED" in words)
    if not roles.drive:
        assert (measured, roles.encoders) == (every, ())
        return
    assert {n.partition("_")[0] for n in measured} == {"count", "frame"}
    assert {"mode", "stop", "rearm"} <= wanted
    fields = [f.name for f in words["ESEA_WANTED"].fields]
    assert set(fields) == (wanted - {"stop", "rearm"}) | {"deadline_ms", "boot", "time_ms"}
    # Each encoder with a zero of its own, beside its angle and its status.
    assert [z.instance for z in roles.encoders] == ["encoder_motor", "encoder_load"]
    outputs = {x.name: x.signals[0] for x in system.outputs}
    for z in roles.encoders:
        for name, port in ((z.theta, "theta_rad"), (z.status, "status")):
            assert (outputs[name].instance, outputs[name].port) == (z.instance, port)


def test_every_fault_has_one_number_and_they_stand_in_order(system):
    numbers = [c.value for c in fault_codes(system)]
    assert numbers == sorted(set(numbers))
    assert numbers[0] == 0  # none
    drive = board_roles(system).drive
    assert ({int(f) for f in Fault if f and f not in OPTIONAL} <= set(numbers)) == drive
