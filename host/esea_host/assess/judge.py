"""From sessions to the numbers of the evaluation: scores with intervals, and the judgement."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.files import plain
from esea_host.assess.database import ResponseDataBase
from esea_host.assess.evaluation import CONFIDENT, MOST, MOVEMENTS, WAYS, Met
from esea_host.assess.hypotheses import NONE, disorder_of
from esea_host.assess.patients import OUTSIDE_KINDS, Array
from esea_host.assess.session import assessed_hypotheses

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
    return (
        np.bincount(at, confidence, bins) / safe,
        np.bincount(at, right, bins) / safe,
        count,
    )


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
