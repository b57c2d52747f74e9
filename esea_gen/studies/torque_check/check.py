"""Check of the torque sensor with a hanging mass: a guided procedure, its limits and its verdict.

A known mass on a known arm gives a known torque.  The procedure goes through unloaded and loaded
phases in both directions, several times; each phase is left to settle, then recorded.  The limits
for the recordings, in % of full scale or of the load, and their reasons are in
:data:`esea_gen.studies.torque_check.procedure.LIMITS`.

The known load has an uncertainty of its own (mass, arm, angle, gravity: first order, [1]_), and the
sensor must be inside the limit *less* that uncertainty to pass (guarded acceptance, [2]_).  Between
that and the limit itself, and with a small load, the check cannot judge.

References
----------
.. [1] JCGM 100:2008, "Guide to the expression of uncertainty in measurement", 5.1.2.
.. [2] JCGM 106:2012, "The role of measurement uncertainty in conformity assessment", 8.3.2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError
from esea_gen.files import plain
from esea_gen.studies.torque_check.procedure import (
    LIMITS,
    REPEATS,
    SMALLEST_LOAD_PCT,
    Kind,
    KnownLoad,
    ProcedureStep,
    judged_from_Nm,
    load_range_Nm,
    procedure,
    require,
    stiffening,
)
from esea_gen.tables import MARK

if TYPE_CHECKING:
    from esea_gen.devices.file import DeviceData

KIND = "esea-gen torque check"
VERSION = 1
SETTLE_S, RECORD_S = 5.0, 10.0
COVERAGE = 2.0  # about 95 %
MOST_GAP_S = 0.1
FEWEST_SAMPLES = 50
# The known load may take up at most this share of the accuracy limit.
MOST_UNCERTAIN_SHARE = 0.5

Verdict = Literal["pass", "fail", "cannot judge", "incomplete"]


@dataclass(frozen=True)
class Measurement:
    label: str
    mean_Nm: float
    drift_Nm: float  # change along the straight line
    noise_Nm: float  # standard deviation about it
    samples: int
    start_s: float
    source: str


@dataclass(frozen=True)
class CheckDecision:
    criterion: str
    steps: tuple[str, ...]
    value_Nm: float
    limit_Nm: float  # uncertainty taken off
    uncertainty_Nm: float = 0.0  # expanded

    @property
    def passed(self) -> bool:
        """Whether the value is within the limit; NaN is not."""
        return self.value_Nm <= self.limit_Nm

    @property
    def failed(self) -> bool:
        """Whether the value is beyond the limit itself; NaN is."""
        return not self.value_Nm <= self.limit_Nm + self.uncertainty_Nm


class TorqueCheck:
    def __init__(
        self,
        device: DeviceData,
        known: KnownLoad,
        *,
        repeats: int = REPEATS,
        settle_s: float = SETTLE_S,
        record_s: float = RECORD_S,
    ) -> None:
        self.device, self.known, self.repeats = device, known, repeats
        self.steps = procedure(repeats)
        hint = "Give another time."
        require("the settling time", settle_s, 0.5, 600.0, "s", hint)
        require("the recorded time", record_s, 1.0, 600.0, "s", hint)
        self.settle_s, self.record_s = settle_s, record_s
        self.measurements: list[Measurement] = []
        self._check_load()
        self._stiffening = stiffening(device, known.torque_Nm)

    def _check_load(self) -> None:
        torque, mass_kg = self.known.torque_Nm, self.known.mass_kg
        low, high = load_range_Nm(self.device)
        g_per_Nm = 1000 * mass_kg / torque
        given = f"{mass_kg:g} kg at {self.known.arm_m:g} m is {torque:.3g} Nm"
        if torque > high:
            raise UserError(
                f"{given}, above {high:.3g} Nm, the largest still load inside the identified "
                f"domain of {self.device.name}.",
                f"Hang at most {math.floor(high * g_per_Nm) / 1000:g} kg there, or shorten the "
                "arm.",
            )
        if torque < low:
            enough = min(high, max(low, judged_from_Nm(self.device)))
            raise UserError(
                f"{given}, below {low:.3g} Nm, {SMALLEST_LOAD_PCT:g} % of full scale: too small "
                "for a verdict.",
                f"Hang at least {math.ceil(enough * g_per_Nm) / 1000:g} kg there, or lengthen "
                "the arm.",
            )
        expanded, most = COVERAGE * self.known.u_torque_Nm, MOST_UNCERTAIN_SHARE
        room = most * self.limit_Nm("accuracy")
        if expanded > room:
            budget = self.known.budget_Nm
            worst = max(budget, key=lambda k: budget[k])
            raise UserError(
                f"the load is known to {expanded:.3g} Nm only (95 %), above {room:.3g} Nm, "
                f"{100 * most:g} % of the accuracy limit.",
                f"Measure the {worst.partition(',')[0]} better; it has the largest part.",
            )

    def limit_Nm(self, name: str, kind: Kind = "plus") -> float:
        """A limit in Nm, for the known load or an unloaded phase."""
        limit = next(x for x in LIMITS if x.name == name)
        load_Nm = 0.0 if kind == "zero" else self.known.torque_Nm
        return limit.torque_Nm(self.device.tau_full_scale_Nm, load_Nm)

    # -- going through it ------------------------------------------------------------------------

    @property
    def next_step(self) -> ProcedureStep | None:
        """Next step; None when all phases are recorded."""
        done = len(self.measurements)
        return self.steps[done] if done < len(self.steps) else None

    @property
    def missing(self) -> tuple[ProcedureStep, ...]:
        return self.steps[len(self.measurements) :]

    def record(
        self, label: str, time_s: npt.ArrayLike, tau_Nm: npt.ArrayLike, source: str = ""
    ) -> Measurement:
        """Take the next phase; the settling time at its start is left out."""
        # In the order of the procedure: rubber remembers.
        expected = self.next_step
        if expected is None or label != expected.label:
            come = f"the next one is {expected.label}" if expected else "all steps are recorded"
            raise UserError(
                f"step {label} cannot be recorded now: {come}.",
                "Keep to the order; undo() takes the last one back.",
            )
        measured = self._measure(
            label, np.asarray(time_s, float), np.asarray(tau_Nm, float), source
        )
        self.measurements.append(measured)
        return measured

    def undo(self) -> None:
        if self.measurements:
            self.measurements.pop()

    def _measure(
        self, label: str, t: npt.NDArray[np.float64], tau: npt.NDArray[np.float64], source: str
    ) -> Measurement:
        again = f"Record {label} again."
        if t.ndim != 1 or t.shape != tau.shape:
            raise UserError(f"step {label}: times and torques differ in number.", again)
        for name, values in (("time", t), ("torque", tau)):
            bad = np.flatnonzero(~np.isfinite(values))
            if len(bad):
                raise UserError(
                    f"step {label}: {name} of sample {bad[0]} (from 0) is {values[bad[0]]}.", again
                )
        back = np.flatnonzero(np.diff(t) <= 0)
        if len(back):
            raise UserError(
                f"step {label}: the time does not rise from {t[back[0]]:g} s to "
                f"{t[back[0] + 1]:g} s.",
                again,
            )
        needed = self.settle_s + self.record_s
        span = float(t[-1] - t[0]) if len(t) else 0.0
        period = span / (len(t) - 1) if len(t) > 1 else 0.0
        if span + 1.5 * period < needed:
            raise UserError(
                f"step {label}: {span:.3g} s recorded, below {needed:g} s ({self.settle_s:g} s to "
                f"settle, {self.record_s:g} s to judge).",
                again,
            )
        inside = (t >= t[0] + self.settle_s) & (t < t[0] + needed)
        t, tau = t[inside], tau[inside]
        gap = float(np.max(np.diff(t), initial=0.0))
        if gap > MOST_GAP_S or len(t) < FEWEST_SAMPLES:
            raise UserError(
                f"step {label}: {len(t)} samples with a gap of up to {gap:.3g} s after settling; "
                f"at least {FEWEST_SAMPLES} samples and at most {MOST_GAP_S:g} s are needed.",
                again,
            )
        middle = t - np.mean(t)
        slope = float(middle @ tau / (middle @ middle))
        mean, drift = float(np.mean(tau)), slope * self.record_s
        noise = float(np.sqrt(np.sum((tau - mean - slope * middle) ** 2) / (len(t) - 2)))
        return Measurement(label, mean, drift, noise, len(t), float(t[0]), source)

    # -- judging ---------------------------------------------------------------------------------

    @property
    def readings(self) -> tuple[tuple[tuple[str, str, str], float], ...]:
        """Loads with both unloaded phases beside them: labels, and the error in Nm.

        The error is positive where the sensor reads too much in the direction of the load.  An
        offset, the mean of the unloaded phases, makes more torque where the rubber is stiffer.
        """
        out, zeros = [], [m.mean_Nm for m in self.measurements[::2]]
        grown_Nm = (self._stiffening - 1) * float(np.mean(zeros))
        for i in range(1, len(self.measurements) - 1, 2):
            before, load, after = self.measurements[i - 1 : i + 2]
            sign = 1 if self.steps[i].kind == "plus" else -1
            unloaded_Nm = 0.5 * (before.mean_Nm + after.mean_Nm)
            torque = sign * (load.mean_Nm - unloaded_Nm - grown_Nm)
            labels = (before.label, load.label, after.label)
            out.append((labels, torque - self.known.torque_Nm))
        return tuple(out)

    @property
    def decisions(self) -> tuple[CheckDecision, ...]:
        """Every comparison that the recorded phases allow."""
        limit = self.limit_Nm
        out = []
        for m, step in zip(self.measurements, self.steps, strict=False):
            if step.kind == "zero":
                out.append(CheckDecision("zero", (m.label,), abs(m.mean_Nm), limit("zero")))
            drift = limit("drift", step.kind)
            out.append(CheckDecision("drift", (m.label,), abs(m.drift_Nm), drift))
            out.append(CheckDecision("noise", (m.label,), m.noise_Nm, limit("noise")))
        found = {m.label: m.mean_Nm for m in self.measurements}
        errors: dict[str, list[float]] = {"plus": [], "minus": []}
        expanded = COVERAGE * self.known.u_torque_Nm
        for labels, error in self.readings:
            before, load, after = labels
            moved = abs(found[after] - found[before])
            out.append(CheckDecision("zero return", (before, after), moved, limit("zero return")))
            room = limit("accuracy") - expanded
            out.append(CheckDecision("accuracy", labels, abs(error), room, expanded))
            errors[load.partition("_")[0]].append(error)
        for kind, values in errors.items():
            if len(values) == self.repeats:
                labels_of = tuple(s.label for s in self.steps if s.kind == kind)
                spread = max(values) - min(values)
                out.append(
                    CheckDecision("repeatability", labels_of, spread, limit("repeatability"))
                )
        if all(len(v) == self.repeats for v in errors.values()):
            skew = abs(float(np.mean(errors["plus"])) - float(np.mean(errors["minus"])))
            out.append(CheckDecision("symmetry", ("plus", "minus"), skew, limit("symmetry")))
        return tuple(out)

    @property
    def verdict(self) -> Verdict:
        """``fail`` as soon as a limit is exceeded, ``incomplete`` while phases are missing."""
        if any(d.failed for d in self.decisions):
            return "fail"
        if self.missing:
            return "incomplete"
        return "cannot judge" if self.doubt else "pass"

    @property
    def doubt(self) -> tuple[str, str] | None:
        """Reason why the check neither fails nor passes, and the remedy."""
        known, least = self.known, judged_from_Nm(self.device)
        open_ones = [d for d in self.decisions if not d.passed and not d.failed]
        if open_ones:
            d = max(open_ones, key=lambda d: d.value_Nm)
            budget = known.budget_Nm
            worst = max(budget, key=lambda k: budget[k]).partition(",")[0]
            return (
                f"An error of {d.value_Nm:.3g} Nm is within the limit of "
                f"{d.limit_Nm + d.uncertainty_Nm:.3g} Nm, but not by the {d.uncertainty_Nm:.2g} Nm "
                "that the load is uncertain by.",
                f"Measure the {worst} better; it has the largest part.",
            )
        if known.torque_Nm < least:
            share = 100 * known.torque_Nm / self.device.tau_full_scale_Nm
            mass_kg = math.ceil(1000 * least * known.mass_kg / known.torque_Nm) / 1000
            return (
                f"Nothing is wrong up to {known.torque_Nm:.3g} Nm, but that is {share:.0f} % of "
                f"full scale: it shows nothing about larger torques, and a sensor passes from "
                f"{least:.3g} Nm on.",
                f"Hang at least {mass_kg:g} kg there.",
            )
        return None

    @property
    def suspects(self) -> tuple[str, str] | None:
        """Possible causes of a gain error, and the experiment that separates them."""
        errors = [error for _, error in self.readings]
        room = self.limit_Nm("accuracy") - COVERAGE * self.known.u_torque_Nm
        signs = {s.kind for s in self.steps[1 : 2 * len(errors) : 2]}
        if len(signs) < 2 or not (min(errors) > room or max(errors) < -room):
            return None
        gain = 1 + float(np.mean(errors)) / self.known.torque_Nm
        if gain <= 0:
            return (
                f"In both directions the sensor shows {gain:.3f} of the load: its sign is wrong.",
                "If the mass turned the joint as stated, correct the encoders' directions.",
            )
        rubber = "softer" if gain > 1 else "stiffer"
        load = "heavier or further out" if gain > 1 else "lighter or nearer"
        return (
            f"In both directions the sensor shows {gain:.3f} of the load. Either the rubber is "
            f"{rubber} than its model (about {1 / gain:.2f} times as stiff), or the load is "
            f"{load} than stated. The motor is held and plays no part.",
            "Weigh the mass, measure the arm, and repeat with another mass: if the rubber is the "
            "cause, the share stays. Then identify the rubber again (esea-gen identify), or adapt "
            "to it (esea-host commission, step adaptation). Leave the motor's torque constant as "
            "it is: from the motor's side, a wrong rubber and a wrong constant look alike.",
        )

    @property
    def simulated(self) -> bool:
        return any(m.source.endswith(MARK) for m in self.measurements)

    # -- keeping it ------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content: result, and all that :meth:`resumed` needs."""
        own = ("verdict", "repeats", "settle_s", "record_s", "measurements", "simulated")
        content: dict[str, Any] = plain(
            {
                "kind": KIND,
                "version": VERSION,
                "device": self.device.name,
                "device_digest": self.device.digest,
                "full_scale_Nm": self.device.tau_full_scale_Nm,
                "known_load": self.known,
                "known_torque_Nm": self.known.torque_Nm,
                "known_budget_Nm": self.known.budget_Nm,
                "known_expanded_Nm": COVERAGE * self.known.u_torque_Nm,
                "limits": [vars(x) | {"limit_Nm": self.limit_Nm(x.name)} for x in LIMITS],
                "missing": [s.label for s in self.missing],
                "decisions": [vars(d) | {"passed": d.passed} for d in self.decisions],
                **{k: getattr(self, k) for k in own},
            }
        )
        return content

    @classmethod
    def resumed(cls, device: DeviceData, content: Mapping[str, Any]) -> TorqueCheck:
        """A check as :meth:`to_dict` left it; its decisions are made again."""
        fresh = "Start a new check."
        if not isinstance(content, Mapping) or content.get("kind") != KIND:
            raise UserError("this is not the result of a torque check.", "Give its JSON file.")
        if content.get("version") != VERSION:
            raise UserError(
                f"the check has version {content.get('version')!r}, not {VERSION}.", fresh
            )
        if content.get("device_digest") != device.digest:
            raise UserError(
                f"the check was begun with another device, or {device.name}'s file has changed "
                "since.",
                fresh,
            )
        try:
            known = KnownLoad(**content["known_load"])
            check = cls(
                device,
                known,
                repeats=content["repeats"],
                settle_s=content["settle_s"],
                record_s=content["record_s"],
            )
            found = [Measurement(**m) for m in content["measurements"]]
            numbers = [getattr(m, f.name) for m in found for f in fields(m) if f.type == "float"]
            sound = all(math.isfinite(x) for x in numbers)
        except (KeyError, TypeError) as error:
            raise UserError(f"the check's content is damaged ({error}).", fresh) from None
        labels = [s.label for s in check.steps[: len(found)]]
        if not sound or [m.label for m in found] != labels:
            raise UserError("the check's recorded steps are damaged or out of order.", fresh)
        check.measurements = found
        return check

    def report(self) -> list[str]:
        r, full = self.known, self.device.tau_full_scale_Nm
        angle = f", {math.degrees(r.angle_rad):g} deg off the horizontal" if r.angle_rad else ""
        lines = [
            f"Torque check of {self.device.name} ({self.device.title}), full scale {full:g} Nm",
            f"Known load: {r.mass_kg:g} kg at {r.arm_m:g} m{angle} = {r.torque_Nm:.4g} Nm, "
            f"known to {COVERAGE * r.u_torque_Nm:.2g} Nm (95 %)",
        ]
        if self.measurements:
            lines.append(
                f"{'step':10}{'mean Nm':>12}{'drift Nm':>12}{'noise Nm':>12}{'samples':>9}"
            )
        for m in self.measurements:
            lines.append(
                f"{m.label:10}{m.mean_Nm:12.4f}{m.drift_Nm:12.4f}{m.noise_Nm:12.4f}{m.samples:9d}"
            )
        decisions = self.decisions
        for limit in LIMITS:
            found = [d for d in decisions if d.criterion == limit.name]
            if not found:
                continue
            # The one that comes nearest to its limit, or exceeds it most.
            worst = max(found, key=lambda d: d.value_Nm - d.limit_Nm)
            word = "passed" if all(d.passed for d in found) else "cannot judge"
            word = "FAILED" if any(d.failed for d in found) else word
            less = f" less {worst.uncertainty_Nm:.2g} Nm" if worst.uncertainty_Nm else ""
            share = f", {100 * worst.value_Nm / r.torque_Nm:.1f} % of the load"
            lines.append(
                f"{limit.name:14}{word}: {worst.value_Nm:.4f} Nm"
                f"{share if limit.load_percent else ''}, limit {worst.limit_Nm:.4f} Nm "
                f"({limit.shares}{less}), at {', '.join(worst.steps)}; "
                f"{len(found)} compared"
            )
            lines += [
                f"{'':14}  {', '.join(d.steps)}: {d.value_Nm:.4f} Nm"
                for d in found
                if not d.passed and d is not worst
            ]
        if self.missing:
            lines.append(f"Missing: {', '.join(s.label for s in self.missing)}")
            lines.append(f"Next, {self.missing[0].label}: {self.missing[0].text}")
        for said in (self.suspects, self.doubt if self.verdict == "cannot judge" else None):
            lines += [said[0], f"To do: {said[1]}"] if said else []
        lines.append(f"Verdict: {self.verdict.upper()}{MARK * self.simulated}")
        return lines


def instructions(device: DeviceData, check: TorqueCheck | None = None) -> list[str]:
    """The procedure and its limits as lines of text; ``check`` once the load is known."""
    low, high = load_range_Nm(device)
    full = device.tau_full_scale_Nm
    settle, record = (check.settle_s, check.record_s) if check else (SETTLE_S, RECORD_S)
    lines = [f"Torque check of {device.name} ({device.title}), full scale {full:g} Nm"]
    if check is None:
        lines.append(
            f"Choose a mass and an arm that give {low:.3g} to {high:.3g} Nm: at 0.2 m "
            f"{math.ceil(1000 * low / 9.81 / 0.2) / 1000:g} to "
            f"{math.floor(1000 * high / 9.81 / 0.2) / 1000:g} kg.  A sensor passes from "
            f"{judged_from_Nm(device):.3g} Nm on; below, it can only fail."
        )
    else:
        r = check.known
        lines.append(
            f"Known load: {r.torque_Nm:.4g} Nm, known to {COVERAGE * r.u_torque_Nm:.2g} Nm (95 %)"
        )
        if r.torque_Nm < judged_from_Nm(device):
            lines.append(
                f"A sensor passes from {judged_from_Nm(device):.3g} Nm on; with this load it can "
                "only fail."
            )
    lines.append(
        f"Hold the motor still.  Each step: do it, wait {settle:g} s, record {record:g} s, both in "
        "one recording."
    )
    steps = check.steps if check else procedure()
    lines += [f"{i:3d}. {s.label:9}{s.text}" for i, s in enumerate(steps, 1)]
    lines.append("Limits:")
    lines += [
        f"  {x.name}: {x.shares}, at full scale {x.torque_Nm(full, full):.3g} Nm; {x.what}.  "
        f"Why: {x.reason}."
        for x in LIMITS
    ]
    return lines
