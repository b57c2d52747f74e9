"""A fit to recordings, and the identified device number by number: ranges, parameters, sources."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from esea_gen.device import Device, parse_device, with_numbers
from esea_gen.devices.fields import DeviceFile, Domain, Encoder, Limits, Timing, Velocity
from esea_gen.devices.file import render_toml
from esea_gen.devices.numbers import Quantity
from esea_gen.devices.rubber import Elastomer, Maxwell
from esea_gen.identify.published.fit import Fit, Progress, PublishedChannels, search
from esea_gen.identify.published.plant import FittedPlant, Uncertainty
from esea_gen.identify.published.search_problem import Searching
from esea_gen.identify.published.space import EPS2_DEFAULT, Space, at_bound, place_of
from esea_gen.identify.recording.cycles import DataSet
from esea_gen.identify.recording.mapping import MappingFile
from esea_gen.identify.recording.reading import MAX_TAU_NM, MAX_THETA_RAD
from esea_gen.identify.recording.recorded import Recording, training_sets
from esea_gen.identify.verdict import Verdict, judge
from esea_gen.model.elastomer import RATE_KEYS

# Rate of a search or a fit on recordings with time, where the mapping gives none.
FIT_RATE_HZ = 100.0
Status = Literal["identified", "assumed"]  # of a number that was fitted


def identified(value: float, source: str) -> Quantity:
    return Quantity(value=value, status="identified", source=source)


def assumed(value: float, source: str) -> Quantity:
    return Quantity(value=value, status="assumed", source=source)


def grid_rate(source: MappingFile) -> float:
    """Rate at which a member that needs time is fitted, Hz."""
    fine = source.mapping.device.sense_rate_Hz.value
    return source.mapping.sampling.fit_rate_Hz or min(FIT_RATE_HZ, fine)


def round_up(x: float) -> float:
    digit = 10.0 ** (math.floor(math.log10(x)) - 1)
    return float(f"{math.ceil(x / digit - 1e-9) * digit:.6g}")


def scales_assumed(source: MappingFile) -> bool:
    """Whether the scales from specimen to coupling are assumed."""
    m = source.mapping
    used = [q for q in (m.deflection.scale_rad_per_m, m.torque.scale_Nm_per_N) if q is not None]
    return any(q.status == "assumed" for q in used)


def origin_of(source: MappingFile, files: str) -> str:
    said = "; scales assumed" if scales_assumed(source) else ""
    lag = source.mapping.torque.lag_s
    if lag is not None and lag.status == "identified":
        said += f"; lag of {1e3 * lag.value:.3g} ms taken out"
    return f"{files} ({source.origin}{said})"


def files_of(recordings: Sequence[Recording]) -> str:
    """Files that train: the first one's name and the number of others."""
    names = list(dict.fromkeys(r.file for r, _ in training_sets(recordings)))
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"


def largest_torque(source: MappingFile, recordings: Sequence[Recording]) -> float:
    """100 % of errors: the mapping's, or the largest torque in files that train."""
    asked = source.mapping.full_scale_Nm
    if asked:
        return asked.value
    return max(float(np.abs(r.tau_Nm).max()) for r, _ in training_sets(recordings))


def draft(source: MappingFile, recordings: list[Recording], rate_terms: bool) -> Device:
    """A device whose ranges include the recordings, with parameters still to be fitted."""
    m = source.mapping
    d = m.device
    where = origin_of(source, files_of(recordings))
    trained = training_sets(recordings)
    theta = max(float(np.abs(r.theta_rad[s.training]).max()) for r, s in trained)
    reach = max(float(np.abs(r.theta_rad).max()) for r in recordings)
    timed = all(r.timed for r in recordings)
    omega = min(100.0, max([1e-3, *(_rate(r, s) for r, s in trained)]))
    full = m.full_scale_Nm or identified(
        largest_torque(source, recordings), f"largest |torque| of {where}"
    )
    largest = max([full.value, *(float(np.abs(r.tau_Nm).max()) for r in recordings)])

    def started(**values: float) -> dict[str, Quantity]:
        return {k: identified(v, "start of the search") for k, v in values.items()}

    def factor(value: float, high: float, what: str) -> Quantity:
        text = f"device.limit_factor {d.limit_factor:g} of {source.origin} over {what}"
        return assumed(min(high, round_up(d.limit_factor * value)), text)

    viscous = {"A_Nms_rad": 1.0, "m": 1.0, "eps1_Nms_rad": 0.1, "B": 1.0, "n": 0.5}
    maxwell = Maxwell(**started(kv_Nm_rad=1.0, eps2=EPS2_DEFAULT, **viscous))
    springs = {"k1_Nm_rad": 1.0, "k3_Nm_rad3": 1.0, "alpha_Nm_rad": 1.0}
    fastest = f"largest rate in training, {where}"
    untimed = f"{fastest}; sampling period assumed, no rate terms depend on it"
    file = DeviceFile(
        schema=1,
        name=d.name,
        title=d.title,
        elastomer=Elastomer(
            **started(beta_1_rad=1.0, omega_rad=0.01, **springs),
            stops=d.stops,
            dead_zone_rad=m.deflection.dead_zone_rad,
            maxwell=maxwell if rate_terms else None,
        ),
        domain=Domain(
            theta_max_rad=identified(
                max(1e-3, theta), f"largest |deflection| in training, {where}"
            ),
            omega_max_rad_s=identified(omega, fastest) if timed else assumed(omega, untimed),
            tau_full_scale_Nm=full,
        ),
        limits=Limits(
            theta_rad=factor(max(reach, 1e-3), MAX_THETA_RAD, "the largest recorded |deflection|"),
            omega_rad_s=assumed(
                max(25.0, round_up(d.limit_factor * omega)),
                "25 rad/s as the shipped elbow, or device.limit_factor over the domain",
            ),
            tau_Nm=factor(max(largest, 1e-2), 2 * MAX_TAU_NM, "the largest recorded |torque|"),
        ),
        timing=Timing(sense_rate_Hz=d.sense_rate_Hz),
        velocity=Velocity(bandwidth_Hz=d.bandwidth),
        encoder=Encoder(resolution_bits=d.resolution_bits),
    )
    return Device(file, source.origin)


def _rate(r: Recording, s: DataSet) -> float:
    """Largest rate in training, over 20 ms and five samples, so that one count is no rate."""
    step = float(np.median(np.diff(r.time_s)))
    span = min(max(5, round(0.02 / step)), len(r.theta_rad) - 1)
    speed = np.abs(r.theta_rad[span:] - r.theta_rad[:-span]) / (r.time_s[span:] - r.time_s[:-span])
    return float(speed[np.clip(s.training - span // 2, 0, len(speed) - 1)].max())


def fitted_device(
    source: MappingFile,
    recordings: list[Recording],
    template: Device,
    fit: Fit,
    largest_rate_Nm: float,
) -> Device:
    """The template with the fitted parameters and a torque limit that holds the model."""
    file = template.file
    where = origin_of(source, files_of(recordings))
    found = {place_of(k): identified(v, where) for k, v in fit.values.items()}
    v, theta = fit.values, file.limits.theta_rad.value
    spring = v["k1_Nm_rad"] * theta + v["k3_Nm_rad3"] * theta**3
    radii = [v["omega_rad"] * (i + 1) for i in range(int(template.elastomer.stops.value))]
    stops = sum(
        v["alpha_Nm_rad"] * math.exp(-v["beta_1_rad"] * r) * min(r, 2 * theta) for r in radii
    )
    reach = spring + stops + source.mapping.device.limit_factor * largest_rate_Nm
    limit = file.limits.tau_Nm
    if reach > limit.value:
        text = "the model's torque at the deflection limit"
        limit = assumed(min(2 * MAX_TAU_NM, round_up(reach)), text)
    return with_numbers(template, found | {"limits.tau_Nm": limit})


def determined(value: float, sigma: float) -> bool:
    """Whether a fitted number differs from 0 significantly: else it is not called identified."""
    return sigma < abs(value)


def sourced_device(
    source: MappingFile, recordings: list[Recording], device: Device, fit: Fit, spread: Uncertainty
) -> Device:
    """Parameters that say where they come from and how sure they are; then the usual checks."""
    where = origin_of(source, files_of(recordings))
    timed = all(r.timed for r in recordings)

    def described(key: str, value: float) -> Quantity:
        if key == "eps2":
            text = "fixed: A, eps1, B and eps2 may all be multiplied by one number"
            return assumed(value, text)
        bound, sigma = at_bound(key, value), spread.sigma.get(key)
        known = False
        if bound:
            text = f"at its {bound} bound"
        elif key in fit.edges:
            text = fit.edges[key]
        elif sigma is None or not math.isfinite(sigma):
            text = "the torque does not depend on it"
        elif key in spread.moved:
            text = f"depends on a bound that was reached; without it {spread.moved[key]:+.2g}"
        else:
            text, known = f"standard deviation {sigma:.2g}", determined(value, sigma)
        if not timed and key in RATE_KEYS:
            text, known = f"{text}; on an assumed sampling period", False
        return (identified if known else assumed)(value, f"{where}; {text}")

    found = {place_of(k): described(k, v) for k, v in fit.values.items()}
    file = with_numbers(device, found).file
    return parse_device(render_toml(file), f"{file.name}.toml")


def searched(
    source: MappingFile, template: Device, recordings: Sequence[Recording]
) -> tuple[Space, float | None]:
    """Searched parameters, and the rate of the search; the recordings' own without rate terms."""
    rate_terms = template.elastomer.maxwell is not None
    rate = None
    if rate_terms:
        fine = source.mapping.device.sense_rate_Hz.value
        rate = grid_rate(source)
        rate = fine / max(1, round(fine / rate))
    space = Space(
        rate_terms,
        template.file.domain.theta_max_rad.value,
        template.file.domain.omega_max_rad_s.value,
        max(float(r.time_s[-1]) for r in recordings),
    )
    return space, rate


def published_channels(
    source: MappingFile, recordings: list[Recording], how: Searching | None
) -> PublishedChannels:
    """The published model, by which a lag, a backlash or a dead zone is fitted."""
    template = draft(source, recordings, source.mapping.device.rate_terms)
    asked = source.mapping.search
    space, rate = searched(source, template, recordings)
    apart = replace(how or Searching(), resume=None, watch=None)
    return PublishedChannels(template, space, rate, asked.seed, asked.population, apart)


def fit_split(
    source: MappingFile,
    recordings: list[Recording],
    template: Device,
    tell: Progress,
    how: Searching | None = None,
) -> tuple[Fit, FittedPlant, Device, Verdict]:
    """Search the thesis' parameters on the training samples, and judge the device's C."""
    space, rate = searched(source, template, recordings)
    asked = source.mapping.search
    fit = search(template, recordings, space, rate, tell, asked.seed, asked.population, how)
    if fit.rate_dropped:
        template = draft(source, recordings, False)
    device = fitted_device(source, recordings, template, fit, 0.0)
    plant = FittedPlant(template, recordings, None if rate is None or fit.rate_dropped else rate)
    verdict = judge(device, recordings)
    device = fitted_device(source, recordings, template, fit, verdict.largest_rate_Nm)
    return fit, plant, device, verdict
