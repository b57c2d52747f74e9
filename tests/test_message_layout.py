"""Layout of the device's messages, and what their streams cost, counted by hand."""

from __future__ import annotations

import casadi as ca
import pytest

from esea_gen.emit import telemetry
from esea_gen.emit.messages import messages, status_words
from esea_gen.emit.telemetry import StreamCost, cost_table, stream_bytes_s, stream_costs
from esea_gen.errors import UserError
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port, flag_word
from esea_gen.language.system import System, Task

U32, F32 = 4, 4  # bytes

# Id, then fields as the host decodes them: name, bytes of an element, elements.  59 values fit a
# frame of 255 bytes beside 17 of head, 58 words beside 12.
LAYOUT = {
    "ESEA_INFO": (42600, "tick_us:4 fault:4 steps:4 sequence_gaps:4 bad_frames:4 "
                  "unknown_messages:4 lost_bytes:4 receive_buffer_bytes:4 empty_ticks:4 "
                  "stack_bytes:4 stack_peak_bytes:4 content_hash:1x16 device:1x16 board:1x16"),
    "ESEA_WANTED": (42660, None),
    "ESEA_CLOCK": (42661, "tick:4 lost_ticks:4 missed_runs:4 late_runs:4 dropped:4 refused:4 "
                   "deadline_left:4 state:4"),
    "ESEA_STREAM": (42662, "interval:2 stream:1 task:1 choice:1 count:1 samples:1 result:1 "
                    "signals:1x59"),
    "ESEA_DATA": (42663, "time:8 sequence:4 interval:2 stream:1 choice:1 count:1 data:1x236"),
    "ESEA_TRAFFIC": (42664, "stream_messages:4 stream_dropped:4 paired:4 unsigned_refused:4 "
                     "bad_signatures:4 replayed:4 parameters_refused:4 expired:4"),
    "ESEA_KEY": (42665, "sequence:4 first:4 total:4 words:4x58"),
    "ESEA_KEPT": (42666, "serial:4x4 zero_rad:4x4 starts:4 armings:4 faults:4 watchdog_resets:4 "
                  "saves:4 active_s:4 encoders:1 zero:1 result:1"),
    "ESEA_BLACKBOX": (42667, "first:4 count:4 fault:4 tick:4 records:1 size:1 whole:1 "
                      "data:1x224"),
    "ESEA_LIFE": (42668, "serial:4 seconds:4 full:4 energy_J:4 width_rad:4 halves:4x48 number:1 "
                  "couplings:1 records:1 result:1"),
    "ESEA_STAMP": (42669, "signature:8 boot:4 time_ms:4"),
}  # fmt: skip
ENUMS = {
    "ESEA_INFO.fault": "ESEA_FAULT",
    "ESEA_CLOCK.state": "ESEA_STATE",
    "ESEA_STREAM.result": "MAV_RESULT",
    "ESEA_KEPT.zero": "ESEA_ZERO",
    "ESEA_KEPT.result": "MAV_RESULT",
    "ESEA_BLACKBOX.fault": "ESEA_FAULT",
    "ESEA_LIFE.result": "MAV_RESULT",
}


def test_every_message_has_its_id_and_its_fields(drive):
    found = {m.name: m for m in messages(drive.system)}
    tasks = {f"ESEA_{t.name}_{end}".upper() for t in drive.system.tasks for end in ("IN", "OUT")}
    assert set(found) == set(LAYOUT) | tasks
    for name, (number, fields) in LAYOUT.items():
        assert found[name].id == number
        if fields is None:
            continue
        wanted = []
        for field in fields.split():
            label, _, size = field.partition(":")
            element, _, count = size.partition("x")
            wanted.append((label, int(element) * int(count or 1), int(count or 1)))
        assert [(f.name, f.bytes, f.size) for f in found[name].fields] == wanted
        assert found[name].payload_bytes == sum(w[1] for w in wanted)
        for f in found[name].fields:
            assert f.enum == ENUMS.get(f"{name}.{f.name}", "")
            assert not f.bitmask
    # Times and angles are told with their unit.
    told = {f"{m.name}.{f.name}": f.units for m in found.values() for f in m.fields if f.units}
    assert told["ESEA_INFO.tick_us"] == "us"
    assert told["ESEA_KEPT.active_s"] == told["ESEA_LIFE.seconds"] == "s"
    assert told["ESEA_LIFE.width_rad"] == "rad"
    assert told["ESEA_INFO.stack_peak_bytes"] == told["ESEA_INFO.lost_bytes"] == "bytes"
    (deadline,) = (f for f in found["ESEA_WANTED"].fields if f.name == "deadline_ms")
    assert (deadline.c_type, deadline.units) == ("uint16_t", "ms")
    # A command names 20 ms to 1 s; where it names none, 100 ms.
    assert "20 to 1000" in deadline.description
    assert "0: 100." in deadline.description


def tiny(outputs: int = 3, size: int = 2, every: int = 2, control: bool = True) -> System:
    """One Block with a vector and a word, in a task every few milliseconds."""

    def step(_c, _s, u, guard, _label):
        y = {f"y{k}_Nm": u.x_Nm[0] * (k + 1) for k in range(outputs)}
        return {}, {**y, "status": flag_word([ca.logic_not(guard.inputs_ok)])}

    flags = (Flag("INPUT_INVALID", "the input was outside its range"),)
    block = Block.define(
        "echo",
        "Gives back what it is given",
        period_s=0.001 * every,
        state=(),
        inputs=(Port("x_Nm", -1.0, 1.0, "in", size, on_invalid=0.0),),
        outputs=(
            *(Port(f"y{k}_Nm", -99.0, 99.0, "out") for k in range(outputs)),
            Port("status", 0, 1, "what is known", flags=flags),
        ),
        step=step,
    )
    external = {f"y{k}_Nm": f"echo.y{k}_Nm" for k in range(outputs)} | {"status": "echo.status"}
    tasks = (Task("run", ("echo",), every=every),)
    return System("small", 0.001, {"echo": block}, tasks, {}, {"x_Nm": ("echo.x_Nm",)}, external)


def test_messages_of_a_task_and_the_enum_of_its_word():
    system = tiny()
    by_name = {m.name: m for m in messages(system)}
    assert "ESEA_WANTED" not in by_name
    given, made = by_name["ESEA_RUN_IN"], by_name["ESEA_RUN_OUT"]
    assert (given.id, made.id) == (42601, 42602)
    assert given.payload_bytes == U32 + 2 * F32
    assert made.payload_bytes == U32 + 3 * F32 + U32 + U32
    assert "(period 2 ms)" in given.description
    (word,) = status_words(system)
    assert (word.enum, [f.name for f in word.flags]) == ("ESEA_SMALL_STATUS", ["INPUT_INVALID"])
    (field,) = (f for f in made.fields if f.name == "status")
    assert (field.c_type, field.enum, field.bitmask) == ("uint32_t", "ESEA_SMALL_STATUS", True)
    assert [f.units for f in given.fields] == ["", ""]  # MAVLink knows no newton metre


def test_a_task_of_more_than_a_frame_is_refused():
    # 4 of the run, 4 an output, 4 of the word, 4 of the time: 60 outputs are 252, of 255.
    assert next(m for m in messages(tiny(60)) if m.id == 42602).payload_bytes == 252
    with pytest.raises(UserError, match=r"ESEA_RUN_OUT has 64 fields in 256 bytes; .* 64 in 255"):
        messages(tiny(61))
    assert next(m for m in messages(tiny(size=62)) if m.id == 42601).payload_bytes == 252


@pytest.mark.parametrize(
    ("width", "every", "samples", "bytes_a_message"),
    [
        # A sample waits 20 ms for others at most: 20 ticks of 1 ms; 59 values fill a message.
        (1, 1, 20, 12 + 17 + 80),
        (3, 1, 19, 12 + 17 + 4 * 57),
        (30, 1, 1, 12 + 17 + 120),
        (59, 1, 1, 12 + 17 + 236),
        (1, 5, 4, 12 + 17 + 16),
        (1, 40, 1, 12 + 17 + 4),
        (20, 5, 2, 12 + 17 + 160),
    ],
)
def test_bytes_a_second_of_a_stream(width, every, samples, bytes_a_message):
    found = stream_bytes_s(width, every, 0.001, 17)
    assert found[0] == samples
    assert found[1] == pytest.approx(bytes_a_message / (samples * every * 0.001))


def test_costs_of_a_task_by_hand():
    costs = {c.what: c for c in stream_costs(tiny())}
    # Every 2 ms; the word and three numbers go out, with the ticks of the step, and two come in.
    assert list(costs) == [
        "run: one value (1)",
        "run: all outputs (4)",
        "run: everything (7)",
        "message ESEA_RUN_IN",
        "message ESEA_RUN_OUT",
    ]
    assert [c.rate_Hz for c in costs.values()] == pytest.approx([500.0] * 5)
    one, four, seven, given, made = costs.values()
    assert [c.samples for c in costs.values()] == [10, 10, 8, 1, 1]
    assert one.bytes_s == pytest.approx((29 + 4 * 10) / 0.020)
    assert four.bytes_s == pytest.approx((29 + 4 * 40) / 0.020)
    assert seven.bytes_s == pytest.approx((29 + 4 * 56) / 0.016)
    assert given.bytes_s == pytest.approx((12 + 12) * 500)
    assert made.bytes_s == pytest.approx((12 + 24) * 500)
    # Ten bits a byte: 115200 baud carry 11520 a second; USB 19 packets of 64 bytes a millisecond.
    assert given.share("115200 baud") == pytest.approx(12000 / 11520)
    assert given.share("921600 baud") == pytest.approx(12000 / 92160)
    assert given.share("USB, TCP") == pytest.approx(12000 / 1_216_000)


def test_more_than_a_message_holds_goes_in_several():
    # 62 + 4 + 1 values every 2 ms: 59 in one, 8 in another of seven samples.
    costs = {c.what: c for c in stream_costs(tiny(size=62))}
    whole = costs["run: everything (67)"]
    assert whole.bytes_s == pytest.approx((29 + 236) / 0.002 + (29 + 4 * 56) / 0.014)
    assert whole.samples == 7


def test_the_table_of_costs():
    head, *rows = cost_table(tiny()).splitlines()
    assert head.split() == ["telemetry", "Hz", "a", "message", "bytes/s", "115200", "baud",
                            "921600", "baud", "USB,", "TCP"]  # fmt: skip
    assert len({len(r) for r in (head, *rows)}) == 1
    cells = [[c for c in r.split("  ") if c.strip()] for r in rows]
    assert [c.strip() for c in cells[0]] == [
        "run: one value (1)", "500", "10", "3450", "30 %", "4 %", "0 %",
    ]  # fmt: skip
    assert [c.strip() for c in cells[3]] == [
        "message ESEA_RUN_IN", "500", "1", "12000", "does not fit", "13 %", "1 %",
    ]  # fmt: skip


def test_a_line_carries_what_fills_it_and_no_more(monkeypatch):
    costs = (StreamCost("full", 1.0, 1, 11_520.0), StreamCost("more", 2.5, 3, 11_521.0))
    monkeypatch.setattr(telemetry, "stream_costs", lambda system: iter(costs))
    _, *rows = cost_table(None).splitlines()
    assert [[c.strip() for c in r.split("  ") if c.strip()] for r in rows] == [
        ["full", "1", "1", "11520", "100 %", "12 %", "1 %"],
        ["more", "2.5", "3", "11521", "does not fit", "13 %", "1 %"],
    ]
