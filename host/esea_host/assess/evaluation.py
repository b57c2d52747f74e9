"""Evaluation of the classifier on new simulated patients.

Four ways of choosing movements examine every patient, in lockstep: by expected information, by the
thesis' measure, by a fixed protocol, at random.  Parameters are jittered, sizes of legs and noise
differ; no patient was in the data base or in a calibration.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from joblib import Parallel, delayed

from esea_gen.errors import UserError
from esea_host.assess.build import EVALUATION
from esea_host.assess.database import ResponseDataBase
from esea_host.assess.hypotheses import Hypotheses
from esea_host.assess.patients import (
    CATEGORIES,
    DISORDERS,
    OUTSIDE_KINDS,
    Array,
    KneePatient,
    draw,
    draw_category,
    draw_outside,
)
from esea_host.assess.probing import (
    Comfort,
    ProbingMovement,
    informative,
    next_movement,
    plans,
    probing_movement,
)
from esea_host.assess.responses import Location
from esea_host.assess.session import Assessment, assessed_hypotheses, take
from esea_host.assess.simulated import probed

Cells = npt.NDArray[np.intp]
WAYS = ("expected", "thesis", "fixed", "random")
CONFIDENT = 0.95
MOVEMENTS = 12  # after which the answer is looked at
MOST = 30  # movements until given up; counted as so many
CHUNK = 40  # patients stepped together, whatever the number of workers: the same numbers


@dataclass(frozen=True)
class Met:
    """One patient met in one way."""

    group: str
    truth: str
    spastic: float
    dystonic: float
    way: str
    steps: Array  # probabilities after each movement, shape (movements + 1, hypotheses)
    severity: dict[str, dict[str, float]]


def fixed_protocol(data: ResponseDataBase, cells: Cells) -> list[Location]:
    """A protocol as clinics have it, after the Modified Tardieu Scale [Boyd1999].

    As slowly as can be, then at once as fast as can be, bent and then straightened: first in the
    middle of the range, then towards either end; last of all at a middle speed.

    [Boyd1999] R. N. Boyd, H. K. Graham, "Objective measurement of clinical findings in the use of
        botulinum toxin type A for the management of children with cerebral palsy", Eur. J. Neurol.
        6(S4):S23-S35, 1999.
    """
    angles, ways = (65, 95, 35), (1, -1)
    wanted = [(angle, way * rate) for angle in angles for way in ways for rate in (10, 90)]
    wanted += [(angle, way * 50) for angle in angles for way in ways]
    centres = data.grid.centres[cells]
    scale = [np.diff(x[:2])[0] for x in (data.grid.angle_rad, data.grid.rate_rad_s)]
    found = []
    for a, r in wanted:
        off = (centres - np.radians([a, r])) / scale
        found.append(data.grid.location(int(cells[np.argmin(np.sum(off**2, axis=1))])))
    return found


def draw_groups(patients: int, seed: int, names: Sequence[str]) -> list[tuple[str, KneePatient]]:
    """Patients of the categories, without a disorder, between two, and with two disorders."""
    root = EVALUATION + seed
    other = max(len(OUTSIDE_KINDS), patients // 4)
    levels = _levels(names)
    out = []
    for i in range(patients):
        rng = np.random.default_rng([root, 0, i])
        out.append(("inside", draw_category(names[i % len(names)], rng)))
    for i in range(other):
        rng = np.random.default_rng([root, 1, i])
        out.append(("outside", draw_outside(OUTSIDE_KINDS[i % len(OUTSIDE_KINDS)], rng)))
    for i in range(max(4, patients // 10)):
        rng = np.random.default_rng([root, 2, i])
        spastic = i % 2 == 0
        known = levels["S" if spastic else "D"]
        at = i // 2 % (len(known) - 1)
        level = 0.5 * (known[at] + known[at + 1])
        name = f"{'S' if spastic else 'D'}{level:g}"
        who = draw(level if spastic else 0, 0 if spastic else level, rng, name)
        out.append(("between", who))
    for i in range(max(4, patients // 10)):
        rng = np.random.default_rng([root, 3, i])
        s, d = (float(rng.choice(levels[x][1:4])) for x in DISORDERS)
        out.append(("mixed", draw(s, d, rng, f"S{s:g}+D{d:g}")))
    return out


def _levels(names: Sequence[str]) -> dict[str, list[float]]:
    # Severities of either disorder; whoever is simulated has no other ones.
    known = set(names) <= set(CATEGORIES)
    found = {x: sorted(float(n[1:]) for n in names if known and n[0] == x) for x in DISORDERS}
    if all(len(x) > 1 for x in found.values()):
        return found
    raise UserError(
        f"data base: categories {', '.join(names)}; the simulated patients that it would be judged "
        f"on are {', '.join(CATEGORIES)}.",
        "Judge one with two severities or more of each of these, such as: esea-host assess build.",
    )


class _Lane:
    def __init__(
        self, way: str, session: Assessment, rng: np.random.Generator, inside: bool
    ) -> None:
        self.way, self.session, self.rng, self.inside = way, session, rng, inside
        self.steps = [session.probabilities]
        self.severity: dict[str, dict[str, float]] = {}

    def done(self) -> bool:
        made = len(self.steps) - 1
        # Movements to 95 % are counted of patients of the categories alone.
        sure = not self.inside or any(p[:-1].max() >= CONFIDENT for p in self.steps)
        return made >= MOST or (made >= MOVEMENTS and sure)

    def choose(self, cells: Cells, protocol: list[Location]) -> ProbingMovement:
        grid = self.session.hypotheses.grid
        if self.way in ("expected", "thesis"):
            return next_movement(self.session, value=informative(self.session, measure=self.way))
        made = len(self.steps) - 1
        where = (
            protocol[made % len(protocol)]
            if self.way == "fixed"
            else grid.location(int(self.rng.choice(cells)))
        )
        found = probing_movement(where, Comfort())
        assert found is not None
        return found


def meet(
    data: ResponseDataBase,
    hypotheses: Hypotheses,
    people: Sequence[tuple[str, KneePatient]],
    first: int,
    seed: int,
    ways: Sequence[str] = WAYS,
) -> list[Met]:
    """A chunk of patients, each met in every way."""
    cells = np.array([p.cell for p in plans(hypotheses)])
    protocol = fixed_protocol(data, cells)
    root = EVALUATION + seed
    lanes = []
    for i, (group, _) in enumerate(people):
        # Ways are compared on patients of the categories.
        for j, way in enumerate(ways if group == "inside" else ways[:1]):
            session = Assessment(data, hypotheses=hypotheses)
            rng = np.random.default_rng([root, 5, first + i, j])
            lanes.append((i, _Lane(way, session, rng, group == "inside")))
    for k in range(MOST):
        active = [(i, lane) for i, lane in lanes if not lane.done()]
        if not active:
            break
        moves = [lane.choose(cells, protocol) for _, lane in active]
        seeds = [[root, 6, first + i, WAYS.index(lane.way), k] for i, lane in active]
        passages = probed([people[i][1] for i, _ in active], moves, seeds)
        for (_, lane), move, p in zip(active, moves, passages, strict=True):
            take(lane.session, p, move.location)
            lane.steps.append(lane.session.probabilities)
            if len(lane.steps) - 1 == MOVEMENTS:
                lane.severity = lane.session.severity()
    return [
        Met(
            people[i][0],
            people[i][1].category,
            people[i][1].spastic,
            people[i][1].dystonic,
            lane.way,
            np.array(lane.steps),
            lane.severity,
        )
        for i, lane in lanes
    ]


def evaluate(
    data: ResponseDataBase,
    patients: int = 200,
    seed: int = 1,
    jobs: int = 1,
    say: Callable[[str], None] | None = None,
) -> tuple[list[Met], list[Met]]:
    """Assess newly drawn patients; the result does not depend on the number of workers."""
    if patients < len(data.diagnoses):
        raise UserError(f"patients: {patients}.", f"Give at least {len(data.diagnoses)}.")
    if (jobs < 1 and jobs != -1) or seed < 0:
        raise UserError(
            f"workers: {jobs}, seed: {seed}.", "Give 1 or more, or -1 for all cores; a seed from 0."
        )
    people = draw_groups(patients, seed, data.diagnoses)
    plain, pairs = assessed_hypotheses(data), assessed_hypotheses(data, mixed=True)
    work: list[tuple[Hypotheses, list[tuple[str, KneePatient]], int, Sequence[str]]] = [
        (plain, people[k : k + CHUNK], k, WAYS) for k in range(0, len(people), CHUNK)
    ]
    at = next(i for i, (g, _) in enumerate(people) if g == "mixed")
    work.append((pairs, people[at:], at, ("expected",)))
    results: list[list[Met]] = []
    chunks = Parallel(n_jobs=jobs, return_as="generator")(
        delayed(meet)(data, h, part, first, seed, w) for h, part, first, w in work
    )
    for found in chunks:
        results.append(found)
        if say:
            say(f"{len(results)} of {len(work)} groups of patients")
    return [m for part in results[:-1] for m in part], results[-1]
