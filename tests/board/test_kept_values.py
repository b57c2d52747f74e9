"""Stored parameters under another firmware: checked one by one, refusals reported."""

from __future__ import annotations

import math
import re
import struct
import zlib
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from esea_gen.board.sim import SimBoard
from esea_gen.device import parse_device
from esea_gen.emit.build import render_device
from esea_gen.emit.parameters import fnv1a, link_parameters
from esea_gen.link.kept import kept_values
from esea_host.cli import app
from esea_host.cli import board as commands

LOWERED = {"tau_max_Nm": 1.5, "u_max_Nm": 0.0546875, "omega_max_rad_s": 6.0}
SAVED = {
    "limits.tau_max_Nm": 2.0,
    "limits.u_max_Nm": 0.0625,
    "limits.omega_max_rad_s": 4.25,
    "limits.rom_min_rad": 0.5,
    "limits.energy_max_J": 7.5,
    "smc.margin": 1.5,
}


def keep(board: SimBoard, values: dict[int, float]) -> None:
    """Have the newest set in the flash hold these parameters, by their keys; power off and on."""
    area = board.flash[0]
    size = int.from_bytes(area[8:12], "little")
    at = max(k for k in range(0, len(area) - size - 27, size + 28) if area[k : k + 4] == b"1ASE")
    pairs = b"".join(struct.pack("<If", k, v) for k, v in values.items())
    table = struct.pack("<I", len(values)) + pairs.ljust(8 * 160, b"\0")
    area[at + 24 : at + 24 + len(table)] = table
    whole = bytes(area[at : at + 20]) + bytes(area[at + 24 : at + 24 + size])
    area[at + 20 : at + 24] = zlib.crc32(whole).to_bytes(4, "little")
    board.restart()


@pytest.fixture(scope="module")
def boards(drive):
    """The drive as shipped, and as an update that lowers some maxima has it."""
    head, section, text = drive.toml().partition("[safety]")
    for key, value in LOWERED.items():
        text = re.sub(
            rf"(?m)^{key} = {{ value = [\d.]+", f"{key} = {{ value = {value}", text, count=1
        )
    lowered = parse_device(head + section + text, "lowered.toml")
    made = [SimBoard(drive), SimBoard(lowered)]
    yield made
    for board in made:
        board.close()


def test_lowered_and_raised_maxima_change_the_values_beyond_them_only(boards):
    shipped, lowered = boards
    shipped.restart(blank=True)
    for name, value in SAVED.items():
        shipped.set_parameter(name, value)
    shipped.save_parameters()
    for to, of in zip(lowered.flash, shipped.flash, strict=True):
        to[:] = bytes(of)
    lowered.restart()
    clipped = {"limits.tau_max_Nm": 1.5, "limits.u_max_Nm": 0.0546875}
    found = lowered.parameters()
    assert {n: found[n] for n in SAVED} == SAVED | clipped
    values, total, _ = kept_values(lowered)
    assert {v.name: v.value for v in values} == {n: SAVED[n] for n in clipped}
    assert {v.found for v in values} == {"clipped"}
    assert total == "34 of 36 values as they were saved"
    # What is not in force stays kept until somebody saves: the first firmware finds all of it.
    for to, of in zip(shipped.flash, lowered.flash, strict=True):
        to[:] = bytes(of)
    shipped.restart()
    assert {n: shipped.parameters()[n] for n in SAVED} == SAVED
    assert kept_values(shipped) == ((), "36 of 36 values as they were saved", ())
    lowered.save_parameters()
    assert kept_values(lowered) == ((), "36 of 36 values as they were saved", ())


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_each_value_is_judged_by_itself(boards, data):
    board = boards[1]
    parameters = {p.key: p for p in link_parameters(board.device.system) if not p.fixed}
    near = {k: (p.tunable.low, p.tunable.high) for k, p in parameters.items()}
    single = st.floats(width=32)
    values = {
        k: data.draw(st.sampled_from([b, 2 * b, -b, b / 2]) if data.draw(st.booleans()) else single)
        for k in data.draw(st.lists(st.sampled_from(sorted(parameters)), unique=True, max_size=9))
        for b in [data.draw(st.sampled_from(near[k]))]
    }
    gone = data.draw(st.dictionaries(st.integers(0, 2**32 - 1), single, max_size=3))
    gone = {k: v for k, v in gone.items() if k not in parameters}
    expected = {p.name: float(np.float32(p.tunable.default)) for p in parameters.values()}
    told = {f"0x{k:X}": "unknown" for k in gone}
    for k, value in values.items():
        p, t = parameters[k], parameters[k].tunable
        if t.low <= value <= t.high:
            expected[p.name] = value
        elif t.safer and math.isfinite(value):
            expected[p.name], told[p.name] = t.low if value < t.low else t.high, "clipped"
        else:
            told[p.name] = "out of bounds"
    board.restart(blank=True)
    board.save_parameters()
    keep(board, values | gone)
    assert {n: v for n, v in board.parameters().items() if n in expected} == expected
    found, total, _ = kept_values(board)
    assert {v.name: v.found for v in found} == told
    assert total.startswith(f"{len(values) + len(gone) - len(told)} of {len(values) + len(gone)} ")
    said = {v.name: v.value for v in found}
    for name, kept in [(parameters[k].name, v) for k, v in values.items()]:
        if name in said:
            assert said[name] == pytest.approx(kept, rel=1e-5, abs=1e-43, nan_ok=True)


def test_limits_stay_and_others_go_where_a_set_is_refused_together(drive):
    """No shipped device has such a rule: one is put into its C."""
    files = dict(render_device(drive, ["f32"])[0].files)
    name = "esea_elbow_drive.c"
    rule = (
        "if (params->smc.margin > 1.4f && params->limits.tau_max_Nm < 3.0f)\n        return 99u;\n"
    )
    place = "    /* Written so that NaN is refused too. */\n"
    assert files[name].count(place) == 1
    files[name] = files[name].replace(place, place + "    " + rule)
    board = SimBoard(drive, files)
    board.restart(blank=True)
    board.set_parameter("limits.tau_max_Nm", 2.0)
    board.save_parameters()
    keep(board, {fnv1a(n): v for n, v in SAVED.items()})
    found = board.parameters()
    assert {n: found[n] for n in SAVED} == SAVED | {"smc.margin": 1.0}
    ((value,), *_) = kept_values(board)
    assert (value.name, value.value, value.found) == ("smc.margin", 1.5, "conflicting")
    board.close()


def test_another_layouts_set_is_told_at_the_start_and_when_asked(boards):
    board = boards[0]
    board.restart(blank=True)
    assert kept_values(board)[1] == "0 of 0 values as they were saved"
    board.save_parameters()
    for area in board.flash:
        for at in (m.start() for m in re.finditer(b"1ASE", bytes(area))):
            area[at + 4] = b"\x63"
            size = int.from_bytes(area[at + 8 : at + 12], "little")
            whole = bytes(area[at : at + 20]) + bytes(area[at + 24 : at + 24 + size])
            area[at + 20 : at + 24] = zlib.crc32(whole).to_bytes(4, "little")
    board.texts.clear()
    board.restart()
    assert list(board.texts) == ["kept: a set of another layout, not taken"]
    assert kept_values(board) == ((), "a set of another layout, not taken", ())


def test_the_command_shows_names_values_and_limits(boards, monkeypatch):
    board = boards[1]
    stand_in = SimpleNamespace(session=board, identity=SimpleNamespace(device=board.device))
    monkeypatch.setattr(commands, "open_device", lambda *_: nullcontext(stand_in))
    board.restart(blank=True)
    board.save_parameters()
    nan = float("nan")
    keep(board, {fnv1a("limits.tau_max_Nm"): 2.0, fnv1a("smc.margin"): nan, 7: 0.125})
    said = CliRunner().invoke(app, ["kept", "sim:elbow_drive"], env={"COLUMNS": "200"}).output
    assert "parameters: 0 of 3 values as they were saved" in said
    tau = "2 Nm was saved, outside 0.075 to 1.5 Nm, taken to the bound; in force 1.5 Nm"
    assert f"limits.tau_max_Nm: {tau}" in said
    assert "smc.margin: nan was saved, outside" in said
    assert "not taken; in force 1" in said
    assert "0x7: 0.125 was saved, but this firmware has no such parameter" in said
