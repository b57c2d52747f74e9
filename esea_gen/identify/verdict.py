"""Torque of a device's C on recordings, and its uncertainty.

The worth is by class of torque and rate, the measured ones: the half width that holds 95 % of the
errors in blocks left out (``recording.resampling``), and how many held-out samples lie in it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt

from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_system
from esea_gen.identify.recording.reading import resample
from esea_gen.identify.recording.recorded import Misfits, Recording
from esea_gen.identify.recording.resampling import LeftOut, covered, half_width_Nm
from esea_gen.language.ports import Array
from esea_gen.language.system import System
from esea_gen.model.family_sensor import TEMPERATURE
from esea_gen.model.sensing import sensing_system


@dataclass(frozen=True)
class Verdict:
    misfits: Misfits
    torque_Nm: dict[str, Array]
    omega_rad_s: dict[str, Array]
    largest_rate_Nm: float


def temperature_tunables(
    device: Device, system: System, recording: Recording
) -> dict[str, dict[str, float]]:
    """Tunables set by a recording's temperature, by instance."""
    known = [(i, t) for i, t in system.tunables if t.name == TEMPERATURE]
    wanted = recording.temperature_C
    if wanted is None or not known:
        return {}
    for _, t in known:
        if not t.low <= t.taken(wanted) <= t.high:
            raise UserError(
                f"{recording.label}: was recorded at {wanted:g} degC, outside {t.low:g} to "
                f"{t.high:g} degC, in which {device.origin}'s [family.temperature] holds.",
                "Leave it out, or identify with a recording at that temperature.",
            )
    return {i: {t.name: t.taken(wanted)} for i, t in known}


def judge(device: Device, recordings: Iterable[Recording]) -> Verdict:
    """Run the device's C over recordings and compare at their own samples.

    The sensor is given the deflection as it was recorded, as in the fit: it does not come in counts
    of the device's encoders, and is not smoothed.
    """
    system = sensing_system(device, device.velocity, device.sensor, counts=False)
    task = compile_system(system, "f64").task("sense")
    errors, largest = [], 0.0
    torque: dict[str, Array] = {}
    omega: dict[str, Array] = {}
    for r in recordings:
        grid = np.arange(math.ceil(r.time_s[-1] / device.period_s) + 1) * device.period_s
        task.prepare(temperature_tunables(device, system, r))
        out, _ = task.run({"theta_rad": resample(r.time_s, r.theta_rad, grid)}, trace=False)
        for found, port in ((torque, "tau_Nm"), (omega, "omega_rad_s")):
            found[r.label] = resample(grid, np.asarray(out[port], dtype=np.float64), r.time_s)
        model = torque[r.label]
        largest = max(largest, float(np.abs(out["tau_rate_Nm"]).max()))
        errors.append((r, model - r.tau_Nm))
    return Verdict(Misfits.of("Nm", errors), torque, omega, largest)


TORQUE_EDGES = (0.0, 0.05, 0.25, 0.5, 0.75, 1.0, math.inf)  # of full scale
RATE_EDGES = (0.0, 0.05, 0.35, 1.0, math.inf)  # of the identified domain's largest rate
Cell = tuple[int | None, int | None]  # class of torque and of rate; None: all
LEAST = 20  # of fewer samples there is no 95 %


@dataclass(frozen=True)
class TorqueWorth:
    """Accuracy of one class of torque and rate; None is all classes."""

    torque: str | None  # of full scale, and of the identified domain's largest rate
    rate: str | None
    band_Nm: float | None  # holds 95 % of the errors; None: too few
    samples: int  # in blocks left out
    held_out: int  # samples that no fit has seen
    held_out_inside: float | None  # share within the band


def label(edges: Sequence[float], i: int) -> str:
    if math.isinf(edges[i + 1]):
        return f"> {100 * edges[i]:g} %"
    return f"{100 * edges[i]:g}-{100 * edges[i + 1]:g} %"


def _class(share: Array, edges: Sequence[float]) -> npt.NDArray[np.intp]:
    # What is just at an edge is below it: the largest torque is 100 %, not above.
    return np.maximum(np.searchsorted(edges, np.abs(share)) - 1, 0)


def worth_of(
    device: Device,
    recordings: Sequence[Recording],
    verdict: Verdict,
    spread: LeftOut | None,
    rows: tuple[Array, Array] | None = None,
) -> tuple[TorqueWorth, ...]:
    """Of an identification, every class of torque at every rate, and at all of them.

    rows: torque and rate of the fit's rows, where these are not the samples.  Nothing where nothing
    was free in its fit.
    """
    if spread is None:
        return ()
    full, most = device.tau_full_scale_Nm, device.file.domain.omega_max_rad_s.value
    timed = all(r.timed for r in recordings)  # else only the classes of torque
    measured = {r.label: r.tau_Nm for r in recordings}
    error = {k: verdict.torque_Nm[k] - tau for k, tau in measured.items()}

    def samples(role: str, of: dict[str, Array]) -> Array:
        return np.concatenate([of[r.label][getattr(s, role)] for r in recordings for s in r.sets])

    def classes(torque: Array, rate: Array) -> list[npt.NDArray[np.intp]]:
        return [_class(torque / full, TORQUE_EDGES), _class(rate / most, RATE_EDGES)]

    def chosen(of: list[npt.NDArray[np.intp]], cell: Cell) -> npt.NDArray[np.bool_]:
        found = np.ones(len(of[0]), dtype=bool)
        for at, k in zip(of, cell, strict=True):
            if k is not None:
                found &= at == k
        return found

    both = measured, verdict.omega_rad_s
    trained = classes(*(rows or (samples("training", x) for x in both)))
    held_out, apart = classes(*(samples("held_out", x) for x in both)), samples("held_out", error)
    torques = [None, *range(len(TORQUE_EDGES) - 1)]
    out = []
    for i, j in product(torques, [None, *range(len(RATE_EDGES) - 1)] if timed else [None]):
        fit, unseen = chosen(trained, (i, j)), chosen(held_out, (i, j))
        n, held, band, inside = int(fit.sum()), int(unseen.sum()), None, None
        if n >= LEAST:
            band = half_width_Nm(spread.outside_Nm[fit], spread.weight[fit])
            inside = covered(apart[unseen], band) if held >= LEAST else None
        names = (
            None if i is None else label(TORQUE_EDGES, i),
            None if j is None else label(RATE_EDGES, j),
        )
        out.append(TorqueWorth(*names, band, n, held, inside))
    return tuple(out)
