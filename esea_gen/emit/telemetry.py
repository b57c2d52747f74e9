"""Bytes of telemetry on the wire."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from esea_gen.emit.messages import FIXED, STREAM_SPAN_MS, STREAM_WORDS, Message, task_messages
from esea_gen.language.system import System

FRAME_BYTES = 12  # header and checksum of a MAVLink 2 frame

# A serial line takes ten bits a byte. USB: what bulk transfers at full speed carry at most, 19
# packets of 64 bytes a millisecond; TCP on any network carries more.
LINES_BYTES_S = {"115200 baud": 11_520, "921600 baud": 92_160, "USB, TCP": 1_216_000}


@dataclass(frozen=True)
class StreamCost:
    """Bytes on the wire, at most: MAVLink leaves out zeros at a message's end."""

    what: str
    rate_Hz: float
    samples: int
    bytes_s: float

    def share(self, line: str) -> float:
        return self.bytes_s / LINES_BYTES_S[line]


def stream_bytes_s(width: int, every: int, tick_s: float, head_bytes: int) -> tuple[int, float]:
    """Samples a message holds, and bytes a second, of a stream of so many values."""
    span = round(STREAM_SPAN_MS * 1e-3 / tick_s) // every
    samples = max(1, min(STREAM_WORDS // width, span))
    message_bytes = FRAME_BYTES + head_bytes + 4 * width * samples
    return samples, message_bytes / (samples * every * tick_s)


def stream_costs(system: System) -> Iterator[StreamCost]:
    """Cost of a System's streams: one value, all outputs, all of a task; and its complete runs."""
    head_bytes = FIXED["ESEA_DATA"].payload_bytes - 4 * STREAM_WORDS
    pairs = iter(task_messages(system))
    for task, given, made in zip(system.tasks, pairs, pairs, strict=True):
        every = task.every
        rate_Hz = 1 / (every * system.base_period_s)
        outputs = _values(made) - 1  # without the ticks of the step
        sets = {"one value": 1, "all outputs": outputs, "everything": _values(given) + outputs + 1}
        for what, width in sets.items():
            left, samples, total = width, 1, 0.0
            while left > 0:
                part = min(left, STREAM_WORDS)
                samples, bytes_s = stream_bytes_s(part, every, system.base_period_s, head_bytes)
                total, left = total + bytes_s, left - part
            yield StreamCost(f"{task.name}: {what} ({width})", rate_Hz, samples, total)
        for message in (given, made):
            whole = (FRAME_BYTES + message.payload_bytes) * rate_Hz
            yield StreamCost(f"message {message.name}", rate_Hz, 1, whole)


def _values(message: Message) -> int:
    return sum(f.size for f in message.fields if f.name != "sequence")


def cost_table(system: System) -> str:
    head = ["telemetry", "Hz", "a message", "bytes/s", *LINES_BYTES_S]
    rows = [head]
    for cost in stream_costs(system):
        shares = [cost.share(line) for line in LINES_BYTES_S]
        told = [f"{100 * s:.0f} %" if s <= 1 else "does not fit" for s in shares]
        rows.append(
            [cost.what, f"{cost.rate_Hz:g}", str(cost.samples), f"{cost.bytes_s:.0f}", *told]
        )
    widths = [max(len(r[i]) for r in rows) for i in range(len(head))]
    lines = []
    for row in rows:
        cells = [
            row[0].ljust(widths[0]),
            *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True)),
        ]
        lines.append("  ".join(cells))
    return "\n".join(lines)
