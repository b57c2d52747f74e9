"""The wire on the simulated board: streams, parameters, time, signed commands."""

from __future__ import annotations

import binascii
import json
import re
import struct
from itertools import pairwise

import numpy as np
import pytest

from esea_gen.emit.dialect import render_dialect
from esea_gen.emit.states import TIMES_MS
from esea_gen.emit.telemetry import stream_costs
from esea_gen.link.transport import LinkError
from tests.sim_drive import ANGLES, active, texts, zeroed

pytestmark = pytest.mark.ci

STOP, RESET = "MAV_CMD_USER_4", "MAV_CMD_USER_1"


@pytest.fixture
def board(powered):
    powered.restart(blank=True)
    powered.sign_with(None)
    powered.stop_streams()
    powered.measure(**ANGLES)
    return powered


def samples_of(board, stream):
    found = [s for m in board.pending() if (s := board.samples(m)) is not None]
    return [s for s in found if s.names == stream.names]


def gaps(samples, interval):
    """Samples that are missing between those that came."""
    return sum((b - a) // interval - 1 for a, b in pairwise([t for s in samples for t in s.times]))


# -- streams ---------------------------------------------------------------------------------------


def test_every_value_of_every_task_streams_as_its_own_message_has_it(board):
    """All inputs and outputs of both tasks, bit for bit those of the whole-run messages."""
    zeroed(board)
    sense, control = board.stream(["sense.*", "control.*"])
    assert len(sense.signals) + len(control.signals) == len(board.signals()) == 12 + 45 + 0 + 12
    for task in ("SENSE", "CONTROL"):
        for side in ("IN", "OUT"):
            board.tell(f"ESEA_{task}_{side}", 1000)
    for k in range(50):
        board.measure(**{n: v + k for n, v in ANGLES.items()})
        board.ticks(1)
    messages = board.pending()
    runs = {}
    for m in messages:
        if (found := re.fullmatch(r"ESEA_(\w+)_(IN|OUT)", m.get_type())) is not None:
            runs.setdefault((found[1].lower(), m.sequence), {}).update(m.to_dict())
    compared = 0
    for s in filter(None, map(board.samples, messages)):
        for tick, row in zip(s.sequences, s.values, strict=True):
            for name, value in zip(s.names, row, strict=True):
                task, _, field = name.partition(".")
                assert np.array_equal(value, runs[task, tick][field], equal_nan=True), (name, tick)
                compared += 1
    assert compared >= 45 * 53 + 5 * 12


def test_no_sample_waits_longer_than_20_ms_for_others(board):
    (fast,) = board.stream(["tau_Nm"])
    (slow,) = board.stream(["u_command_Nm"])
    (rare,) = board.stream(["theta_load_rad"], rate_Hz=10)
    assert (fast.samples, slow.samples, rare.samples) == (20, 4, 1)
    assert (fast.rate_Hz, slow.rate_Hz, rare.rate_Hz) == (1000, 200, 10)
    board.ticks(401)
    for stream, every in ((fast, 1), (slow, 5), (rare, 100)):
        assert set(np.diff([t for s in samples_of(board, stream) for t in s.times])) <= {every}
        board.pending()
        board.ticks(401)


def test_the_clock_of_a_sample_goes_on_where_the_tick_is_set_back(board):
    (stream,) = board.stream(["tau_Nm", "step_ticks"][:1])
    board.ticks(100)
    board.reset()  # forgets what came before
    board.ticks(100)
    found = samples_of(board, stream)
    # From power-on; the run's tick starts again, and a message holds neither gap nor jump.
    assert found[0].times[0] < 105
    assert found[-1].sequences[-1] < 100 < found[-1].times[-1]
    for s in found:
        assert np.array_equal(np.diff(s.times), np.diff(s.sequences))


def test_a_lost_tick_ends_a_message_so_that_every_sample_has_its_own_time(board):
    """What is measured tells the time."""
    measured = board.inputs[0]
    (stream,) = board.stream([f"sense.{measured}"])
    now = 0
    for step in [1] * 30 + [3] + [1] * 30:
        now += step
        board.measure(**{measured: now})
        board.lib.sim_tick(step, True)
        board.lib.sim_poll()
    found = samples_of(board, stream)
    assert gaps(found, 1) == 2
    told = [(t, v) for s in found for t, (v,) in zip(s.times, s.values, strict=True)]
    assert len(told) > 40
    assert all(t == v for t, v in told)


def test_what_finds_no_room_is_dropped_by_whole_messages_and_counted(board):
    """The main loop does not come by: four messages wait, the others are left out."""
    (stream,) = board.stream(["tau_Nm"])
    board.ticks(200, poll=False)  # 10 messages
    board.lib.sim_poll()
    board.ticks(41)
    found = samples_of(board, stream)
    times = [t for s in found for t in s.times]
    traffic = board.traffic()
    assert traffic.stream_dropped == 6
    assert gaps(found, 1) == 6 * 20
    assert times[:80] == list(range(times[0], times[0] + 80))
    assert traffic.stream_messages == len(found) == 6


def test_a_full_line_keeps_no_command_waiting(board):
    """However much is streamed, a stop is taken in the poll after it came."""
    board.stream(["sense.*"])
    for _ in range(3):
        board.ticks(50, poll=False)
        board.stop()
        assert board.state_now == "STOPPED"
        board.release()


def test_streams_end_and_what_was_sent_before_is_not_taken_for_the_new_choice(board):
    (old,) = board.stream(["tau_Nm"])
    board.ticks(40)
    before = [m for m in board.pending() if m.get_type() == "ESEA_DATA"]
    board.stop_streams()
    board.ticks(40)
    assert [m for m in board.pending() if m.get_type() == "ESEA_DATA"] == []
    (new,) = board.stream(["u_Nm"])
    assert new.number == old.number
    assert [board.samples(m) for m in before] == [None] * len(before)


def test_names_that_are_not_clear_are_refused_before_anything_is_sent(board):
    with pytest.raises(ValueError, match=r"tau_Nn cannot be streamed; there is .*sense\.tau_Nm"):
        board.stream(["tau_Nn"])
    with pytest.raises(ValueError, match=r"say control\.step_ticks or sense\.step_ticks"):
        board.stream(["step_ticks"])
    for _ in range(6):
        board.stream(["tau_Nm"])
    with pytest.raises(LinkError, match="all 6 streams are in use"):
        board.stream(["tau_Nm"])


@pytest.mark.parametrize(
    ("number", "task", "signals"),
    [(6, 0, [0]), (0, 2, [0]), (0, 0, [57]), (0, 1, [13]), (0, 0, [])],
)
def test_a_stream_of_what_there_is_not_is_denied(board, number, task, signals):
    fields = {"interval": 1, "stream": number, "task": task, "choice": 1, "samples": 0, "result": 0}
    filled = signals + [0] * (59 - len(signals))
    ask = board.dialect.MAVLink_esea_stream_message
    board.send(ask(**fields, count=len(signals), signals=filled))
    assert board.wait_for("ESEA_STREAM").result == board.dialect.MAV_RESULT_DENIED
    board.ticks(40)
    assert not [m for m in board.pending() if m.get_type() == "ESEA_DATA"]


def bytes_in_a_second(board):
    board.pending()
    total = 0
    for _ in range(1000):
        board.lib.sim_tick(1, True)
        total += len(board.transport.read(0.0))
    return total


@pytest.mark.parametrize(
    ("what", "names"),
    [("sense: everything (57)", ["sense.*"]), ("control: one value (1)", ["u_command_Nm"])],
)
def test_streams_cost_what_build_says(board, drive, what, names):
    """Counted on the line; what ends in zeros costs less, by less than those values."""
    costs = {c.what: c for c in stream_costs(drive.system)}
    active(zeroed(board))
    idle = bytes_in_a_second(board)
    (stream,) = board.stream(names)
    told = bytes_in_a_second(board) - idle
    cost = costs[what]
    trimmed = 4 * len(stream.signals) * cost.rate_Hz
    one_message = cost.bytes_s * stream.samples / cost.rate_Hz
    assert cost.bytes_s - trimmed - one_message <= told <= cost.bytes_s + one_message
    assert stream.samples == cost.samples


# -- parameters ------------------------------------------------------------------------------------


def test_the_metadata_is_as_the_standard_has_it(drive):
    """Against the keys of MAVLink's parameter.schema.json, version 3."""
    content = json.loads(render_dialect(drive).files["esea_elbow_drive_parameters.json"])
    assert set(content) == {"version", "parameters"}
    assert content["version"] == 3
    known = {"name", "type", "shortDesc", "longDesc", "units", "default", "min", "max", "group",
             "readOnly"}  # fmt: skip
    tunables = {f"{i}.{t.name}": t for i, t in drive.system.tunables}
    assert len(content["parameters"]) == len(tunables)
    for entry in content["parameters"]:
        assert set(entry) == known
        tunable = tunables[entry["shortDesc"]]
        assert (entry["min"], entry["max"]) == (tunable.low, tunable.high)
        assert entry["type"] == "Float"
        assert tunable.meaning in entry["longDesc"]
        assert entry["readOnly"] == ("zero" in tunable.name)


def test_a_parameter_that_is_set_is_in_the_next_step_and_outlives_reset_and_zeroing(board):
    """The default set by hand gives the same bits, another value others."""
    counts = np.float32(700 + np.random.default_rng(4).integers(0, 9, 120))

    def run(bandwidth_Hz):
        board.restart()
        if bandwidth_Hz:
            assert board.set_parameter("velocity.bandwidth_Hz", bandwidth_Hz) == bandwidth_Hz
        board.measure(**ANGLES)
        zeroed(board)
        board.reset()
        zeroed(board)
        if bandwidth_Hz:
            assert board.parameter("velocity.bandwidth_Hz") == bandwidth_Hz
        (stream,) = board.stream(["tau_Nm", "theta_motor_rad"])
        for c in counts:
            board.measure(**ANGLES | {"count_motor": float(c)})
            board.ticks(1)
        found = [s for m in board.pending() if m.get_type() == "ESEA_DATA"
                 for s in [stream.decode(m)]]  # fmt: skip
        return np.array([row for s in found for row in s.values], np.float32)

    default = run(None)
    assert np.array_equal(run(15.0), default)  # what the default is
    assert not np.array_equal(run(40.0), default)


def test_coefficients_that_were_set_are_prepared_whole(board):
    """The limits latch COEFFICIENTS on any that do not fit their checksum: none does."""
    zeroed(board)
    board.arm()
    board.disarm()
    for value in (15.0, 60.0, 15.5, 30.0):
        board.set_parameter("motor_rate.cutoff_Hz", value)
        board.ticks(7)
    board.arm()
    board.ticks(1)
    board.want(mode=1.0)
    board.ticks(20)
    assert board.state_now == "ACTIVE"


def test_a_value_outside_its_bounds_leaves_all_as_it_is(board):
    for value in (100.0001, 1.9999, float("nan"), float("inf"), -float("inf")):
        with pytest.raises(LinkError, match="is outside 2 to 100; it was left as it is"):
            board.set_parameter("velocity.bandwidth_Hz", value)
        assert board.parameter("velocity.bandwidth_Hz") == 15
    assert board.set_parameter("velocity.bandwidth_Hz", 100.0) == 100
    assert board.set_parameter("velocity.bandwidth_Hz", 2.0) == 2
    assert board.traffic().parameters_refused == 5


def test_what_a_calibration_sets_nobody_else_does(board):
    for name in ("encoder_motor.zero_rad", "encoder_load.zeroed"):
        with pytest.raises(LinkError, match="by a calibration only"):
            board.set_parameter(name, 1.0)
    assert board.state_now == "UNREFERENCED"


def test_with_the_motor_on_no_parameter_changes_and_the_reply_says_so(board):
    zeroed(board)
    allowed = board.set_parameter("limits.tau_max_Nm", 4.0)
    active_states = {"ARMED": board.arm, "ACTIVE": None}
    board.arm()
    board.ticks(1)
    for state in active_states:
        assert board.state_now == state
        with pytest.raises(LinkError, match=f"does not set limits.tau_max_Nm now: it is {state}"):
            board.set_parameter("limits.tau_max_Nm", 8.0)
        with pytest.raises(LinkError, match=f"it is {state}"):
            board.default_parameters()
        assert f"parameter refused in state {state}" in texts(board)
        board.want(mode=1.0)
        board.ticks(1)
    assert board.parameter("limits.tau_max_Nm") == allowed
    board.stop()
    board.ticks(TIMES_MS["STOP_OFF"][0])
    assert board.set_parameter("limits.tau_max_Nm", 5.0) == 5


def test_defaults_come_back_but_a_zero_stays(board):
    zeroed(board)
    zero_rad = board.parameter("encoder_motor.zero_rad")
    assert zero_rad != 0
    board.set_parameter("smc.margin", 1.5)
    board.default_parameters()
    values = board.parameters()
    assert values["encoder_motor.zero_rad"] == zero_rad
    assert values["encoder_motor.zeroed"] == 1
    assert values["smc.margin"] != 1.5
    board.arm()


def test_what_was_never_saved_cannot_be_loaded(board):
    with pytest.raises(LinkError, match="cannot load its parameters"):
        board.load_parameters()
    assert board.command(board.dialect.MAV_CMD_PREFLIGHT_STORAGE, 3.0) == 2
    assert board.command(board.dialect.MAV_CMD_PREFLIGHT_STORAGE, float("nan")) == 2


def spoil(area, find: bytes, put: bytes) -> None:
    """Other bytes in the newest set of an area of flash, under a checksum that fits."""
    data = bytearray(area[:])
    at = data.rindex(struct.pack("<I", 0x45534131))
    size = struct.unpack_from("<I", data, at + 8)[0]
    place = data.index(find, at)
    data[place : place + len(put)] = put
    crc = binascii.crc32(data[at : at + 20] + data[at + 24 : at + 24 + size])
    struct.pack_into("<I", data, at + 20, crc)
    area[:] = bytes(data)


def test_parameters_and_key_outlive_power_off(board, tmp_path):
    with pytest.raises(LinkError, match="cannot load"):
        board.load_parameters()
    zeroed(board)
    board.set_parameter("limits.tau_max_Nm", 4.0)
    board.set_parameter("smc.margin", 1.5)
    board.save_parameters()
    board.set_parameter("smc.margin", 1.0)
    board.restart()
    kept = board.parameters()
    assert (kept["limits.tau_max_Nm"], kept["smc.margin"]) == (4.0, 1.5)
    # A zero is the encoders', not a parameter: it is not taken from there.
    assert kept["encoder_motor.zeroed"] == 0
    assert board.state_now == "UNREFERENCED"
    board.set_parameter("smc.margin", 1.25)
    board.load_parameters()
    assert board.parameter("smc.margin") == 1.5
    # An invalid stored value falls back to its own default; the others stay.
    board.set_parameter("velocity.bandwidth_Hz", 33.0)
    board.save_parameters()
    spoil(board.flash[0], struct.pack("<f", 33.0), struct.pack("<f", 34.0))
    board.restart()
    assert board.parameter("velocity.bandwidth_Hz") == 34
    spoil(board.flash[0], struct.pack("<f", 34.0), struct.pack("<f", 1e9))
    board.restart()
    assert board.parameter("velocity.bandwidth_Hz") == 15
    assert board.parameter("limits.tau_max_Nm") == 4

    board.pair(tmp_path / "key")
    board.restart()
    board.sign_with(None)
    assert board.command(board.dialect.MAV_CMD_USER_1) == board.dialect.MAV_RESULT_DENIED
    board.use_key(tmp_path / "key")
    assert board.traffic().paired == 1
    board.sign_with(None)


# -- time ------------------------------------------------------------------------------------------


def test_the_clocks_are_compared_by_the_device_clock_of_the_samples(board):
    board.ticks(1234)
    sync = board.time_sync(4)
    device_ns = sync.offset_ns + sync.host_ns
    # Base ticks since power-on, and what the counter has gone on since the last, which is nothing.
    assert abs(device_ns - 1234 * 1_000_000) <= 1
    assert 0 < sync.round_trip_ns < 1e9
    (stream,) = board.stream(["tau_Nm"])
    board.ticks(20)
    assert samples_of(board, stream)[0].times[-1] == 1234 + 20


# -- texts -----------------------------------------------------------------------------------------


def test_faults_and_refusals_are_said(board):
    active(zeroed(board))
    board.measure(count_motor=700, count_load=1200, count_gear=5)
    board.want(mode=1.0)
    board.ticks(20)
    assert board.state_now == "FAULT"
    assert len([t for t in texts(board) if t.startswith("fault ")]) == 1
    with pytest.raises(LinkError):
        board.arm()
    assert "command refused in state FAULT" in texts(board)


# -- what is answered, and what is not the board's -------------------------------------------------


def kinds(board):
    return [m.get_type() for m in board.pending()]


def test_an_input_is_answered_by_its_run_or_by_the_state(board):
    zeroed(board)
    board.pending()
    board.send(board.message("ESEA_SENSE_IN", 0, *[0.0] * 12))
    assert "ESEA_SENSE_OUT" in kinds(board)
    board.reset()
    active(zeroed(board))
    board.pending()
    board.send(board.message("ESEA_SENSE_IN", 0, *[0.0] * 12))
    assert kinds(board) == ["HEARTBEAT"]
    assert board.state_now == "ACTIVE"
