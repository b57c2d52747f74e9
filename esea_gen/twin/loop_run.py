"""Recording of a closed-loop run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy.typing as npt

from esea_gen.model.sensing import without_axis

Array = npt.NDArray[Any]


class RanAwayError(RuntimeError):
    """The plant left its ranges and was started afresh: the run says nothing beside that."""


@dataclass(frozen=True)
class ClosedLoopRun:
    """Recording of a run, one row a tick: sampled at its start, commanded in it.

    Parameters
    ----------
    plant : dict of str to ndarray
        Every output of the plant, encoder counts included.
    controller : dict of str to ndarray
        Every external output of the controller; a slow task's outputs are held, and 0 before its
        first run.
    time_s : ndarray
        Time of each tick.
    missed_runs : int
        Runs of the controller's last task that were due and left out.
    repaired : dict of str to int
        Ticks in which a Block of the controller repaired its state, by the Block's name.
    """

    plant: dict[str, Array]
    controller: dict[str, Array]
    time_s: Array
    missed_runs: int = 0
    repaired: dict[str, int] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Array:
        """An array by its output's name."""
        if name in self.plant and name in self.controller:
            raise KeyError(f"both plant and controller have {name}: ask .plant or .controller")
        return (self.plant | self.controller)[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.plant | self.controller)

    def __len__(self) -> int:
        return len(self.time_s)

    def of_axis(self, axis: str) -> ClosedLoopRun:
        """The run of one axis, its arrays by their names without the axis.

        Parameters
        ----------
        axis : str
            Its name.
        """
        if not axis:
            return self
        plant, controller = (
            part | {without_axis(n, axis): x for n, x in part.items()}
            for part in (self.plant, self.controller)
        )
        return replace(self, plant=plant, controller=controller)

    def keys(self) -> list[str]:
        """Names of all arrays."""
        return list(self)
