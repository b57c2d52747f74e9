"""Correction table of an encoder from a recording beside a better one.

``reference = direction (raw + table(raw)) - zero``, the table linear between its values, as the
encoder's Block computes it (:mod:`esea_gen.model.encoder`).  A play between the two shows as a
difference between the ways that it turns, and is fitted beside the table.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.device import Device
from esea_gen.devices.fields import TABLE_SIZES, EncoderSide, field_facts
from esea_gen.devices.numbers import Quantity, Series
from esea_gen.errors import UserError
from esea_gen.identify.drive.regression import Estimate, fit_linear
from esea_gen.language.ports import Array
from esea_gen.tables import FileTable, read_table

BLOCKS = 40  # stretches of the recording, of whose pulls the intervals are made
LEAST_SAMPLES = 400
COLUMNS = ("count", "reference_rad")


@dataclass(frozen=True)
class EncoderTable:
    side: str
    direction: int
    values: tuple[Estimate | None, ...]  # of each node; None: never seen
    zero_rad: float
    play_rad: Estimate | None  # whole play between encoder and reference
    before_rad: float  # effective error of the angle without and with the table
    after_rad: float
    samples: int

    def filled(self) -> list[float]:
        """Every node's value; one that was never seen has its neighbours' straight line."""
        n = len(self.values)
        seen = [k for k, v in enumerate(self.values) if v is not None]
        known = [v.value for v in self.values if v is not None]
        found = np.interp(np.arange(n), seen, known, period=n)
        return [float(f"{x:.7g}") for x in found]

    def table(self) -> list[str]:
        deg = 180 / math.pi
        lines = [f"{'at deg':>8}{'add deg':>10}{'95 % interval':>24}"]
        for k, v in enumerate(self.values):
            at = f"{360 * k / len(self.values):8.2f}"
            if v is None:
                lines.append(f"{at}{'':10}{'never there':>24}")
            else:
                span = f"{deg * v.low:.4f} to {deg * v.high:.4f}"
                lines.append(f"{at}{deg * v.value:10.4f}{span:>24}")
        if self.play_rad is not None:
            p = self.play_rad
            lines.append(
                f"play between the two: {deg * p.value:.4f} deg "
                f"(95 %: {deg * p.low:.4f} to {deg * p.high:.4f})"
            )
        lines.append(
            f"effective error of the angle: {deg * self.before_rad:.4f} deg without the table, "
            f"{deg * self.after_rad:.4f} with it; {self.samples} samples"
        )
        return lines

    def to_dict(self) -> dict[str, Any]:
        same = ("side", "direction", "zero_rad", "before_rad", "after_rad", "samples")
        return {k: getattr(self, k) for k in same} | {
            "correction_rad": self.filled(),
            "nodes": [None if v is None else v.to_dict("rad") for v in self.values],
            "play": None if self.play_rad is None else self.play_rad.to_dict("rad"),
        }


def read_counts(path: Path, full: int) -> tuple[FileTable, Array, Array]:
    """The table, counts of the encoder and angles of the reference, a row a sample."""
    table = read_table(path, COLUMNS)
    count, reference = (table.numbers(c) for c in COLUMNS)
    wrong = np.flatnonzero((count < 0) | (count >= full) | (count != np.floor(count)))
    if len(wrong):
        raise UserError(
            f"{table.at(wrong[0], 'count')}: {count[wrong[0]]:g} is not a count from 0 to "
            f"{full - 1}.",
            "Remove the row, or give the device with this encoder's resolution_bits.",
        )
    return table, count, reference


def fit_table(side: str, count: Array, reference_rad: Array, full: int, nodes: int) -> EncoderTable:
    """The table of so many nodes that leaves least."""
    if nodes not in TABLE_SIZES:
        raise UserError(f"{nodes}: not a table size.", f"Give {', '.join(map(str, TABLE_SIZES))}.")
    if len(count) < LEAST_SAMPLES:
        raise UserError(f"{len(count)} samples.", f"Record {LEAST_SAMPLES} or more.")
    raw = count * (2 * math.pi / full)
    apart = {way: np.abs(np.mean(np.exp(1j * (way * reference_rad - raw)))) for way in (1, -1)}
    return _fitted(side, max(apart, key=lambda w: float(apart[w])), raw, reference_rad, nodes)


def _fitted(side: str, direction: int, raw: Array, reference: Array, nodes: int) -> EncoderTable:
    off = direction * reference - raw
    middle = float(np.angle(np.mean(np.exp(1j * off))))
    error = np.angle(np.exp(1j * (off - middle)))  # within half a turn of their middle
    place = raw / (2 * math.pi) * nodes
    cell = place.astype(int) % nodes
    part = place - np.floor(place)
    hats = np.zeros((len(raw), nodes))
    rows = np.arange(len(raw))
    hats[rows, cell] = 1 - part
    hats[rows, (cell + 1) % nodes] += part
    seen = np.flatnonzero(hats.sum(axis=0) > 1)
    moved = np.sign(np.convolve(reference, np.r_[np.ones(5), np.zeros(1), -np.ones(5)], "same"))
    both = np.mean(moved > 0) > 0.1 and np.mean(moved < 0) > 0.1
    terms = np.column_stack([hats[:, seen], *([0.5 * moved] if both else [])])
    blocks = np.floor(rows * (BLOCKS / len(rows)))
    fit = fit_linear(terms, error, blocks)
    values = fit.estimates()
    play = values.pop() if both else None
    values = _bent(values)
    # Table and zero share their mean: the table's is 0.
    mean = float(np.mean([v.value for v in values]))
    at: list[Estimate | None] = [None] * nodes
    for k, v in zip(seen, values, strict=True):
        at[k] = Estimate(v.value - mean, v.low - mean, v.high - mean)
    before = float(np.std(error))
    size = None if play is None else play.times(math.copysign(1.0, play.value))
    # reference = direction (raw + table) - zero
    zero = float(np.angle(np.exp(-1j * direction * (middle + mean))))
    return EncoderTable(side, direction, tuple(at), zero, size, before, fit.rms, len(raw))


def _bent(values: list[Estimate]) -> list[Estimate]:
    # A straight line misses an eighth of the second difference; no spread of samples shows that.
    level = np.array([v.value for v in values])
    misses = np.abs(np.roll(level, 1) - 2 * level + np.roll(level, -1)) / 8
    halves = [math.hypot(v.half, float(m)) for v, m in zip(values, misses, strict=True)]
    return [
        Estimate(v.value, v.value - h, v.value + h) for v, h in zip(values, halves, strict=True)
    ]


def with_table(device: Device, found: EncoderTable, orientation_rad: float, source: str) -> Device:
    own = getattr(device.file.encoder, found.side) or EncoderSide()
    widest = max(v.half for v in found.values if v is not None)
    text = f"{source}; 95 % intervals of up to {widest:.2g} rad either way"
    at = Quantity(value=orientation_rad, status="identified", source=source)
    most = field_facts(f"encoder.{found.side}.correction_rad")["high"]
    if max(map(abs, found.filled())) > most:
        raise UserError(
            f"A correction of {max(map(abs, found.filled())):.3g} rad is above {most:g} rad.",
            "The encoder slips, or is not this one.",
        )
    side = own.model_copy(
        update={
            "correction_rad": Series(
                values=tuple(found.filled()), status="identified", source=text
            ),
            "correction_orientation_rad": at,
            "orientation_rad": own.orientation_rad or at,
        }
    )
    encoder = device.file.encoder.model_copy(update={found.side: side})
    return Device(device.file.model_copy(update={"encoder": encoder}), device.origin)
