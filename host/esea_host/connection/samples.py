"""Rows one by one, for those who want no arrays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from esea_host.connection.decoder import TICK
from esea_host.connection.receiver import Batch


@dataclass(frozen=True)
class RunSample:
    """One run of a task.

    Parameters
    ----------
    stream : str
        Which task's, and whether its input or output.
    tick : int
        Base tick.
    time_s : float
        By the board's clock.
    values : dict of str to float
        By name, in the unit of the name.
    """

    stream: str
    tick: int
    time_s: float
    values: dict[str, Any]

    def __getitem__(self, name: str) -> Any:
        """A value by its name."""
        return self.values[name]


def run_samples(batch: Batch, wanted: tuple[str, ...]) -> Iterator[RunSample]:
    """A batch's rows one by one."""
    columns = {n: batch.rows[n].tolist() for n in wanted}
    ticks, times = batch.rows[TICK].tolist(), (batch.board_ns * 1e-9).tolist()
    for i, (tick, time_s) in enumerate(zip(ticks, times, strict=True)):
        yield RunSample(batch.layout.name, tick, time_s, {n: c[i] for n, c in columns.items()})
