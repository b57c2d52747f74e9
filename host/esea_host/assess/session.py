"""One assessment: readings in, probabilities out; the clinician can overrule every step.

The audit trail lists everything that changed a probability, in order, with its effect.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import pairwise
from typing import Any

import numpy as np

from esea_gen.errors import UserError
from esea_host.assess.database import ResponseDataBase
from esea_host.assess.hypotheses import (
    NONE,
    Evidence,
    Hypotheses,
    between_severities,
    disorder_of,
    mixtures,
    none_of_these,
    normalised,
    summarised,
)
from esea_host.assess.patients import Array
from esea_host.assess.responses import Location, MovementReadings, Passage, along

NONE_PRIOR = 0.05
MIXTURES_PRIOR = 0.2  # where mixtures are asked for
SETTLED, SETTLED_STEPS = 0.02, 3
# Words of resistance against the movement, as the hands feel it: Nm for a leg of mean size.
# Ours; a word is as good as half the way to its neighbours.
WORDS = {
    "helps": (-6.0, 3.0),
    "none": (0.0, 1.5),
    "slight": (4.0, 2.0),
    "clear": (9.0, 2.5),
    "strong": (15.0, 3.0),
    "very strong": (22.0, 4.0),
}
UNCALIBRATED = {
    "own_Nm": 0.5,
    "share": 0.06,
    "people_scale": 1.0,
    "noise_Nm": 0.5,
    "none_log_odds": 0.0,
}


@dataclass(frozen=True)
class AuditEntry:
    """One step: action, reason, and the probabilities after it."""

    number: int
    time: str
    what: str
    details: Mapping[str, Any]
    probabilities: Mapping[str, float]
    digest: str


def utc_now() -> str:
    """Time of a step, to the second."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def assessed_hypotheses(
    data: ResponseDataBase, kind: str = "people", mixed: bool = False
) -> Hypotheses:
    """Diagnoses of a database, its reference, mixtures if asked for, and "none of these"."""
    fit = {**UNCALIBRATED, **(data.calibration or {})}
    everything = summarised(data, kind)
    if kind == "people":
        everything = everything.with_movement_noise(fit)
    # Someone without a disorder is no mild case: the reference is a hypothesis of its own.
    chosen = everything.only(data.diagnoses + ((data.reference,) if data.reference else ()))
    if mixed:
        if data.reference is None:
            raise UserError(
                "database: mixtures need people without a disorder.", "Build it with a reference."
            )
        pairs = mixtures(everything, data.reference)
        if pairs.names:
            chosen = chosen.joined(pairs)
    return chosen.joined(none_of_these(everything.only(data.diagnoses)))


@dataclass(frozen=True)
class _Before:
    """State that an undone step restores."""

    what: str
    log_prior: Array
    read: bool
    left_out: Location | None
    shown: int


class Assessment:
    """Probabilities of the categories of a database, after each movement."""

    def __init__(
        self,
        data: ResponseDataBase,
        kind: str = "people",
        mixed: bool = False,
        prior: Mapping[str, float] | None = None,
        hypotheses: Hypotheses | None = None,
        clock: Callable[[], str] = utc_now,
    ) -> None:
        self.data, self._clock = data, clock
        self.hypotheses = hypotheses or assessed_hypotheses(data, kind, mixed)
        self.names = self.hypotheses.names
        self.evidence = Evidence(self.hypotheses)
        fit = {**UNCALIBRATED, **(data.calibration or {})}
        self._log_prior = np.log(self._equal())
        self._log_prior[-1] += fit["none_log_odds"]
        self._undo: list[_Before] = []
        self._shown: list[Array] = []  # probabilities after each step that could move them
        self.trail: list[AuditEntry] = []
        self.avoided: set[Location] = set()
        self.probabilities = normalised(self._log_prior)
        self._shown.append(self.probabilities)
        about = {"summary": kind, "mixed": mixed, "log_odds_of_none": fit["none_log_odds"]}
        self._note("begin", {"database": data.digest, **about})
        if prior is not None:
            self.override(prior, "to begin with")

    def _equal(self) -> Array:
        pair = np.array(["+" in n for n in self.names])
        single = ~pair
        single[-1] = False
        out = np.full(len(self.names), NONE_PRIOR)
        share = MIXTURES_PRIOR if pair.any() else 0.0
        out[single] = (1 - NONE_PRIOR - share) / max(1, single.sum())
        out[pair] = share / max(1, pair.sum())
        return out

    def by_name(self) -> dict[str, float]:
        return {n: float(p) for n, p in zip(self.names, self.probabilities, strict=True)}

    def _note(self, what: str, details: Mapping[str, Any]) -> None:
        before = self.trail[-1].digest if self.trail else ""
        said = {k: round(v, 6) for k, v in self.by_name().items()}
        time = self._clock()
        body = json.dumps([before, time, what, dict(details), said], sort_keys=True)
        digest = hashlib.sha256(body.encode()).hexdigest()
        self.trail.append(AuditEntry(len(self.trail), time, what, dict(details), said, digest))

    def _settle(self) -> None:
        self.probabilities = normalised(self._log_prior + self.evidence.log_likelihood())

    def _step(self, what: str, read: bool = False, left_out: Location | None = None) -> None:
        # Every step that a person makes can be taken back, whatever it gave.
        self._undo.append(_Before(what, self._log_prior.copy(), read, left_out, len(self._shown)))

    @property
    def by_hand(self) -> bool:
        """Whether probabilities set by the clinician are in force."""
        return any(step.what == "clinician" for step in self._undo)

    def observe(self, where: Location, response_Nm: float, spread_Nm: float = 0.0) -> bool:
        """One location of one movement, measured; False where the map does not reach."""
        taken = self.evidence.add(where, response_Nm, spread_Nm)
        return self._taken(taken, "measured", where, {"response_Nm": round(float(response_Nm), 3)})

    def observe_movement(
        self, readings: MovementReadings, source: Mapping[str, Any] | None = None
    ) -> bool:
        """All that one movement passed; False where the map does not reach."""
        where, first = readings.locations[0], float(readings.responses_Nm[0])
        about = {"response_Nm": round(first, 3), "readings": len(readings.locations)}
        taken = self.evidence.add_movement(readings)
        return self._taken(taken, "measured", where, about | dict(source or {}))

    def _taken(self, taken: bool, what: str, where: Location, about: Mapping[str, Any]) -> bool:
        self._step(what, read=taken)
        if not taken:
            self._note("outside the map", {"location": where.text()})
            return False
        self._settle()
        self._shown.append(self.probabilities)
        self._note(what, {"location": where.text(), **about})
        return True

    def feel(self, where: Location, word: str) -> bool:
        """One movement without a sensor: how strongly the leg resisted, in a word."""
        if word not in WORDS:
            raise UserError(f"resistance: {word!r}.", f"Use {', '.join(WORDS)}.")
        resisting, spread = WORDS[word]
        # Passive tension is in every map: a word is about what is beyond a relaxed leg's.
        rest = 0.0
        if self.data.reference is not None:
            w = self.data.grid.weights(where, self.hypotheses.known)
            if w is not None:
                rest = float(np.nansum(w * np.nan_to_num(self.data.mean(self.data.reference))))
        value = rest + math.copysign(resisting, resisting * where.rate_rad_s)
        taken = self.evidence.add(where, value, spread)
        return self._taken(taken, "felt", where, {"word": word})

    def missed(self, where: Location) -> None:
        """A location that could not be passed: not asked for again."""
        if self.trail[-1].what in ("measured", "outside the map"):  # the same movement: one step
            self._undo[-1] = replace(self._undo[-1], left_out=where)
        else:
            self._step("missed", left_out=where)
        self.avoided.add(where)
        self._note("missed", {"location": where.text()})

    def leave_out(self, where: Location) -> None:
        """A location that is not to be passed, as the clinician wishes."""
        self._step("left out", left_out=where)
        self.avoided.add(where)
        self._note("left out", {"location": where.text()})

    def skip(self, why: str = "") -> None:
        self._step("skipped")
        self._note("skipped", {"why": why})

    def override(self, probabilities: Mapping[str, float], why: str) -> None:
        """Set the clinician's probabilities; unnamed categories share the rest in proportion."""
        for name, p in probabilities.items():
            if name not in self.names:
                raise UserError(f"category: {name!r}.", f"Use {', '.join(self.names)}.")
            if not 0 <= p <= 1:
                raise UserError(f"probability of {name}: {p}.", "Give 0 to 1.")
        given = sum(probabilities.values())
        if given > 1 + 1e-9:
            raise UserError(f"probabilities: they add up to {given:.3g}.", "Give at most 1 in all.")
        target = self.probabilities.copy()
        named = np.array([n in probabilities for n in self.names])
        rest = float(target[~named].sum())
        if named.all() and abs(given - 1) > 1e-6:
            raise UserError(f"probabilities: they add up to {given:.3g}.", "Make the sum 1.")
        if rest > 0:
            target[~named] *= (1 - given) / rest
        elif (~named).any():
            target[~named] = (1 - given) / (~named).sum()
        for i, n in enumerate(self.names):
            if n in probabilities:
                target[i] = probabilities[n]
        self._step("clinician")
        # A category at 0 may come back if the clinician says so: kept finite.
        self._log_prior = np.log(np.maximum(target, 1e-12)) - self.evidence.log_likelihood()
        self._settle()
        self._shown.append(self.probabilities)
        self._note(
            "clinician", {"why": why, "set": {k: float(v) for k, v in probabilities.items()}}
        )

    def undo(self) -> bool:
        """Take back the last step; it stays in the trail as taken back."""
        if not self._undo:
            return False
        before = self._undo.pop()
        self._log_prior = before.log_prior
        if before.read:
            self.evidence.undo()
        if before.left_out is not None:
            self.avoided.discard(before.left_out)
        del self._shown[before.shown :]
        self._settle()
        self._note("undone", {})
        return True

    @property
    def settled(self) -> bool:
        """Whether the probabilities have stopped changing: three steps in a row below 0.02."""
        last = self._shown[-SETTLED_STEPS - 1 :]
        if len(last) <= SETTLED_STEPS:
            return False
        return all(float(np.abs(b - a).max()) < SETTLED for a, b in pairwise(last))

    def severity(self) -> dict[str, dict[str, float]]:
        """Severity as a number, for each disorder: mean, middle 90 %, and its probability."""
        singles = [n for n in self.names if disorder_of(n) and "+" not in n]
        if not singles:
            return {}
        fine, labels = between_severities(self.hypotheses.only(singles))
        log = self.evidence.under(fine).log_likelihood()
        out: dict[str, dict[str, float]] = {}
        for what in dict.fromkeys(n for n, _ in labels):
            at = [i for i, (n, _) in enumerate(labels) if n == what]
            s, p = np.array([labels[i][1] for i in at]), normalised(log[at])
            ends = np.searchsorted(np.cumsum(p), (0.05, 0.95))
            low, high = s[np.minimum(ends, len(s) - 1)]
            single = [n for n in singles if (disorder_of(n) or ("", 0.0))[0] == what]
            named = [self.names.index(n) for n in single]
            out[what] = {
                "mean": float(p @ s),
                "low": float(low),
                "high": float(high),
                "probability": float(self.probabilities[named].sum()),
            }
        return out

    def to_dict(self) -> dict[str, Any]:
        return {
            "notice": self.data.notice,
            "database": {**self.data.provenance, "digest": self.data.digest},
            "calibration": dict(self.data.calibration or {}),
            "probabilities": self.by_name(),
            "severity": self.severity(),
            "settled": self.settled,
            "none": float(self.probabilities[self.names.index(NONE)]),
            "trail": [vars(e) | {"details": dict(e.details)} for e in self.trail],
        }


def take(
    session: Assessment, passed: Passage, wanted: Location, source: Mapping[str, Any] | None = None
) -> bool:
    """Take in a movement that was to pass a location; False where it missed it."""
    found = along(passed, wanted)
    counted = found is not None and session.observe_movement(found, source)
    if found is not None and counted and found.passed:
        return True
    session.missed(wanted)
    return False
