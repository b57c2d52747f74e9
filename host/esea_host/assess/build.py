"""The database from simulated patients, calibrated on other simulated patients.

The knee's is beside this file, written by ``esea-host assess build host/esea_host/assess/knee.npz``
in minutes.  Tests simulate some of its people again.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Memory

import esea_gen.cache
from esea_gen.cache import cache_folder
from esea_host.assess import NOTICE
from esea_host.assess.database import KNEE_GRID, Answers, ResponseDataBase, answered
from esea_host.assess.hypotheses import normalised, summarised
from esea_host.assess.patients import CATEGORIES, RELAXED, Array, KneePatient, draw_category
from esea_host.assess.probing import next_movement, plans
from esea_host.assess.session import UNCALIBRATED, Assessment, assessed_hypotheses, take
from esea_host.assess.simulated import probed, swept

# Roots of the seeds.  Evaluation adds its own seed to EVALUATION: nobody is met twice.
PEOPLE, CALIBRATION, NONE_CALIBRATION, EVALUATION = 11, 12, 13, 1000
PER_CATEGORY, CALIBRATION_PER_CATEGORY = 60, 12
CALIBRATION_MOVEMENTS = 12
LOOKS = (1, 3, 6, 12)  # movements after which the noise is judged
FITTED = {
    "own_Nm": (0.25, 0.5, 0.75, 1.0, 1.4, 2.0),
    "share": (0.0, 0.03, 0.06, 0.1),
    "people_scale": (0.5, 0.75, 1.0),
    "noise_Nm": (0.25, 0.5, 1.0, 1.4, 2.0),
}
NONE_INSIDE = 0.02  # share of calibration patients that may be called "none of these"
CHUNK = 110  # people simulated together; an interrupted build goes on after the last ones
Say = Callable[[str], None]


def _nothing(_: str) -> None: ...


def draw_many(root: int, per_category: int, names: Sequence[str] = CATEGORIES) -> list[KneePatient]:
    return [
        draw_category(c, np.random.default_rng([root, i, k]))
        for i, c in enumerate(names)
        for k in range(per_category)
    ]


def simulated_people(root: int, per_category: int, say: Say) -> list[Answers]:
    """Responses of swept patients of every category, and without a disorder."""
    people = draw_many(root, per_category, (*CATEGORIES, RELAXED))
    out: list[Answers] = []
    for first in range(0, len(people), CHUNK):
        out += _kept(partial(_swept_chunk, people, root, first), root, per_category, first)
        say(f"simulated patients {len(out)} of {len(people)}")
    return out


def _swept_chunk(people: Sequence[KneePatient], root: int, first: int) -> list[Answers]:
    part = people[first : first + CHUNK]
    passages = swept(part, [[root, 7, first + i] for i in range(len(part))])
    return list(answered(zip([p.category for p in part], passages, strict=True), KNEE_GRID))


def _kept(call: Callable[[], Any], *key: Any) -> Any:
    """Result of a part of the build, stored so that an interrupted build continues after it."""
    memory = Memory(cache_folder() / "assess-build", verbose=0)
    return memory.cache(_called, ignore=["call"])(call, _code(), CHUNK, key)


def _called(call: Callable[[], Any], code: str, chunk: int, key: Any) -> Any:
    return call()


@cache
def _code() -> str:
    # Of all that could decide the numbers: parts that other code made are not taken.
    digest = hashlib.sha256(str(esea_gen.cache.code_digest()).encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def build(per_category: int = PER_CATEGORY, say: Say | None = None) -> ResponseDataBase:
    tell = say or _nothing
    provenance = {
        "notice": NOTICE,
        "source": "simulated knee patients, docs/assessment.md",
        "excitation": "sine swept 0 to 0.3 Hz at 0.5 Hz/min, 130 deg peak to peak, pull of 10 kgf",
        "sensor": "twin of the device knee: cuff, dead zone, encoders, emitted C",
        "per_category": per_category,
        "seed": PEOPLE,
    }
    people = simulated_people(PEOPLE, per_category, tell)
    data = ResponseDataBase.of(people, KNEE_GRID, provenance, RELAXED)
    noise = _kept(partial(movement_noise, data, tell), "noise", data.digest)
    data = dataclasses.replace(data, calibration=noise)
    none = none_calibration(data, tell)
    return dataclasses.replace(data, calibration={**noise, **none})


def movement_noise(data: ResponseDataBase, tell: Say = _nothing) -> dict[str, float]:
    """Noise of maps, persons and readings: best log score on calibration patients.

    Every other movement is chosen as in use, for a chooser goes where errors repeat themselves.
    """
    people = draw_many(CALIBRATION, CALIBRATION_PER_CATEGORY, data.diagnoses)
    sessions = [Assessment(data, hypotheses=h) for h in [assessed_hypotheses(data)] for _ in people]
    rng = np.random.default_rng([CALIBRATION, 1])
    any_one = [p.movement for p in plans(sessions[0].hypotheses)]
    for k in range(CALIBRATION_MOVEMENTS):
        tell(f"noise of a movement: movement {k + 1} of {CALIBRATION_MOVEMENTS}")
        drawn = [any_one[i] for i in rng.integers(0, len(any_one), len(people))]
        moves = [next_movement(s) for s in sessions] if k % 2 else drawn
        seeds = [[CALIBRATION, 8, i, k] for i in range(len(people))]
        for s, m, p in zip(sessions, moves, probed(people, moves, seeds), strict=True):
            take(s, p, m.location)
    truth = np.array([data.diagnoses.index(p.category) for p in people])
    base = summarised(data).only(data.diagnoses)

    def score(fit: dict[str, float]) -> float:
        h, total = base.with_movement_noise(fit), 0.0
        for s, t in zip(sessions, truth, strict=True):
            for log in s.evidence.history(h, LOOKS):
                total += float(np.log(max(normalised(log)[t], 1e-12)))
        return total

    kept = {k: UNCALIBRATED[k] for k in FITTED}
    best = score(kept)
    for name in (*FITTED, *FITTED):  # one after the other, twice
        tell(f"noise of a movement: {name} is fitted")
        for value in FITTED[name]:
            tried = kept | {name: value}
            found = score(tried) if tried != kept else best
            if found > best:
                best, kept = found, tried
    return kept


def none_calibration(data: ResponseDataBase, tell: Say = _nothing) -> dict[str, float]:
    """Offset that lowers "none of these", from other people of the categories only.

    Nobody of no category is used: what such people are like is not known beforehand.
    """
    people = draw_many(NONE_CALIBRATION, 2 * CALIBRATION_PER_CATEGORY, data.diagnoses)
    found: list[float] = []
    for first in range(0, len(people), CHUNK):
        found += _kept(partial(_none_chunk, data, people, first), "none", data.digest, first)
        tell(f"none of these: calibration patients {len(found)} of {len(people)}")
    return none_offset(np.array(found))


def _none_chunk(data: ResponseDataBase, people: Sequence[KneePatient], first: int) -> list[float]:
    part, hypotheses = people[first : first + CHUNK], assessed_hypotheses(data)
    sessions = [Assessment(data, hypotheses=hypotheses) for _ in part]
    for k in range(CALIBRATION_MOVEMENTS):
        moves = [next_movement(s) for s in sessions]
        seeds = [[NONE_CALIBRATION, 8, first + i, k] for i in range(len(part))]
        for s, m, p in zip(sessions, moves, probed(part, moves, seeds), strict=True):
            take(s, p, m.location)
    return [float(s.probabilities[-1]) for s in sessions]


def none_offset(none: Array) -> dict[str, float]:
    """Log odds to add, so that at most 2 % of calibration patients are called none of these.

    none: its probability for each of them, without an offset.
    return: with the offset, at most 0 (raised, it would lead before the first movement): how many
        there were, and how many would be called so with it.
    """
    odds = np.log(np.maximum(none, 1e-300)) - np.log(np.maximum(1 - none, 1e-300))
    # The first that is to fall behind: a quantile between two would let one more pass.
    ranked, allowed = np.sort(odds)[::-1], int(NONE_INSIDE * len(odds))
    offset = float(min(0.0, -ranked[allowed] - 1e-6))
    called = int(np.sum(odds + offset > 0))
    return {"none_log_odds": offset, "none_patients": len(odds), "none_called": called}
