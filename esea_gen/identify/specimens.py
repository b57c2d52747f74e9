"""Several specimens from their recordings: one model for all, and how far they agree.

Each ``[[condition]]`` of the mapping is a specimen; its files in their order are the same tests.
The published model is fitted to all specimens together and to each by itself: what one device file
for all costs.  Their torques at the same deflections, way and test make the table of
:mod:`esea_gen.identify.reliability`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.errors import UserError
from esea_gen.identify.drafting import draft
from esea_gen.identify.identification import fit_split
from esea_gen.identify.published.fit import Progress
from esea_gen.identify.published.search_problem import Searching
from esea_gen.identify.recording.mapping import load_mapping
from esea_gen.identify.recording.reading import load_recordings
from esea_gen.identify.recording.recorded import Recording
from esea_gen.identify.reliability import Reliability, reliability
from esea_gen.language.ports import Array

NODES = 9  # deflections at which specimens are compared, each way
INSIDE = 0.9  # of the deflection that all of them reach


@dataclass(frozen=True)
class JointFit:
    """One model for all specimens against one each."""

    title: str
    full_scale_Nm: float
    joint_pct: dict[str, float]  # held-out RMS error of each specimen, % of full scale
    own_pct: dict[str, float]
    agreement: Reliability

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content."""
        fits = {"joint_pct": self.joint_pct, "own_pct": self.own_pct}
        return self.agreement.to_dict() | fits | {"full_scale_Nm": self.full_scale_Nm}

    def table(self) -> list[str]:
        """Lines of text."""
        lines = [
            f"{self.title}: held out, RMS in % of full scale ({self.full_scale_Nm:g} Nm)",
            f"{'specimen':30} one model for all   its own",
        ]
        for name, joint in self.joint_pct.items():
            lines.append(f"{name:30} {joint:17.2f} {self.own_pct[name]:9.2f}")
        return lines + self.agreement.table()


def joint_fit(
    mapping_path: str | Path,
    data_folder: str | Path | None = None,
    progress: Progress | None = None,
    how: Searching | None = None,
) -> JointFit:
    """Fit all specimens of a mapping together and each by itself, and compare their torques."""
    tell: Progress = progress or (lambda share, text: None)
    source = load_mapping(mapping_path, data_folder)
    recordings = load_recordings(source)
    specimens: dict[str, list[Recording]] = {}
    for r in recordings:
        if len(r.conditions) != 1:
            raise UserError(
                f"{source.origin}: {r.file} belongs to {len(r.conditions)} conditions; here each "
                "is a specimen.",
                "Give every specimen one [[condition]] with its files, and no other.",
            )
        specimens.setdefault(r.conditions[0], []).append(r)
    for name, some in specimens.items():
        for what, role in (("train on", "training"), ("hold out", "held_out")):
            if not any(len(getattr(s, role)) for r in some for s in r.sets):
                raise UserError(
                    f"{source.origin}: specimen '{name}' has nothing to {what}.",
                    "Set cycles.hold_out_last = 1, or use = 'train' and 'held_out' for its files.",
                )
    agreement = reliability(torque_table(specimens))
    rate_terms = source.mapping.device.rate_terms
    errors = {}
    for number, (name, some) in enumerate([("", recordings), *specimens.items()]):
        tell(number / (1 + len(specimens)), f"fit of {name or 'all together'}")
        template = draft(source, some, rate_terms)
        _, _, device, verdict = fit_split(source, some, template, lambda share, text: None, how)
        errors[name] = {s.label: b.rms for s, _, b in verdict.misfits.sets if b is not None}
        if not name:
            full_scale = device.tau_full_scale_Nm
    joint, own = {}, {}
    for name, some in specimens.items():
        labels = [s.label for r in some for s in r.sets if s.label in errors[name]]
        joint[name] = 100 * float(np.mean([errors[""][x] for x in labels])) / full_scale
        own[name] = 100 * float(np.mean([errors[name][x] for x in labels])) / full_scale
    return JointFit(source.mapping.device.title, full_scale, joint, own, agreement)


def torque_table(specimens: dict[str, list[Recording]]) -> dict[str, Array]:
    """Torques of each specimen where all were: by test, way and deflection."""
    counts = {len(some) for some in specimens.values()}
    if len(counts) != 1:
        said = ", ".join(f"{n}: {len(some)}" for n, some in specimens.items())
        raise UserError(
            f"Specimens have different numbers of files ({said}).",
            "Give each the same tests in the same order.",
        )
    rows: dict[str, list[Array]] = {n: [] for n in specimens}
    for test in zip(*specimens.values(), strict=True):
        used = [_used(r) for r in test]
        low = INSIDE * max(float(r.theta_rad[i].min()) for r, i in zip(test, used, strict=True))
        high = INSIDE * min(float(r.theta_rad[i].max()) for r, i in zip(test, used, strict=True))
        edges = np.linspace(low, high, NODES + 1)
        for name, r, i in zip(specimens, test, used, strict=True):
            rows[name].append(_means(r, i, edges))
    table = np.stack([np.concatenate(x) for x in rows.values()])
    kept = table[:, np.all(np.isfinite(table), axis=0)]
    return dict(zip(rows, kept, strict=True))


def _used(r: Recording) -> npt.NDArray[np.intp]:
    every = [i for s in r.sets for i in (s.training, s.held_out)]
    return np.sort(np.concatenate(every)).astype(np.intp)


def _means(r: Recording, used: npt.NDArray[np.intp], edges: Array) -> Array:
    # Mean torque between neighbouring edges, on the way up and on the way down.
    way = np.sign(np.gradient(r.theta_rad))[used]
    theta, tau = r.theta_rad[used], r.tau_Nm[used]
    place = np.digitize(theta, edges) - 1
    out = np.full(2 * NODES, np.nan)
    for k, sign in enumerate((1, -1)):
        for node in range(NODES):
            inside = (way == sign) & (place == node)
            if np.any(inside):
                out[k * NODES + node] = tau[inside].mean()
    return out
