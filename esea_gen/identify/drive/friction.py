"""Friction of a drive from runs at steady speeds: Coulomb, Stribeck, viscous, load.

At a steady speed w the motor's torque is what friction takes [1]_::

    tau = load + s(w) (fc + fs exp(-|w| / vs)) + fv w

A run is one point of the least squares, its mean, so that what errs the same way for a whole run
counts once.  Samples far from their run's median are left out.

References
----------
.. [1] B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, "A survey of models, analysis tools and
   compensation methods for the control of machines with friction", Automatica 30(7), 1994.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError
from esea_gen.identify.drive.regression import Estimate, fit_linear, fit_separable
from esea_gen.language.ports import Array
from esea_gen.tables import FileTable, TableFormat, numbered, read_table
from esea_gen.toml_file import read_text

FAR = 6.0  # median absolute deviations from the run's median
LEAST_RUNS, LEAST_SPREAD = 6, 4.0  # runs, and fastest over slowest of them
EPOS = "EPOS Studio"
COMMENT = re.compile(r",(?!\d)")
LINE_END = re.compile("\r\n|\r|\n")


@dataclass(frozen=True)
class SteadyRun:
    name: str
    omega_rad_s: Array  # at the motor shaft, shape (n,)
    tau_Nm: Array
    read_as: str = ""  # how the file was read, and what was left out


@dataclass(frozen=True)
class Friction:
    """Identified friction at the motor shaft."""

    load_Nm: Estimate
    fc_Nm: Estimate
    fs_Nm: Estimate | None  # Stribeck's rise; None: none is seen
    vs_rad_s: Estimate | None
    fv_Nms_rad: Estimate
    left_Nm: float  # effective value of what the model leaves of the runs' means, and of these
    moved_Nm: float
    runs: int
    used: int  # samples that were used, and that were left out
    outside: int

    def torque_Nm(self, omega_rad_s: Array) -> Array:
        way, size = np.sign(omega_rad_s), np.abs(omega_rad_s)
        dry = np.full(np.shape(size), self.fc_Nm.value)
        if self.fs_Nm is not None and self.vs_rad_s is not None:
            dry = dry + self.fs_Nm.value * np.exp(-size / self.vs_rad_s.value)
        return np.asarray(self.load_Nm.value + way * dry + self.fv_Nms_rad.value * omega_rad_s)

    def at_joint(self, ratio: float) -> dict[str, Estimate]:
        """The same by the keys of ``[actuator]``, behind a gear of this ratio."""
        found = {
            "fc_Nm": (self.fc_Nm, ratio),
            "fv_Nms_rad": (self.fv_Nms_rad, ratio**2),
            "stribeck_Nm": (self.fs_Nm, ratio),
            "stribeck_rad_s": (self.vs_rad_s, 1 / ratio),
        }
        return {k: e.times(by) for k, (e, by) in found.items() if e is not None}

    def table(self) -> list[str]:
        lines = [
            f"{self.runs} runs, {self.used} samples; {self.outside} far from their run's median "
            "left out"
        ]
        for name, (unit, text) in ESTIMATES.items():
            e, shown = getattr(self, name), unit.replace("_", "/")
            value = "not significant: its 95 % interval contains 0"
            if e is not None:
                value = f"{e.value:.4g} {shown} (95 %: {e.low:.4g} to {e.high:.4g})"
            lines.append(f"{text}: {value}")
        share = self.left_Nm / self.moved_Nm
        lines.append(
            f"left over: {self.left_Nm:.3g} Nm effective, {100 * share:.3g} % of the torque's"
        )
        return lines

    def to_dict(self) -> dict[str, Any]:
        own = {n: (getattr(self, n), unit) for n, (unit, _) in ESTIMATES.items()}
        found = {n: None if e is None else e.to_dict(unit) for n, (e, unit) in own.items()}
        rest = ("left_Nm", "moved_Nm", "runs", "used", "outside")
        return {"friction": found} | {n: getattr(self, n) for n in rest}


ESTIMATES = {
    "load_Nm": ("Nm", "load, one way"),
    "fc_Nm": ("Nm", "Coulomb friction"),
    "fs_Nm": ("Nm", "Stribeck's rise towards rest"),
    "vs_rad_s": ("rad_s", "speed over which it fades"),
    "fv_Nms_rad": ("Nms_rad", "viscous friction"),
}
"""Unit and words of each estimate, by name."""


def read_run(path: Path, full_Nm: float | None) -> SteadyRun:
    """A run from an export of EPOS Studio, or a CSV with columns omega_rad_s and tau_Nm."""
    if _is_epos(path):
        table, omega, tau = _epos(path, full_Nm)
    else:
        table = read_table(path, ("omega_rad_s", "tau_Nm"))
        omega, tau = table.numbers("omega_rad_s"), table.numbers("tau_Nm")
    if len(tau) < 2:
        raise UserError(f"{path}: {len(tau)} samples.", "Record the run again.")
    return SteadyRun(path.name, omega, tau, table.report())


def _is_epos(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return EPOS.encode() in file.read(400)
    except OSError:
        return False  # the reader says why


def _epos(path: Path, full_Nm: float | None) -> tuple[FileTable, Array, Array]:
    if full_Nm is None:
        raise UserError(
            f"{path}: torques are in % of the nominal torque, which is not given.",
            "Give --full-Nm: 0.00984 for the drives of the recordings of T-RO 2021.",
        )
    lines = [line.rstrip(",") for line in LINE_END.split(read_text(path, "Export it again."))]
    heads = [k for k, line in enumerate(lines) if line.startswith("ms;")]
    if not heads or lines[heads[0]].split(";")[1:3] != ["rpm", "%"]:
        raise UserError(
            f"{path}: the channels are not speed in rpm and torque in %.",
            "Export 'Velocity actual value' and 'Torque actual value', in this order.",
        )
    # What somebody wrote behind a row is a comment; a comma before a digit is a decimal mark.
    rows = [COMMENT.split(line, maxsplit=1)[0] for line in lines]
    decimal: Literal[".", ","] = "." if "." in "".join(rows[heads[0] :]) else ","
    form = TableFormat(delimiter=";", decimal=decimal, quote="", header_line=heads[0] + 1)
    table = read_table(path, ("rpm", "%"), form, raw="\n".join(rows).encode())
    behind = [k for k, (line, row) in enumerate(zip(lines, rows, strict=True), 1) if line != row]
    if behind:
        table = table.noting(f"comments behind rows ({numbered('line', behind)})")
    rpm, percent = table.numbers("rpm"), table.numbers("%")
    return table, rpm * (2 * math.pi / 60), percent * (full_Nm / 100)


def _near(x: Array) -> npt.NDArray[np.bool_]:
    middle = np.median(x)
    room = FAR * max(float(np.median(np.abs(x - middle))), 1e-12 + 0.02 * abs(float(middle)))
    return np.asarray(np.abs(x - middle) <= room)


def run_means(runs: Sequence[SteadyRun]) -> tuple[Array, Array, list[npt.NDArray[np.bool_]]]:
    """Speed and torque of each run, and which of its samples they are of."""
    near = [_near(r.omega_rad_s) & _near(r.tau_Nm) for r in runs]
    # The encoder's counts make a slow speed jump; a run is at its mean, and counts once.
    w = np.array([np.mean(r.omega_rad_s[k]) for r, k in zip(runs, near, strict=True)])
    return w, np.array([np.mean(r.tau_Nm[k]) for r, k in zip(runs, near, strict=True)]), near


def fit_friction(runs: Sequence[SteadyRun]) -> Friction:
    """Friction of a drive from its runs at steady speeds, both ways."""
    w, y, near = run_means(runs)
    _enough(w)
    way, size, block = np.sign(w), np.abs(w), np.arange(len(w), dtype=np.float64)
    rest = np.column_stack([np.ones(len(w)), way, w])
    moving = size[size > 0]
    found = fit_separable(
        rest,
        lambda p: y - way * p[1] * np.exp(-size / p[0]),
        np.array([np.median(moving) / 4, 0.1 * np.ptp(y)]),
        np.array([0.5 * moving.min(), -3 * np.ptp(y)]),
        np.array([moving.max() / 2, 3 * np.ptp(y)]),
        block,
    )
    vs, fs, load, fc, fv = found.estimates()
    seen: tuple[Estimate | None, Estimate | None] = (fs, vs)
    if fs.low <= 0 or vs.low <= 0:
        found = fit_linear(rest, y, block)
        seen, (load, fc, fv) = (None, None), found.estimates()
    used = sum(int(k.sum()) for k in near)
    outside = sum(len(k) for k in near) - used
    left = found.rms, float(np.std(y))
    return Friction(load, fc, *seen, fv, *left, len(runs), used, outside)


def _enough(speeds: Array) -> None:
    both = np.any(speeds > 0) and np.any(speeds < 0)
    moving = np.abs(speeds[speeds != 0])
    spread = float(moving.max() / moving.min()) if len(moving) else 0.0
    if len(moving) < LEAST_RUNS or not both or spread < LEAST_SPREAD:
        raise UserError(
            f"{len(moving)} runs that move, {'both ways' if both else 'one way'}, the fastest "
            f"{spread:.3g} times the slowest.",
            f"Give {LEAST_RUNS} or more, both ways, over {LEAST_SPREAD:g} times the slowest speed.",
        )
