"""The map over gains and hands that the pushes make."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from esea_gen.analysis.passivity import Bools, Hand, PassivityMap
from esea_gen.analysis.response import plain
from esea_gen.language.ports import Array
from esea_gen.studies.passivity.push import PushRun

# Share of the push's energy that may come out before it counts.  Of the default map's runs half
# give out less than 0.01 %, nearly all others more than 3 %; docs/stability.md has what it changes.
TOLERANCE = 0.01


@dataclass(frozen=True)
class PushMap(PassivityMap):
    """Energy generated over gains and hands, in runs that a push started."""

    push_J: Array
    stopped: Bools

    @property
    def passive(self) -> Bools:
        """No hand gets more out than the tolerance, and nothing had to stop it; shape (p, d)."""
        quiet = np.all(self.generated_J <= self.tolerance * self.push_J, axis=2)
        return np.asarray(quiet & self.stable)

    @property
    def limits_acted(self) -> Bools:
        """Limits or drive ended the motion with some hand, shape (p, d)."""
        return np.asarray(np.any(self.stopped, axis=2))

    def to_dict(self) -> dict[str, Any]:
        generated = [[[_finite(x) for x in row] for row in page] for page in self.generated_J]
        return super().to_dict() | {
            "generated_J": generated,
            "push_J": plain(self.push_J),
            "limits_acted": plain(self.limits_acted),
        }

    def table(self) -> list[str]:
        lines = [
            "P passive, s stable with every hand, . swings up with one, L limits or drive had to "
            "stop one",
            f"{'Kp | Kd':>10}" + "".join(f"{d:>8.3g}" for d in self.kd_Nms_rad),
        ]
        for i, kp in enumerate(self.kp_Nm_rad):
            marks = "".join(f"{self.mark(i, j):>8}" for j in range(len(self.kd_Nms_rad)))
            lines.append(f"{kp:>10.3g}{marks}")
        return lines

    def mark(self, i: int, j: int) -> str:
        """Letter of a pair of gains."""
        if self.limits_acted[i, j]:
            return "L"
        return "P" if self.passive[i, j] else "s" if self.stable[i, j] else "."


def _finite(x: float) -> float | None:
    return float(x) if math.isfinite(x) else None


def push_map(
    kp_Nm_rad: Sequence[float] | Array,
    kd_Nms_rad: Sequence[float] | Array,
    hands: Sequence[Hand],
    runs: Mapping[tuple[float, float, str], PushRun],
    push_rad_s: float,
    tolerance: float = TOLERANCE,
) -> PushMap:
    """The map from its runs."""
    kp, kd = np.asarray(kp_Nm_rad, dtype=float), np.asarray(kd_Nms_rad, dtype=float)
    energy = np.array([0.5 * h.inertia_kgm2 * push_rad_s**2 for h in hands])
    shape = (len(kp), len(kd), len(hands))
    generated, index = np.zeros(shape), np.zeros(shape)
    diverging, stopped = np.zeros(shape, dtype=np.bool_), np.zeros(shape, dtype=np.bool_)
    for at in np.ndindex(*shape):
        i, j, h = at
        r = runs[float(kp[i]), float(kd[j]), hands[h].name]
        stopped[at] = r.stopped
        diverging[at] = r.stopped or r.swings_up(float(energy[h]))
        generated[at] = math.inf if r.ran_away else r.generated_J
        index[at] = r.generated_J / r.exchanged_J if r.exchanged_J > 0 else 0.0
    return PushMap(kp, kd, tuple(hands), generated, index, diverging, tolerance, energy, stopped)
