"""Evaluation of the classifier on new simulated patients, and its judgement with intervals.

Four ways of choosing movements examine every patient, in lockstep: by expected information, by the
thesis' measure, by a fixed protocol, at random.  Parameters are jittered, sizes of legs and noise
differ; no patient was in the database or in a calibration.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from joblib import Parallel, delayed

from esea_gen.errors import UserError
from esea_gen.files import plain
from esea_host.assess import probing
from esea_host.assess.build import EVALUATION
from esea_host.assess.database import ResponseDataBase
from esea_host.assess.hypotheses import NONE, Hypotheses, disorder_of
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

    def rng(group: int, i: int) -> np.random.Generator:
        return np.random.default_rng([root, group, i])

    kinds = len(OUTSIDE_KINDS)
    out = [("inside", draw_category(names[i % len(names)], rng(0, i))) for i in range(patients)]
    out += [("outside", draw_outside(OUTSIDE_KINDS[i % kinds], rng(1, i))) for i in range(other)]
    for i in range(max(4, patients // 10)):
        spastic = i % 2 == 0
        known = levels["S" if spastic else "D"]
        at = i // 2 % (len(known) - 1)
        level = 0.5 * (known[at] + known[at + 1])
        name = f"{'S' if spastic else 'D'}{level:g}"
        both = (level, 0.0) if spastic else (0.0, level)
        out.append(("between", draw(*both, rng(2, i), name)))
    for i in range(max(4, patients // 10)):
        drawn = rng(3, i)
        s, d = (float(drawn.choice(levels[x][1:4])) for x in DISORDERS)
        out.append(("mixed", draw(s, d, drawn, f"S{s:g}+D{d:g}")))
    return out


def _levels(names: Sequence[str]) -> dict[str, list[float]]:
    # Severities of either disorder; whoever is simulated has no other ones.
    known = set(names) <= set(CATEGORIES)
    found = {x: sorted(float(n[1:]) for n in names if known and n[0] == x) for x in DISORDERS}
    if all(len(x) > 1 for x in found.values()):
        return found
    raise UserError(
        f"database: categories {', '.join(names)}; the simulated patients for its evaluation "
        f"on are {', '.join(CATEGORIES)}.",
        "Use one with at least two severities of each of these, such as: esea-host assess build.",
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

    def choose(self, cells: Cells, protocol: list[Location]) -> probing.ProbingMovement:
        grid = self.session.hypotheses.grid
        if self.way in ("expected", "thesis"):
            return probing.next_movement(
                self.session, value=probing.informative(self.session, measure=self.way)
            )
        made = len(self.steps) - 1
        where = (
            protocol[made % len(protocol)]
            if self.way == "fixed"
            else grid.location(int(self.rng.choice(cells)))
        )
        found = probing.probing_movement(where, probing.Comfort())
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
    cells = np.array([p.cell for p in probing.plans(hypotheses)])
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
        Met(group, p.category, p.spastic, p.dystonic, lane.way, np.array(lane.steps), lane.severity)
        for (group, p), lane in ((people[i], lane) for i, lane in lanes)
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


Index = npt.NDArray[np.int64]
DRAWS = 1000
BINS = 10


def confusion(truth: Index, said: Index, rows: int, columns: int) -> Array:
    """Counts: truth in rows, answers in columns."""
    out = np.zeros((rows, columns))
    np.add.at(out, (truth, said), 1)
    return out


def calibration_curve(
    confidence: Array, right: Array, bins: int = BINS
) -> tuple[Array, Array, Array]:
    """Mean confidence, share right and count of each bin of confidence; equal widths."""
    at = np.minimum((confidence * bins).astype(int), bins - 1)
    count = np.bincount(at, minlength=bins).astype(float)
    safe = np.maximum(count, 1)
    return (np.bincount(at, confidence, bins) / safe, np.bincount(at, right, bins) / safe, count)


def calibration_error(confidence: Array, right: Array, bins: int = BINS) -> float:
    """Expected calibration error: mean distance of confidence from share right."""
    c, r, n = calibration_curve(confidence, right, bins)
    return float(np.sum(n * np.abs(c - r)) / max(1.0, n.sum()))


def interval(statistic: Callable[[Index], float], people: int, seed: int = 0) -> list[float]:
    """Middle 95 % over people drawn with replacement: whole people, not steps."""
    rng = np.random.default_rng([seed, people])
    found = [statistic(rng.integers(0, people, people)) for _ in range(DRAWS)]
    return [float(x) for x in np.quantile(found, [0.025, 0.975])]


def share_interval(hits: int, of: int) -> list[float]:
    """Wilson's 95 % interval of a share."""
    from statsmodels.stats.proportion import proportion_confint

    ends = proportion_confint(hits, of, method="wilson") if of else (0.0, 1.0)
    return [float(x) for x in np.clip(ends, 0.0, 1.0)]


def motions_to_confidence(m: Met) -> int:
    """Movements until a category reaches 95 %; the maximum if no category does."""
    sure = np.flatnonzero(m.steps[:, :-1].max(axis=1) >= CONFIDENT)
    return int(min(sure[0], MOST)) if len(sure) else MOST


def final(m: Met) -> Array:
    """Probabilities after the movements at which the answer is looked at."""
    return np.asarray(m.steps[min(MOVEMENTS, len(m.steps) - 1)])


def judge(met: Sequence[Met], mixed: Sequence[Met], data: ResponseDataBase) -> dict[str, Any]:
    names = assessed_hypotheses(data).names
    ways = [w for w in WAYS if any(m.way == w for m in met)]
    inside = {w: [m for m in met if m.group == "inside" and m.way == w] for w in ways}
    out: dict[str, Any] = {
        "notice": data.notice,
        "simulated": True,
        "patients": {
            g: sum(m.group == g and m.way == ways[0] for m in met)
            for g in ("inside", "outside", "between", "mixed")
        },
        "categories": list(data.diagnoses),
        "answers": list(names),
        "data_base": {**data.provenance, "digest": data.digest},
        "calibration": dict(data.calibration or {}),
        "looked_at_after": MOVEMENTS,
        "most_movements": MOST,
    }
    out |= _motions(inside)
    out["ways"] = {w: _way(inside[w], names, len(data.diagnoses)) for w in ways}
    main = out["ways"]["expected"]
    shown = ("confusion", "accuracy", "log_score", "calibration_curve")
    out |= {k: main[k] for k in (*shown, "calibration_error", "calibration_error_interval")}
    out |= _none([m for m in met if m.way == "expected"], names, data.reference)
    between = [m for m in met if m.group == "between" and m.way == "expected"]
    out["between"] = _between(between, names)
    out["severity"] = _severity(inside["expected"])
    alone = [m for m in met if m.group == "mixed" and m.way == "expected"]
    out["mixed"] = _mixed(alone, [m for m in mixed if m.group == "mixed"], names, data)
    found: dict[str, Any] = plain(out)
    return found


def _ratio(a: Array, b: Array) -> Callable[[Index], float]:
    return lambda i: float(a[i].mean() / b[i].mean())


def _motions(inside: dict[str, list[Met]]) -> dict[str, Any]:
    counts = {
        w: np.array([motions_to_confidence(m) for m in ms], dtype=np.float64)
        for w, ms in inside.items()
    }
    out: dict[str, Any] = {
        "motions": {
            w: {
                "mean": c.mean(),
                "interval": interval(_ratio(c, np.ones(len(c))), len(c)),
                "median": np.median(c),
                "never": np.mean(c >= MOST),
            }
            for w, c in counts.items()
        }
    }
    for key, way, against in (
        ("motions_ratio", "expected", "random"),
        ("motions_ratio_fixed", "expected", "fixed"),
        ("motions_ratio_thesis", "thesis", "random"),
    ):
        if way in counts and against in counts:
            ratio = _ratio(counts[way], counts[against])
            out[key] = ratio(np.arange(len(counts[way])))
            out[f"{key}_interval"] = interval(ratio, len(counts[way]))
    return out


def _way(met: list[Met], names: tuple[str, ...], rows: int) -> dict[str, Any]:
    truth = np.array([names.index(m.truth) for m in met])
    p = np.array([final(m) for m in met])
    said = p.argmax(axis=1)
    right = said == truth
    # Every answer shown on the way is judged, not only the last one.
    shown = [m.steps[1 : MOVEMENTS + 1] for m in met]
    confidence = np.array([s.max(axis=1) for s in shown])
    hit = np.array([s.argmax(axis=1) == t for s, t in zip(shown, truth, strict=True)]).astype(float)
    score = np.array([np.log(max(q[t], 1e-12)) for q, t in zip(p, truth, strict=True)])
    curve = calibration_curve(confidence.ravel(), hit.ravel())
    return {
        "accuracy": right.mean(),
        "log_score": score.mean(),
        "confusion": confusion(truth, said, rows, len(names)),
        "calibration_error": calibration_error(confidence.ravel(), hit.ravel()),
        "calibration_error_interval": interval(
            lambda i: calibration_error(confidence[i].ravel(), hit[i].ravel()), len(met)
        ),
        "calibration_curve": dict(zip(("confidence", "right", "count"), curve, strict=True)),
    }


def _none(met: list[Met], names: tuple[str, ...], reference: str | None) -> dict[str, Any]:
    at = names.index(reference) if reference else None

    def told(group: list[Met]) -> tuple[int, int]:
        # Of no category: "none of these".  "No disorder" counts where it is true, and where it is
        # an error (on a patient); not as an answer for somebody who has something else.
        hits = 0
        for m in group:
            p = final(m)
            relaxed = at is not None and (m.group == "inside" or m.truth == names[at])
            hits += bool(p[-1] + (p[at] if relaxed and at is not None else 0.0) > 0.5)
        return hits, len(group)

    outside = [m for m in met if m.group == "outside"]
    rates = {"outside": told(outside), "inside": told([m for m in met if m.group == "inside"])}
    out: dict[str, Any] = {}
    for name, (hits, of) in rates.items():
        out[f"none_rate_{name}"] = hits / max(1, of)
        out[f"none_rate_{name}_interval"] = share_interval(hits, of)
    out["none_rate_by_kind"] = {
        k: {"rate": h / max(1, n), "interval": share_interval(h, n), "patients": n}
        for k in OUTSIDE_KINDS
        for h, n in [told([m for m in outside if m.truth == k])]
    }
    return out


def _severity(met: list[Met]) -> dict[str, Any]:
    rows = [(m.spastic or m.dystonic, m.severity["S" if m.spastic else "D"]) for m in met]
    errors = np.array([s["mean"] - t for t, s in rows])
    inside = [s["low"] - 1e-9 <= t <= s["high"] + 1e-9 for t, s in rows]
    return {
        "rms_error": np.sqrt(np.mean(errors**2)),
        "bias": errors.mean(),
        "in_90_interval": np.mean(inside),
        "patients": len(rows),
    }


def _between(met: list[Met], names: tuple[str, ...]) -> dict[str, Any]:
    out = _severity(met)
    rows = []
    for m in met:
        level = m.spastic or m.dystonic
        what, p = ("S" if m.spastic else "D"), final(m)
        rungs = [d[1] for d in map(disorder_of, names) if d is not None and d[0] == what]
        low, high = max(x for x in rungs if x <= level), min(x for x in rungs if x >= level)
        on = sum(float(p[names.index(f"{what}{x:g}")]) for x in {low, high})
        rows.append((on, p.max(), p[-1]))
    means = np.mean(rows, axis=0)
    return out | dict(zip(("on_both_neighbours", "highest", "none"), means, strict=True))


def _mixed(
    alone: list[Met], pairs: list[Met], names: tuple[str, ...], data: ResponseDataBase
) -> dict[str, Any]:
    with_pairs = assessed_hypotheses(data, mixed=True).names
    said = [names[int(final(m).argmax())] for m in alone]
    found = [with_pairs[int(final(m).argmax())].split("+") for m in pairs]
    exact, near = [], []
    for f, m in zip(found, pairs, strict=True):
        exact.append(sorted(f) == sorted(m.truth.split("+")))
        levels = {x[0]: float(x[1:]) for x in f} if len(f) == 2 else {}
        off = abs(levels.get("S", np.inf) - m.spastic), abs(levels.get("D", np.inf) - m.dystonic)
        near.append(max(off) <= 1)
    return {
        "patients": len(alone),
        "without_mixtures_none": np.mean([s == NONE for s in said]),
        "without_mixtures_spastic": np.mean([s[0] == "S" for s in said]),
        "with_mixtures_both": np.mean([len(f) == 2 for f in found]),
        "with_mixtures_exact": np.mean(exact),
        "with_mixtures_both_within_one": np.mean(near),
    }


def table(result: dict[str, Any]) -> list[str]:
    def ends(key: str, form: str = "{:.2f}") -> str:
        low, high = result[f"{key}_interval"]
        return f"{form.format(result[key])} ({form.format(low)} to {form.format(high)})"

    out = [
        f"{result['patients']['inside']} simulated patients, after {MOVEMENTS} movements:",
        f"  category right        {result['accuracy']:.2f}",
        f"  log score             {result['log_score']:.2f}",
        f"  calibration error     {ends('calibration_error', '{:.3f}')}, aim at most 0.05",
        f"  none of these         {ends('none_rate_outside')} of others, aim at least 0.9",
        f"                        {ends('none_rate_inside')} of patients, aim at most 0.05",
        "movements to 95 %:",
    ]
    out += [
        f"  {w:<10} {m['mean']:5.1f} ({m['interval'][0]:.1f} to {m['interval'][1]:.1f}), "
        f"{m['never']:.0%} not within {MOST}"
        for w, m in result["motions"].items()
    ]
    if "motions_ratio" in result:
        out.append(f"  against random        {ends('motions_ratio')}, aim at most 0.5")
    return out
