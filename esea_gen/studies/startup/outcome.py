"""What a start-up found: tables, JSON, and whether the gains may be used."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from typing import Any

from esea_gen.device import Device
from esea_gen.identify.regression import CONFIDENCE, Estimate
from esea_gen.language.ports import Array
from esea_gen.studies.startup.checks import StartupCheck
from esea_gen.studies.startup.drive_model import UNITS, DriveModel
from esea_gen.studies.startup.margins import LIMITS, MarginCheck
from esea_gen.studies.startup.procedures import PROCEDURES
from esea_gen.studies.startup.sign import SignCheck
from esea_gen.studies.startup.watch import DriveRecording
from esea_gen.studies.startup.waves import Wave

KIND, VERSION = "esea-gen startup", 1
# What each estimate is, and the key of [actuator] that it belongs into.
MEANINGS = {
    "gain": ("motor's torque over its command", ""),
    "fc_Nm": ("Coulomb friction", "fc_Nm"),
    "fv_Nms_rad": ("viscous friction", "fv_Nms_rad"),
    "J_kgm2": ("inertia of motor, drive and motor side", "J_kgm2"),
    "tau_c_s": ("lag of the torque", "tau_c_s"),
    "delay_s": ("delay from command to encoder", ""),
    "cable_loss": ("share of the cable's torque that is lost", ""),
    "cable_give_rad_Nm": ("give of the cable", ""),
    "backlash_rad": ("whole backlash of the cable", ""),
}
FOUND_BY = {
    "gain": "gain",
    "cable_loss": "gain",
    "cable_give_rad_Nm": "gain",
    "backlash_rad": "gain",
    "fc_Nm": "friction",
    "fv_Nms_rad": "friction",
    "joint_ratio": "friction",
    "J_kgm2": "inertia",
    "tau_c_s": "inertia",
    "delay_again_s": "inertia",
    "delay_s": "delay",
}


@dataclass(frozen=True)
class Refusal:
    """Why a start-up ended early.

    procedure: in which one.
    """

    procedure: str
    reason: str
    fix: str


@dataclass(frozen=True)
class Startup:
    """A start-up.

    source: what was started, in words: the virtual exoskeleton with its plant, or a board.
    machine_s: for how long the drive was under command.
    refusal: why it ended early; None when all procedures ran.
    updated: the device with what was found; None when nothing was.
    margins, as_it_stands: of the shipped gains, once in a controller that is built with what was
        found, once in the controller of the device file as it is.
    law_problem: why nothing good is said of the law on the updated device, and the fix; None when
        there is no such reason.
    truth: of a simulated plant, by estimate; empty on a board.
    true_map_Nm: of a simulated plant, at the map's angles.
    recordings: by procedure, as far as they went.
    """

    device: Device
    source: str
    machine_s: float
    sign: SignCheck | None
    refusal: Refusal | None
    model: DriveModel | None = None
    waves: tuple[Wave, ...] = ()
    checks: tuple[StartupCheck, ...] = ()
    updated: Device | None = None
    margins: MarginCheck | None = None
    as_it_stands: MarginCheck | None = None
    law_problem: tuple[str, str] | None = None
    truth: Mapping[str, float] = field(default_factory=dict)
    true_map_Nm: Array | None = None
    recordings: Mapping[str, DriveRecording] = field(default_factory=dict, repr=False)

    # -- verdict ---------------------------------------------------------------------------------

    @property
    def reasons(self) -> list[tuple[str, str]]:
        """What speaks against the shipped gains, each with its fix."""
        out = []
        if self.refusal is not None:
            out.append((f"{self.refusal.procedure}: {self.refusal.reason}", self.refusal.fix))
        out += [(f"{c.procedure}: {c.line()}", c.fix) for c in self.checks if not c.passed]
        if self.law_problem is not None:
            out.append(self.law_problem)
        if self.margins is not None:
            out += [(p, self.margins.fix()) for p in self.margins.problems()]
        return out

    @property
    def gains_may_be_used(self) -> bool:
        """Whether every procedure passed and every margin is there."""
        return self.margins is not None and not self.reasons

    def passed(self, procedure: str) -> bool | None:
        """Whether a procedure's result is within all of its limits; None where it never ran."""
        names = [p.name for p in PROCEDURES]
        if self.refusal is not None:
            at = names.index(self.refusal.procedure)
            if names.index(procedure) >= at:
                return False if self.refusal.procedure == procedure else None
        return all(c.passed for c in self.checks if c.procedure == procedure)

    # -- shown -----------------------------------------------------------------------------------

    def table(self) -> list[str]:
        """The start-up as lines of text."""
        lines = [
            f"Start-up of {self.device.name} ({self.device.title})",
            f"{self.source}; {self.machine_s:.0f} s of motion",
        ]
        for k, p in enumerate(PROCEDURES, 1):
            word = {True: "passed", False: "FAILED", None: "not run"}[self.passed(p.name)]
            lines.append(f"{k}. {p.title:18} {word:8} {self._said(p.name)}")
        if self.model is not None:
            lines += self._estimates(self.model)
            lines += self._disturbance(self.model)
        if self.margins is not None:
            lines += _margin_lines(self.margins)
        lines.append(self.verdict())
        lines += self._firmware()
        told = [*self.reasons, ("", "")]
        for (reason, fix), (_, later) in pairwise(told):
            lines.append(f"  {reason}")
            if fix != later:
                lines.append(f"    Fix: {fix}")
        return lines

    def verdict(self) -> str:
        """One line: whether the shipped gains may be used."""
        word = "may be used" if self.gains_may_be_used else "may NOT be used"
        return f"Verdict: the gains of {self.device.name} {word} with what was found."

    def _firmware(self) -> list[str]:
        # Of what was built before: its observer and law believe in the old numbers.
        if self.as_it_stands is None:
            return []
        short = self.as_it_stands.problems()
        name = self.device.name
        if not short:
            return [f"Firmware that was built from {name} as it is has its margins as well."]
        return [f"Firmware that was built from {name} as it is must NOT run here: {short[0]}."]

    def _said(self, procedure: str) -> str:
        if self.refusal is not None and self.refusal.procedure == procedure:
            return self.refusal.reason
        if self.passed(procedure) is None:
            return ""
        own = [c for c in self.checks if c.procedure == procedure]
        failed = [c.line() for c in own if not c.passed]
        if failed:
            return "; ".join(failed)
        if procedure == "sign":
            return "command, motor's encoder and joint encoders count the same way"
        if self.model is None:
            return "recorded"
        return f"{len(own)} of {len(own)} values within their limits"

    def _estimates(self, m: DriveModel) -> list[str]:
        percent = f"{100 * CONFIDENCE:.0f} %"
        lines = [
            f"{'found':42}{'value':>11}{f'{percent} interval':>26}  {'device file':>11}"
            + (f"{'simulated':>11}" if self.truth else "")
        ]
        for name, (text, key) in MEANINGS.items():
            e: Estimate = getattr(m, name)
            scale, unit = (1e3, "ms") if name in ("tau_c_s", "delay_s") else (1.0, UNITS[name])
            unit = {"1": "", "rad_Nm": "rad/Nm", "Nms_rad": "Nms/rad"}.get(unit, unit)
            shown = "-"
            if key:
                shown = f"{scale * getattr(self.device.file.actuator, key).value:.4g}"
            ends = f"{scale * e.low:.4g} to {scale * e.high:.4g}"
            line = f"{f'{text}, {unit}' if unit else text:42}{scale * e.value:>11.4g}{ends:>26}"
            line += f"  {shown:>11}"
            if self.truth:
                line += f"{scale * self.truth[name]:>11.4g}" if name in self.truth else f"{'-':>11}"
            lines.append(line)
        return lines

    def _disturbance(self, m: DriveModel) -> list[str]:
        d, jump = m.disturbance, m.jump
        shown = [f"{w.amplitude_Nm:.3g} Nm at {w.wave_1_rad:.3g}/rad" for w in self.waves]
        strongest = f"; strongest: {', '.join(shown)}" if shown else ""
        return [
            f"reaction in the counts, mean of {jump.jumps} jumps: begins in the tick at "
            f"{1e3 * jump.bend_s:.0f} ms",
            f"gear's disturbance: {d.rms_Nm:.3g} Nm effective, {d.peak_Nm:.3g} Nm at most, from "
            f"{d.gear_rad[0]:.2f} to {d.gear_rad[-1]:.2f} rad{strongest}",
        ]

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content; the simulated truth under a key of its own."""
        m = self.model
        content: dict[str, Any] = {
            "kind": KIND,
            "version": VERSION,
            "device": self.device.name,
            "device_digest": self.device.digest,
            "source": self.source,
            "simulated": bool(self.truth),
            "motion_s": self.machine_s,
            "confidence_pct": 100 * CONFIDENCE,
            "gains_may_be_used": self.gains_may_be_used,
            "reasons": [{"reason": r, "fix": f} for r, f in self.reasons],
            "procedures": [
                {
                    "name": p.name,
                    "title": p.title,
                    "output": p.output,
                    "finds": p.finds,
                    "passed": self.passed(p.name),
                    "checks": [c.to_dict() for c in self.checks if c.procedure == p.name],
                }
                for p in PROCEDURES
            ],
            "refusal": None if self.refusal is None else asdict(self.refusal),
            "sign": None if self.sign is None else self.sign.to_dict(),
            "estimates": {},
            "reaction": None,
            "disturbance": None,
            "margins": None if self.margins is None else self.margins.to_dict(),
            "margins_of_firmware_as_it_is": None
            if self.as_it_stands is None
            else self.as_it_stands.to_dict(),
            "law_problem": None if self.law_problem is None else self.law_problem[0],
        }
        if m is not None:
            content["estimates"] = {
                k: getattr(m, k).to_dict(unit) | {"procedure": FOUND_BY[k]}
                for k, unit in UNITS.items()
            }
            content["reaction"] = {
                "jumps": m.jump.jumps,
                "bend_s": m.jump.bend_s,
                "time_s": m.jump.time_s.tolist(),
                "seen_rad_s2": m.jump.seen_rad_s2.tolist(),
                "model_rad_s2": m.jump.model_rad_s2.tolist(),
            }
            d = m.disturbance
            content["disturbance"] = {
                "rms_Nm": d.rms_Nm,
                "peak_Nm": d.peak_Nm,
                "gear_rad": d.gear_rad.tolist(),
                "torque_Nm": d.torque_Nm.tolist(),
                "half_interval_Nm": d.half_Nm.tolist(),
                "waves": [asdict(w) for w in self.waves],
            }
        if self.truth:
            truth: dict[str, Any] = dict(self.truth)
            if self.true_map_Nm is not None:
                truth["disturbance_Nm"] = self.true_map_Nm.tolist()
            content["simulated_truth"] = truth
        return content


def _margin_lines(check: MarginCheck) -> list[str]:
    at = check.middle.margins
    lines = [f"{'margins of the torque loop':42}{'found':>11}{'worst corner':>26}  {'least':>11}"]
    for x in LIMITS:
        value, scale = getattr(at, x.key), 1e3 if x.unit == "s" else 1.0
        unit = "ms" if x.unit == "s" else x.unit
        found = "-" if value is None else f"{scale * value:.3g}"
        worst = check.worst[x.key]
        end = "-" if math.isinf(worst) else f"{scale * worst:.3g}"
        lines.append(f"{f'{x.name}, {unit}':42}{found:>11}{end:>26}  {scale * x.least:>11.3g}")
    return lines


__all__ = ["MEANINGS", "Refusal", "Startup"]
