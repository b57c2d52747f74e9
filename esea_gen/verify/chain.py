"""Sensing task in one format against f64: rate and torque together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_device
from esea_gen.language.ports import Array
from esea_gen.twin.trajectories import reaches

REACHES = 4
LONGEST_S, SHORTEST_S = 1.5, 0.05
# Aims: the whole task's torque within these shares of full scale of f64's over a motion.
AIM_RMS_SHARE, AIM_SHARE = 0.0002, 0.0005  # RMS, and the largest difference
DRAWN_SHARE = 0.5  # of the trials; the others change the worst found so far
CHANGE = 0.15


@dataclass(frozen=True)
class ChainError:
    """Motion with the largest error in one format."""

    real: str
    error_Nm: float
    rms_Nm: float
    ends_rad: tuple[float, ...]
    lasting_s: tuple[float, ...]
    bits: int


@dataclass(frozen=True)
class ChainReport:
    device: str
    full_scale_Nm: float
    trials: int
    errors: tuple[ChainError, ...]

    @property
    def passed(self) -> bool:
        """Whether every format stays within both aims on its worst motion."""
        full = self.full_scale_Nm
        return all(
            e.rms_Nm <= AIM_RMS_SHARE * full and e.error_Nm <= AIM_SHARE * full for e in self.errors
        )

    def table(self) -> list[str]:
        lines = [
            f"sensing task against f64, worst of {self.trials} searched motions (reach and rest); "
            f"searched, not proven; "
            f"aims {100 * AIM_SHARE:g} %, RMS {100 * AIM_RMS_SHARE:g} %"
        ]
        for e in self.errors:
            shares = [100 * x / self.full_scale_Nm for x in (e.error_Nm, e.rms_Nm)]
            lines.append(
                f"{e.real:4} {e.error_Nm:9.2g} Nm, {shares[0]:.2g} % of full scale; RMS "
                f"{shares[1]:.2g} %; encoders {f'{e.bits} bit' if e.bits else 'ideal'}"
            )
        return lines


def search_chain(
    device: Device,
    formats: Sequence[str] = ("f32", "q31"),
    trials: int = 60,
    seed: int = 0,
    say: Callable[[str], None] | None = None,
) -> ChainReport:
    """Search for the motion on which the whole sensing task is farthest from f64."""
    if device.file.joint is not None:
        raise UserError(
            f"{device.origin}: the search needs a measuring device; this one reads counts.",
            "Give the device that it extends, as elbow for elbow_drive: the Blocks are the same.",
        )
    task = device.system.tasks[0]
    names = [x.name for x in device.system.task_inputs(task)]
    exact = compile_device(device, "f64").task(task.name)
    bits = int(device.file.encoder.resolution_bits.value)
    most = device.file.domain.theta_max_rad.value
    found = []
    for real in formats:
        if say is not None:
            say(f"search, {real}")
        runner = compile_device(device, real).task(task.name)

        def tried(ends: Array, lasting: Array, bits: int, runner: Any = runner) -> Array:
            theta = reaches(ends, lasting, device.period_s)
            if bits:
                count = 2 * np.pi / 2**bits
                theta = np.round(theta / count) * count
            # Numbers that the format of a board can be given.
            inputs = dict.fromkeys(names, np.float32(theta).astype(float))
            for x in (runner, exact):
                x.reset()
            got, true = (x.run(inputs, trace=False)[0] for x in (runner, exact))
            taus = [n for n in true if n.startswith("tau_")]
            apart = [np.abs(np.asarray(got[n], float) - true[n]) for n in taus]
            return np.asarray(np.max(apart, axis=0))

        found.append(_worst(real, tried, most, bits, trials, np.random.default_rng(seed)))
    return ChainReport(device.name, device.tau_full_scale_Nm, trials, tuple(found))


def _worst(
    real: str,
    tried: Callable[[Array, Array, int], Array],
    most: float,
    bits: int,
    trials: int,
    rng: np.random.Generator,
) -> ChainError:
    best = ChainError(real, -1.0, 0.0, (), (), 0)
    low, high = np.log(SHORTEST_S), np.log(LONGEST_S)
    for k in range(trials):
        if k < max(1, round(DRAWN_SHARE * trials)):
            ends = rng.uniform(-most, most, REACHES)
            lasting = np.exp(rng.uniform(low, high, REACHES))
            counts = bits * (k % 2)
        else:
            ends = np.array(best.ends_rad) + rng.normal(0, CHANGE * most, REACHES)
            ends = np.clip(ends, -most, most)
            lasting = np.array(best.lasting_s) * np.exp(rng.normal(0, CHANGE, REACHES))
            lasting = np.clip(lasting, SHORTEST_S, LONGEST_S)
            counts = best.bits
        error = tried(ends, lasting, counts)
        if error.max() > best.error_Nm:
            rms = float(np.sqrt(np.mean(error**2)))
            shape = tuple(map(float, ends)), tuple(map(float, lasting))
            best = ChainError(real, float(error.max()), rms, *shape, counts)
    return best
