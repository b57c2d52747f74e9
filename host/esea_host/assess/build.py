"""The data base from simulated patients, calibrated on other simulated patients."""

from __future__ import annotations

import ast
import dataclasses
import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.cache import cache_folder
from esea_host.assess import NOTICE
from esea_host.assess.database import KNEE_GRID, ResponseDataBase
from esea_host.assess.hypotheses import Evidence, normalised, summarised
from esea_host.assess.patients import CATEGORIES, RELAXED, KneePatient, draw_category
from esea_host.assess.probing import Comfort, next_movement, probing_movement, reachable
from esea_host.assess.responses import Passage, nearest_reading
from esea_host.assess.session import Assessment, assessed_hypotheses
from esea_host.assess.simulated import probed, swept

# Roots of the seeds.  Evaluation adds its own seed to EVALUATION: nobody is met twice.
PEOPLE, CALIBRATION, NONE_CALIBRATION, EVALUATION = 11, 12, 13, 1000
PER_CATEGORY, CALIBRATION_PER_CATEGORY = 60, 12
CALIBRATION_MOVEMENTS = 12
LOOKS = (2, 5, 11)  # movements after which the noise is judged
NONE_INSIDE = 0.02  # share of calibration patients that may be called "none of these"
CHUNK = 220
SIMULATION = ("patients", "knee", "sensing", "responses", "database", "simulated")
FITTING = ("build", "hypotheses", "kernel_map", "probing", "session")
Say = Callable[[str], None]


def draw_many(root: int, per_category: int, names: Sequence[str] = CATEGORIES) -> list[KneePatient]:
    """So many patients of each category, category by category."""
    return [
        draw_category(c, np.random.default_rng([root, i, k]))
        for i, c in enumerate(names)
        for k in range(per_category)
    ]


def simulated_people(root: int, per_category: int, say: Say) -> list[tuple[str, Passage]]:
    """Swept patients of every category, and of none."""
    people = draw_many(root, per_category, (*CATEGORIES, RELAXED))
    out: list[tuple[str, Passage]] = []
    for first in range(0, len(people), CHUNK):
        part = people[first : first + CHUNK]
        say(f"simulated patients {first + len(part)} of {len(people)}")
        seeds = [[root, 7, first + i] for i in range(len(part))]
        out += zip([p.category for p in part], swept(part, seeds), strict=True)
    return out


def _people(per_category: int, provenance: dict[str, Any], tell: Say) -> ResponseDataBase:
    # Simulating them takes longest: kept apart from what is fitted afterwards.
    path = cache_folder() / f"assess-people-{per_category}-{code_digest(SIMULATION)}.npz"
    if path.exists():
        return dataclasses.replace(ResponseDataBase.load(path), provenance=provenance)
    people = simulated_people(PEOPLE, per_category, tell)
    data = ResponseDataBase.of(people, KNEE_GRID, provenance, RELAXED)
    data.save(path)
    return data


def build(per_category: int = PER_CATEGORY, say: Say | None = None) -> ResponseDataBase:
    """The knee's data base, of simulated patients alone."""
    tell = say or (lambda _: None)
    provenance = {
        "notice": NOTICE,
        "source": "simulated knee patients, docs/assessment.md",
        "excitation": "sine swept 0 to 0.3 Hz at 0.5 Hz/min, 130 deg peak to peak, pull of 10 kgf",
        "sensor": "emitted C of the device knee",
        "per_category": per_category,
        "seed": PEOPLE,
        "code": code_digest(SIMULATION + FITTING),
    }
    data = _people(per_category, provenance, tell)
    tell("calibration: noise of a movement")
    data = dataclasses.replace(data, calibration=movement_noise(data))
    tell("calibration: none of these")
    return dataclasses.replace(
        data, calibration={**(data.calibration or {}), "none_log_odds": none_offset(data)}
    )


def movement_noise(data: ResponseDataBase) -> dict[str, float]:
    """Noise of one movement and size of the factors: best log score on calibration patients."""
    people = draw_many(CALIBRATION, CALIBRATION_PER_CATEGORY, data.diagnoses)
    comfort = Comfort()
    base = summarised(data)
    cells = np.flatnonzero(reachable(data.grid, base.known, comfort))
    readings = [Evidence(base) for _ in people]
    looks: list[list[Evidence]] = [[] for _ in people]
    rng = np.random.default_rng([CALIBRATION, 1])
    for k in range(CALIBRATION_MOVEMENTS):
        wanted = [data.grid.location(int(c)) for c in rng.choice(cells, len(people))]
        moves = [probing_movement(w, comfort) for w in wanted]
        seeds = [[CALIBRATION, 8, i, k] for i in range(len(people))]
        passages = probed(people, [m for m in moves if m], seeds)
        for i, (passed, w) in enumerate(zip(passages, wanted, strict=True)):
            found = nearest_reading(passed, w)
            if found:
                readings[i].add(found.location, found.response_Nm, found.spread_Nm)
            if k in LOOKS and len(readings[i]):
                looks[i].append(readings[i].under(base))
    truth = np.array([data.diagnoses.index(p.category) for p in people])
    best, kept = -np.inf, {}
    for own in (0.25, 0.5, 1.0, 1.5):
        for share in (0.0, 0.05, 0.1):
            for scale in (0.5, 0.75, 1.0):
                h = base.only(data.diagnoses).with_movement_noise(own, share, scale)
                score = 0.0
                for i, mine in enumerate(looks):
                    for evidence in mine:
                        said = normalised(evidence.under(h).log_likelihood())
                        score += float(np.log(max(said[truth[i]], 1e-12)))
                if score > best:
                    best = score
                    kept = {"own_Nm": own, "share": share, "factor_scale": scale}
    return kept


def none_offset(data: ResponseDataBase) -> float:
    """Log odds added to "none of these", at most 0: from people of the categories alone.

    Nobody of no category is used: what such people are like is not known beforehand.
    """
    people = draw_many(NONE_CALIBRATION, 2 * CALIBRATION_PER_CATEGORY, data.diagnoses)
    hypotheses = assessed_hypotheses(data)
    sessions = [Assessment(data, hypotheses=hypotheses) for _ in people]
    for k in range(CALIBRATION_MOVEMENTS):
        moves = [next_movement(s) for s in sessions]
        seeds = [[NONE_CALIBRATION, 8, i, k] for i in range(len(people))]
        for s, m, p in zip(sessions, moves, probed(people, moves, seeds), strict=True):
            found = nearest_reading(p, m.location)
            if found is None or not s.observe(found.location, found.response_Nm, found.spread_Nm):
                s.missed(m.location)
    all_p = np.array([s.probabilities for s in sessions])
    odds = np.log(np.maximum(all_p[:, -1], 1e-300)) - np.log(
        np.maximum(all_p[:, :-1].sum(axis=1), 1e-300)
    )
    # Never in its favour: it would lead before the first movement.
    return float(min(0.0, -np.quantile(odds, 1 - NONE_INSIDE)))


def code_digest(files: Sequence[str]) -> str:
    """Digest of what something is made with: files of this room."""
    digest = hashlib.sha256()
    for name in files:
        text = (Path(__file__).parent / f"{name}.py").read_text(encoding="utf-8")
        digest.update(ast.dump(ast.parse(text)).encode())  # comments and layout do not count
    return digest.hexdigest()[:16]


def cached(per_category: int = PER_CATEGORY, say: Say | None = None) -> ResponseDataBase:
    """The data base, built once and kept."""
    path = cache_folder() / f"assess-knee-{per_category}-{code_digest(SIMULATION + FITTING)}.npz"
    if path.exists():
        return ResponseDataBase.load(path)
    data = build(per_category, say)
    data.save(path)
    return data
