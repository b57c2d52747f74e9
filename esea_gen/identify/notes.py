"""Notes for the reader of an identification."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from esea_gen.devices.rubber import LEAST_FACTOR
from esea_gen.identify.drafting import largest_torque, scales_assumed
from esea_gen.identify.published.fit import Fit
from esea_gen.identify.published.plant import Uncertainty
from esea_gen.identify.published.space import at_bound
from esea_gen.identify.recording.conditions import (
    LEAST_APART_K,
    at_edge,
    far_apart,
    temperatures_of,
)
from esea_gen.identify.recording.mapping import MappingFile
from esea_gen.identify.recording.recorded import Recording
from esea_gen.identify.recording.resampling import LeftOut, covered
from esea_gen.identify.verdict import Verdict
from esea_gen.model.family import FittedMember
from esea_gen.model.temperature import TemperatureFactor

LEAST_SOFTENING = 0.01  # less is the noise of two loops
ASYMMETRY_LIMIT = 0.05  # share of stiffness; ours, no figure is published
LIKELY = 1.959964  # deviations that hold 95 % of a normal distribution
UNSEEN = {
    "strain": (
        "the largest deflection did not grow",
        "Train from the first cycle (cycles.skip_first = 0), or with growing amplitudes.",
    ),
    "path": ("hardly any path was travelled", "Train over more cycles."),
}
SHARP = 0.5  # a standard deviation above this share of the value is called out


def notes_of(
    source: MappingFile,
    recordings: list[Recording],
    fit: Fit,
    spread: Uncertainty,
    verdict: Verdict,
    pair: tuple[Verdict, Verdict] | None,
) -> Iterator[str]:
    """Notes of the published model; pair: without and with rate terms, where both were fitted."""
    if "kv_Nm_rad" not in fit.values:
        if fit.rate_dropped:
            why = "the fit gave the Maxwell element no stiffness, so it is left out"
        elif pair is not None:
            why = "on held-out data the model without them is as good or better"
        elif not all(r.timed for r in recordings):
            why = "no time was recorded; the sampling period is assumed"
        else:
            why = "the mapping has rate_terms = false"
        yield f"Rate terms not identified: {why}."
    else:
        yield (
            "A, eps1, B and eps2 can all be multiplied by one number without changing the torque: "
            f"eps2 is fixed at {fit.values['eps2']:.4g}, the others are relative to it."
        )
    if "kv_Nm_rad" in fit.values and not all(r.timed for r in recordings):
        yield (
            "The rate terms rest on a sampling period that is only assumed: their parameters are "
            "marked assumed too."
        )
    if pair is not None and not fit.rate_dropped:
        full_scale_Nm = largest_torque(source, recordings)
        a, b = (100 * x.misfits.mean_rms(True) / full_scale_Nm for x in pair)
        helps = "the rate terms help."
        if b >= a:
            helps = "the rate terms do not help, and are left out."
        yield (
            f"Held-out error without the Maxwell element {a:.2f} %, with it {b:.2f} % of full "
            f"scale: {helps} That choice used the held-out data."
        )
    yield from recording_notes(source, recordings)
    yield from specimen_notes(verdict, softens=False)
    yield from temperature_notes(recordings)
    yield from (f"{e[0].upper()}{e[1:]}." for e in fit.edges.values())
    for key, value in fit.values.items():
        bound = None if key == "eps2" else at_bound(key, value)
        sigma = spread.sigma.get(key)
        if bound:
            yield f"{key} = {value:.4g} is at its {bound} bound."
        elif key in spread.moved:
            yield (
                f"{key} = {value:.4g} depends on a bound that was reached and is marked assumed: "
                f"without that bound the optimum moves by {spread.moved[key]:+.2g}, above its "
                f"standard deviation {sigma:.2g}. Check units and scales, or record what "
                "determines the bounded parameter."
            )
        elif sigma is not None and sigma > SHARP * abs(value):
            yield (
                f"{key} = {value:.4g} is poorly determined (standard deviation "
                + (f"{sigma:.2g})." if math.isfinite(sigma) else "infinite).")
            )
    reach = max(float(np.abs(r.theta_rad).max()) for r in recordings)
    if fit.values["omega_rad"] >= reach:
        yield (
            "No stop slips within the recorded deflection: the stops act as a spring, "
            "indistinguishable from k1."
        )
    if fit.values["alpha_Nm_rad"] == 0:
        yield "The stop operators carry no torque: beta and omega have no meaning."


def recording_notes(source: MappingFile, recordings: list[Recording]) -> Iterator[str]:
    """Of the data, whatever the model."""
    if scales_assumed(source):
        yield "The scales from the specimen to a coupling are assumed."
    dropped = sum(r.dropped for r in recordings)
    if dropped:
        yield (
            f"{dropped} of {dropped + sum(len(r.time_s) for r in recordings)} samples dropped by "
            f"sampling.min_step_s = {source.mapping.sampling.min_step_s:g} s."
        )
    for r in recordings:
        if len(r.time_s) > 2:
            steps = np.diff(r.time_s)
            if steps.max() > 10 * np.median(steps):
                yield f"{r.label}: the largest gap between samples is {steps.max():.3g} s."


def band_notes(
    recordings: Sequence[Recording], verdict: Verdict, spread: LeftOut, full_scale_Nm: float
) -> Iterator[str]:
    """How far the torque may be off, by this device's own residuals, and how far it was."""
    error = np.concatenate(
        [(verdict.torque_Nm[r.label] - r.tau_Nm)[s.held_out] for r in recordings for s in r.sets]
    )
    yield (
        f"Torque: 95 % of errors in blocks left out are below {spread.band_Nm:.3g} Nm "
        f"({100 * spread.band_Nm / full_scale_Nm:.2g} % of full scale), as are "
        f"{100 * covered(error, spread.band_Nm):.0f} % of the held-out samples."
    )
    if spread.friction_Nm is not None:
        way = "less" if spread.friction_Nm < 0 else "more"
        yield (
            f"The residuals show {abs(spread.friction_Nm):.3g} Nm {way} friction than the model "
            "has; the standard deviations include its effect."
        )


def specimen_notes(verdict: Verdict, softens: bool) -> Iterator[str]:
    """Of the specimen; softens: whether the model does."""
    sets = [s for s, _, _ in verdict.misfits.sets]
    asymmetries = [s.asymmetry for s in sets if s.asymmetry is not None]
    if not asymmetries:
        yield (
            "Loaded to one side only: asymmetry cannot be judged, and the model's other side is an "
            "assumption."
        )
    else:
        worst = max(asymmetries, key=abs)
        verdict_text = "above" if abs(worst) > ASYMMETRY_LIMIT else "within"
        yield (
            f"Asymmetry: stiffness to the two sides differs by up to {100 * worst:+.1f} %, "
            f"{verdict_text} our limit of {100 * ASYMMETRY_LIMIT:g} % (the thesis discarded "
            "asymmetric specimens; it prints no limit)."
        )
    softening = [s.softening for s in sets if s.softening is not None]
    if softening and max(softening) < LEAST_SOFTENING:
        yield (
            "Mullins effect or scragging: none seen, no block's last cycle loses "
            f"{100 * LEAST_SOFTENING:g} % less work than its first full one."
        )
    elif softening:
        yield (
            f"Mullins effect or scragging: the last cycle of a block loses up to "
            f"{100 * max(softening):.0f} % less work than its first full one; the model has "
            f"{'softening for it' if softens else 'no term for it'}."
        )


def temperature_notes(
    recordings: Sequence[Recording],
    factor: TemperatureFactor | None = None,
    sigma_per_K: float | None = None,
) -> Iterator[str]:
    """Notes on the recordings' temperatures; empty if none was recorded."""
    known = temperatures_of(recordings, training=True)
    if not known:
        return
    if factor is None and far_apart(known):
        yield (
            f"Temperature: the recordings are at {known[0]:g} to {known[-1]:g} degC, and the "
            "published model has no factor of temperature: it takes them for one."
        )
        return
    if factor is None or sigma_per_K is None:
        yield (
            f"Temperature: its effect is not known. Training is at {known[0]:g} to "
            f"{known[-1]:g} degC; two temperatures at least {LEAST_APART_K:g} K apart are needed."
        )
        return
    low, high = (100 * (factor.per_K + side * LIKELY * sigma_per_K) for side in (-1, 1))
    yield (
        f"Temperature: every weight but an offset's changes by {100 * factor.per_K:.3g} % per K "
        f"(95 %: {low:.3g} to {high:.3g}), trained from {known[0]:g} to {known[-1]:g} degC. On the "
        "board temperature_C is the reference until it is set, in every Block that has it."
    )
    edge = at_edge(factor)
    if edge is not None:
        yield (
            f"The change per kelvin is at the {edge} end of its search, beyond which the "
            f"factor would fall below {LEAST_FACTOR:g} between {factor.low_C:g} and "
            f"{factor.high_C:g} degC, or leave the device file's bounds: the rubber's may lie "
            "beyond, and its interval has no meaning."
        )
    elif not low * high > 0:
        yield "The change by temperature cannot be distinguished from zero."


def told_apart_notes(
    fitted: FittedMember, twins: Mapping[int, int], sigma: Mapping[int, float | None]
) -> Iterator[str]:
    """Terms of a member that the training data does not distinguish, and data that would."""
    terms, others = fitted.member.terms, []
    softened: dict[str, int] = {}
    for i, k in twins.items():
        soft = terms[i].softening
        if soft is not None and terms[k].softening is None:
            softened[soft.kind] = softened.get(soft.kind, 0) + 1
        else:
            others.append(f"{terms[i].text} ({terms[k].text})")
    for kind, count in softened.items():
        why, more = UNSEEN[kind]
        yield (
            f"Softening by {kind} is not seen: {why} in the training data. {count} softened "
            f"{'term is' if count == 1 else 'terms are'} indistinguishable from unsoftened ones, "
            f"which carry that torque: the model does not soften by it, the rubber may. {more}"
        )
    if others:
        yield (
            "Not distinguished by the training data; the simpler term in brackets carries the "
            f"torque: {'; '.join(others)}."
        )
    open_ended = [terms[i].text for i, s in sigma.items() if s is not None and not math.isfinite(s)]
    if open_ended:
        yield (
            "Not determined, other weights of these give the same torque in training (standard "
            f"deviation infinite): {'; '.join(open_ended)}."
        )
