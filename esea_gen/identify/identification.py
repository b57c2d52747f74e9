"""From a mapping file to a device file and a report."""

from __future__ import annotations

import contextlib
import hashlib
import math
import os
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from esea_gen.device import Device, parse_device
from esea_gen.devices.fields import (
    DeviceFile,
    Domain,
    Elastomer,
    Encoder,
    Limits,
    Maxwell,
    Quantity,
    Timing,
    Velocity,
)
from esea_gen.devices.writing import render_toml
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_system
from esea_gen.identify.fit import (
    EPS2_DEFAULT,
    Fit,
    FittedPlant,
    Progress,
    Space,
    Uncertainty,
    at_bound,
    bounds_of,
    search,
    uncertainty,
)
from esea_gen.identify.mapping import MappingFile, load_mapping
from esea_gen.identify.recording import (
    ASYMMETRY_LIMIT,
    MAX_TAU_NM,
    MAX_THETA_RAD,
    DataSet,
    Recording,
    load_recordings,
    resample,
)
from esea_gen.language.ports import unit_of
from esea_gen.model.elastomer import MODEL_KEYS, RATE_KEYS
from esea_gen.model.sensing import sensing_system

Array = npt.NDArray[np.float64]

MARK = "# Written by esea-gen identify."
FIT_RATE_HZ = 100.0
SHARP = 0.5  # a standard deviation above this share of the value is called out


@dataclass(frozen=True)
class FitErrors:
    """Torque errors of one data set.

    Parameters
    ----------
    rms_Nm, max_Nm : float
        Root mean square and largest magnitude.
    """

    rms_Nm: float
    max_Nm: float

    @classmethod
    def of(cls, error: Array) -> FitErrors | None:
        """Of an error signal; None for an empty one.

        Parameters
        ----------
        error : ndarray
            Error of every sample, in Nm.

        Returns
        -------
        Errors or None
            Its RMS and largest value.
        """
        if not len(error):
            return None
        return cls(float(np.sqrt(np.mean(error**2))), float(np.abs(error).max()))

    def to_dict(self, full_scale_Nm: float) -> dict[str, float]:
        """In Nm and in % of full scale.

        Parameters
        ----------
        full_scale_Nm : float
            What counts as 100 %.

        Returns
        -------
        dict of str to float
            JSON-ready content.
        """
        return {
            "rms_Nm": self.rms_Nm,
            "rms_percent": 100 * self.rms_Nm / full_scale_Nm,
            "max_Nm": self.max_Nm,
            "max_percent": 100 * self.max_Nm / full_scale_Nm,
        }


@dataclass(frozen=True)
class Verdict:
    """What the device's C makes of the recordings.

    Parameters
    ----------
    sets : tuple
        (data set, errors in training, errors held out), in order.
    torque_Nm : dict of str to ndarray
        Model torque at the samples of each recording.
    largest_rate_Nm : float
        Largest |torque| of the Maxwell element.
    """

    sets: tuple[tuple[DataSet, FitErrors | None, FitErrors | None], ...]
    torque_Nm: dict[str, Array]
    largest_rate_Nm: float

    def mean_rms_Nm(self, held_out: bool) -> float:
        """Mean over data sets of the RMS error, the published figure of merit.

        Parameters
        ----------
        held_out : bool
            Of the held-out cycles; else of the training ones.

        Returns
        -------
        float
            The mean, in Nm.
        """
        found = [e[2] if held_out else e[1] for e in self.sets]
        return float(np.mean([e.rms_Nm for e in found if e is not None]))


@dataclass(frozen=True)
class Identification:
    """Result of an identification.

    Parameters
    ----------
    device : Device
        Identified device, its parameters of status ``identified``.
    source : MappingFile
        What was asked.
    recordings : tuple of Recording
        Data.
    fit, spread : Fit, Uncertainty
        Parameters and what is known of them.
    verdict : Verdict
        Errors of the device's C.
    without_rate : Verdict, optional
        The same for the best model without Maxwell element, where one was asked for.
    notes : tuple of str
        What the reader must know.
    seconds : float
        Time taken; not part of :meth:`to_dict`, which is the same every time.
    """

    device: Device
    source: MappingFile
    recordings: tuple[Recording, ...]
    fit: Fit
    spread: Uncertainty
    verdict: Verdict
    without_rate: Verdict | None
    notes: tuple[str, ...]
    seconds: float = field(compare=False)

    @property
    def full_scale_Nm(self) -> float:
        """Torque that counts as 100 %."""
        return self.device.tau_full_scale_Nm

    @property
    def series(self) -> dict[str, dict[str, Array]]:
        """Per recording: ``time_s``, ``theta_rad``, ``tau_Nm``, ``tau_model_Nm``, ``role``.

        ``role`` is 1 in training, 2 in held-out and 0 in other samples.
        """
        out = {}
        for r in self.recordings:
            role = np.zeros(len(r.time_s))
            for s in r.sets:
                role[s.training] = 1
                role[s.held_out] = 2
            out[r.label] = {
                "time_s": r.time_s,
                "theta_rad": r.theta_rad,
                "tau_Nm": r.tau_Nm,
                "tau_model_Nm": self.verdict.torque_Nm[r.label],
                "role": role,
            }
        return out

    def to_dict(self) -> dict[str, Any]:
        """Report, JSON-ready and the same for the same input.

        Returns
        -------
        dict
            Parameters with standard deviation and bounds, errors per data set, notes.
        """
        fs = self.full_scale_Nm
        parameters = {}
        for key in (*MODEL_KEYS, *RATE_KEYS):
            if key not in self.fit.values:
                continue
            low, high = bounds_of(key)
            sigma = self.spread.sigma.get(key)
            parameters[key] = {
                "value": self.fit.values[key],
                "unit": unit_of(key),
                "sigma": sigma if sigma is not None and math.isfinite(sigma) else None,
                "fixed": key == "eps2",
                "at_bound": None if key == "eps2" else at_bound(key, self.fit.values[key]),
                "low": low,
                "high": high,
            }
        q = dict(self.device.quantities())
        return {
            "device": {"name": self.device.name, "title": self.device.title},
            "mapping": self.source.origin,
            "full_scale_Nm": fs,
            "rate_terms": self.device.file.elastomer.maxwell is not None,
            "parameters": parameters,
            "uncertainty": {
                "assumes": "right model form, first-order autoregressive residuals",
                "correlation_factor": self.spread.correlation_factor,
                "weakest": self.spread.weakest,
            },
            "domain": {
                k: q[f"domain.{k}"].value for k in type(self.device.file.domain).model_fields
            },
            "search": {
                "fitness": "mean over data sets of the mean square error",
                "seed": self.source.mapping.search.seed,
                "population": self.fit.population,
                "evaluations": self.fit.evaluations,
                "runner_up": self.fit.runner_up if math.isfinite(self.fit.runner_up) else None,
            },
            "recordings": [
                {
                    "label": r.label,
                    "file": r.file,
                    "sha256": r.digest,
                    "samples": len(r.time_s),
                    "dropped": r.dropped,
                    "timed": r.timed,
                    "duration_s": float(r.time_s[-1]),
                }
                for r in self.recordings
            ],
            "sets": self._sets(self.verdict),
            "mean_rms": self._means(self.verdict),
            "without_rate_terms": None
            if self.without_rate is None
            else {
                "sets": self._sets(self.without_rate),
                "mean_rms": self._means(self.without_rate),
            },
            "notes": list(self.notes),
        }

    def _means(self, verdict: Verdict) -> dict[str, float]:
        out = {}
        for name, held_out in (("training", False), ("held_out", True)):
            rms = verdict.mean_rms_Nm(held_out)
            out[f"{name}_Nm"] = rms
            out[f"{name}_percent"] = 100 * rms / self.full_scale_Nm
        return out

    def _sets(self, verdict: Verdict) -> list[dict[str, Any]]:
        fs = self.full_scale_Nm
        return [
            {
                "label": s.label,
                "amplitude_rad": s.amplitude_rad,
                "cycles": dict(sorted(s.cycles.items())),
                "training": trained.to_dict(fs) if trained else None,
                "held_out": held.to_dict(fs) if held else None,
                "asymmetry": s.asymmetry,
                "work_first_J": s.work_first_J,
                "work_last_J": s.work_last_J,
                "softening": s.softening,
            }
            for s, trained, held in verdict.sets
        ]

    def summary(self) -> list[str]:
        """A few lines for the terminal: fit on training and held-out cycles, notes."""
        lines = [f"{self.device.title}: fit in % of full scale ({self.full_scale_Nm:g} Nm), RMS"]
        width = max(len(s.label) for s, _, _ in self.verdict.sets)
        for s, trained, held in self.verdict.sets:
            cells = [
                f"{what} {100 * e.rms_Nm / self.full_scale_Nm:5.2f} %"
                for what, e in (("training", trained), ("held out", held))
                if e
            ]
            lines.append(f"  {s.label:{width}}  {', '.join(cells)}")
        means = self._means(self.verdict)
        lines.append(
            f"  {'mean':{width}}  training {means['training_percent']:5.2f} %, "
            f"held out {means['held_out_percent']:5.2f} %"
        )
        return lines + [f"note: {note}" for note in self.notes]

    def toml(self) -> str:
        """The device file, its first line saying that it is ours and unchanged."""
        body = render_toml(self.device.file)
        return (
            f"{MARK}  Content {_digest(body)}; once changed by hand it is not overwritten.\n{body}"
        )

    def write(self, folder: str | Path, *, overwrite: bool = False) -> Path:
        """Write ``<name>.toml``, whole or not at all.

        Parameters
        ----------
        folder : str or Path
            Made when missing.
        overwrite : bool
            Also replace a file that this program did not write, or that was changed since.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        UserError
            When the file may not be overwritten, or cannot be written.
        """
        path = Path(folder) / f"{self.device.name}.toml"
        text = self.toml()
        read_back = parse_device(text, path.name)
        if read_back.canonical() != self.device.canonical():
            raise RuntimeError(f"{path.name} does not read back to what was identified")
        try:
            if path.exists() and not overwrite and not _ours(path):
                raise UserError(
                    f"'{path}' exists and was not written by esea-gen identify, or was changed by "
                    "hand since.",
                    "Choose another folder or device.name, or allow overwriting.",
                )
            path.parent.mkdir(parents=True, exist_ok=True)
            handle, partial = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
            try:
                with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as out:
                    out.write(text)
                # mkstemp makes it private; a device file is read by everybody.
                os.chmod(partial, 0o644)
                os.replace(partial, path)
            except BaseException:
                with contextlib.suppress(OSError):
                    os.unlink(partial)
                raise
        except OSError as error:
            raise UserError(
                f"'{path}' cannot be written ({error.strerror}).", "Choose another folder."
            ) from None
        return path


def _digest(body: str) -> str:
    return hashlib.sha256(body.encode()).hexdigest()[:16]


def _ours(path: Path) -> bool:
    try:
        first, _, body = path.read_text(encoding="utf-8").partition("\n")
    except UnicodeDecodeError:
        return False
    return first.startswith(MARK) and _digest(body) in first


def identify(
    mapping_path: str | Path,
    data_folder: str | Path | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Identify a device from recordings.

    Parameters
    ----------
    mapping_path : str or Path
        Mapping file, TOML.
    data_folder : str or Path, optional
        Folder of the recordings; the mapping file's own when not given.
    progress : callable, optional
        ``progress(share, text)``: share done, from 0 to 1, and what goes on.

    Returns
    -------
    Identification
        Device, errors on training and held-out cycles, uncertainty, notes.

    Raises
    ------
    UserError
        For anything wrong in the mapping file or the recordings.
    """
    begun = time.monotonic()
    tell: Progress = progress or (lambda share, text: None)
    tell(0.0, "reading")
    source = load_mapping(mapping_path, data_folder)
    recordings = load_recordings(source)
    rate_terms = source.mapping.device.rate_terms

    template = _template(source, recordings, rate_terms)
    bare = _template(source, recordings, False)
    if not rate_terms:
        fit, plant, device, verdict = _fit(source, recordings, bare, tell)
        without = None
    else:
        # The model without rate terms on the same data: does the Maxwell element earn its place?
        _, _, _, without = _fit(source, recordings, bare, _part(tell, 0.0, 0.1))
        fit, plant, device, verdict = _fit(source, recordings, template, _part(tell, 0.1, 0.95))
    tell(0.95, "uncertainty")
    spread = uncertainty(plant, fit.values)
    device = _with_sources(source, recordings, device, fit, spread)
    notes = _notes(source, recordings, fit, spread, verdict, without, device.tau_full_scale_Nm)
    tell(1.0, "done")
    return Identification(
        device=device,
        source=source,
        recordings=tuple(recordings),
        fit=fit,
        spread=spread,
        verdict=verdict,
        without_rate=without,
        notes=notes,
        seconds=time.monotonic() - begun,
    )


def _part(tell: Progress, low: float, high: float) -> Progress:
    return lambda share, text: tell(low + (high - low) * share, text)


def _fit(
    source: MappingFile, recordings: list[Recording], template: Device, tell: Progress
) -> tuple[Fit, FittedPlant, Device, Verdict]:
    rate_terms = template.file.elastomer.maxwell is not None
    rate = None
    if rate_terms:
        fine = source.mapping.device.sense_rate_Hz.value
        rate = source.mapping.sampling.fit_rate_Hz or min(FIT_RATE_HZ, fine)
        rate = fine / max(1, round(fine / rate))
    space = Space(
        rate_terms,
        template.file.domain.theta_max_rad.value,
        template.file.domain.omega_max_rad_s.value,
        max(float(r.time_s[-1]) for r in recordings),
    )
    asked = source.mapping.search
    fit = search(template, recordings, space, rate, tell, asked.seed, asked.population)
    if fit.rate_dropped:
        template = _template(source, recordings, False)
    device = _device(source, recordings, template, fit, 0.0)
    plant = FittedPlant(template, recordings, None if rate is None or fit.rate_dropped else rate)
    verdict = judge(device, recordings)
    device = _device(source, recordings, template, fit, verdict.largest_rate_Nm)
    return fit, plant, device, verdict


def judge(device: Device, recordings: Iterable[Recording]) -> Verdict:
    """Run the device's C, as it ships, over recordings and compare at their own samples.

    Parameters
    ----------
    device : Device
        What is judged: its velocity estimate and torque sensor, at its own rate.
    recordings : iterable of Recording
        Data; the deflection is interpolated linearly to the device's rate.

    Returns
    -------
    Verdict
        Errors by data set, model torque by recording.
    """
    task = compile_system(sensing_system(device, device.velocity, device.sensor), "f64").task(
        "sense"
    )
    sets, torque, largest = [], {}, 0.0
    for r in recordings:
        grid = np.arange(math.ceil(r.time_s[-1] / device.period_s) + 1) * device.period_s
        task.reset()
        out, _ = task.run({"theta_rad": resample(r.time_s, r.theta_rad, grid)}, trace=False)
        model = resample(grid, np.asarray(out["tau_Nm"], dtype=np.float64), r.time_s)
        torque[r.label] = model
        largest = max(largest, float(np.abs(out["tau_rate_Nm"]).max()))
        error = model - r.tau_Nm
        sets += [
            (s, FitErrors.of(error[s.training]), FitErrors.of(error[s.held_out])) for s in r.sets
        ]
    return Verdict(tuple(sets), torque, largest)


# -- building the device -------------------------------------------------------------------------


def _round_up(x: float) -> float:
    digit = 10.0 ** (math.floor(math.log10(x)) - 1)
    return float(f"{math.ceil(x / digit - 1e-9) * digit:.6g}")


def _scales(source: MappingFile) -> str:
    m = source.mapping
    used = [q for q in (m.deflection.scale_rad_per_m, m.torque.scale_Nm_per_N) if q is not None]
    return "; scales assumed" if any(q.status == "assumed" for q in used) else ""


def _files(recordings: list[Recording], only_training: bool = True) -> str:
    names = [
        r.file for r in recordings if not only_training or any(len(s.training) for s in r.sets)
    ]
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"


def _template(source: MappingFile, recordings: list[Recording], rate_terms: bool) -> Device:
    """A device whose ranges hold the recordings, with parameters yet to be found."""
    m = source.mapping
    d = m.device
    where = f"{_files(recordings)} ({source.origin}{_scales(source)})"
    trained = [(r, s) for r in recordings for s in r.sets if len(s.training)]
    theta = max(float(np.abs(r.theta_rad[s.training]).max()) for r, s in trained)
    reach = max(float(np.abs(r.theta_rad).max()) for r in recordings)
    timed = all(r.timed for r in recordings)
    omega = min(100.0, max([1e-3, *(_rate(r, s) for r, s in trained)]))
    full = m.full_scale_Nm or Quantity(
        value=max(float(np.abs(r.tau_Nm).max()) for r in recordings),
        status="identified",
        source=f"largest |torque| of {_files(recordings, False)} "
        f"({source.origin}{_scales(source)})",
    )
    largest = max([full.value, *(float(np.abs(r.tau_Nm).max()) for r in recordings)])

    def trial(value: float) -> Quantity:
        return Quantity(value=value, status="identified", source="start of the search")

    def factor(value: float, high: float, what: str) -> Quantity:
        text = f"device.limit_factor {d.limit_factor:g} of {source.origin} over {what}"
        return Quantity(
            value=min(high, _round_up(d.limit_factor * value)), status="assumed", source=text
        )

    maxwell = Maxwell(
        kv_Nm_rad=trial(1.0),
        A_Nms_rad=trial(1.0),
        m=trial(1.0),
        eps1_Nms_rad=trial(0.1),
        B=trial(1.0),
        n=trial(0.5),
        eps2=trial(EPS2_DEFAULT),
    )
    domain_omega = Quantity(
        value=omega,
        status="identified" if timed else "assumed",
        source=f"largest rate in training, {where}"
        + ("" if timed else "; sampling period assumed, no rate terms depend on it"),
    )
    file = DeviceFile(
        schema=1,
        name=d.name,
        title=d.title,
        elastomer=Elastomer(
            k1_Nm_rad=trial(1.0),
            k3_Nm_rad3=trial(1.0),
            alpha_Nm_rad=trial(1.0),
            beta_1_rad=trial(1.0),
            omega_rad=trial(0.01),
            stops=d.stops,
            maxwell=maxwell if rate_terms else None,
        ),
        domain=Domain(
            theta_max_rad=Quantity(
                value=max(1e-3, theta),
                status="identified",
                source=f"largest |deflection| in training, {where}",
            ),
            omega_max_rad_s=domain_omega,
            tau_full_scale_Nm=full,
        ),
        limits=Limits(
            theta_rad=factor(max(reach, 1e-3), MAX_THETA_RAD, "the largest recorded |deflection|"),
            omega_rad_s=Quantity(
                value=max(25.0, _round_up(d.limit_factor * omega)),
                status="assumed",
                source="25 rad/s as the shipped elbow, or device.limit_factor over the domain",
            ),
            tau_Nm=factor(max(largest, 1e-2), 2 * MAX_TAU_NM, "the largest recorded |torque|"),
        ),
        timing=Timing(sense_rate_Hz=d.sense_rate_Hz),
        velocity=Velocity(bandwidth_Hz=d.bandwidth_Hz),
        encoder=Encoder(resolution_bits=d.resolution_bits),
    )
    return Device(file, source.origin)


def _rate(r: Recording, s: DataSet) -> float:
    """Largest rate in training, over 20 ms and five samples, so that one count is no rate."""
    step = float(np.median(np.diff(r.time_s)))
    span = min(max(5, round(0.02 / step)), len(r.theta_rad) - 1)
    speed = np.abs(r.theta_rad[span:] - r.theta_rad[:-span]) / (r.time_s[span:] - r.time_s[:-span])
    return float(speed[np.clip(s.training - span // 2, 0, len(speed) - 1)].max())


def _device(
    source: MappingFile,
    recordings: list[Recording],
    template: Device,
    fit: Fit,
    largest_rate_Nm: float,
) -> Device:
    """The template with the fitted parameters and a torque limit that holds the model."""
    file = template.file
    where = f"{_files(recordings)} ({source.origin}{_scales(source)})"

    def put(section: Any) -> Any:
        return section.model_copy(
            update={
                k: Quantity(value=fit.values[k], status="identified", source=where)
                for k in type(section).model_fields
                if k in fit.values
            }
        )

    elastomer = put(file.elastomer)
    if elastomer.maxwell is not None:
        elastomer = elastomer.model_copy(update={"maxwell": put(elastomer.maxwell)})
    v, theta = fit.values, file.limits.theta_rad.value
    spring = v["k1_Nm_rad"] * theta + v["k3_Nm_rad3"] * theta**3
    radii = [v["omega_rad"] * (i + 1) for i in range(int(elastomer.stops.value))]
    stops = sum(
        v["alpha_Nm_rad"] * math.exp(-v["beta_1_rad"] * r) * min(r, 2 * theta) for r in radii
    )
    reach = spring + stops + source.mapping.device.limit_factor * largest_rate_Nm
    limit = file.limits.tau_Nm
    if reach > limit.value:
        limit = Quantity(
            value=min(2 * MAX_TAU_NM, _round_up(reach)),
            status="assumed",
            source="the model's torque at the deflection limit",
        )
    update = {
        "elastomer": elastomer,
        "limits": file.limits.model_copy(update={"tau_Nm": limit}),
    }
    return Device(file.model_copy(update=update), template.origin)


def _with_sources(
    source: MappingFile, recordings: list[Recording], device: Device, fit: Fit, spread: Uncertainty
) -> Device:
    """Parameters that say where they come from and how sure they are; then the usual checks."""
    where = f"{_files(recordings)} ({source.origin}{_scales(source)})"

    def describe(key: str) -> str:
        if key == "eps2":
            return "fixed: A, eps1, B and eps2 may all be multiplied by one number"
        bound = at_bound(key, fit.values[key])
        if bound:
            return f"{where}; at its {bound} bound"
        sigma = spread.sigma.get(key)
        if sigma is None or not math.isfinite(sigma):
            return f"{where}; the torque does not depend on it"
        return f"{where}; standard deviation {sigma:.2g}"

    def put(section: Any) -> Any:
        return section.model_copy(
            update={
                k: Quantity(
                    value=fit.values[k],
                    status="assumed" if k == "eps2" else "identified",
                    source=describe(k),
                )
                for k in type(section).model_fields
                if k in fit.values
            }
        )

    elastomer = put(device.file.elastomer)
    if elastomer.maxwell is not None:
        elastomer = elastomer.model_copy(update={"maxwell": put(elastomer.maxwell)})
    file = device.file.model_copy(update={"elastomer": elastomer})
    return parse_device(render_toml(file), f"{file.name}.toml")


# -- notes ---------------------------------------------------------------------------------------


def _notes(
    source: MappingFile,
    recordings: list[Recording],
    fit: Fit,
    spread: Uncertainty,
    verdict: Verdict,
    without: Verdict | None,
    full_scale_Nm: float,
) -> tuple[str, ...]:
    notes = []
    m = source.mapping
    if "kv_Nm_rad" not in fit.values:
        if fit.rate_dropped:
            why = "the fit gave the Maxwell element no stiffness, so it is left out"
        elif not all(r.timed for r in recordings):
            why = "no time was recorded; the sampling period is assumed"
        else:
            why = "the mapping has rate_terms = false"
        notes.append(f"Rate terms not identified: {why}.")
    else:
        notes.append(
            "A, eps1, B and eps2 can all be multiplied by one number without changing the torque: "
            f"eps2 is fixed at {fit.values['eps2']:.4g}, the others are relative to it."
        )
    if without is not None and not fit.rate_dropped:
        a, b = (100 * x.mean_rms_Nm(True) / full_scale_Nm for x in (without, verdict))
        notes.append(
            f"Held-out error without the Maxwell element {a:.2f} %, with it {b:.2f} % of full "
            "scale: " + ("the rate terms help." if b < a else "the rate terms do not help.")
        )
    if _scales(source):
        notes.append("The scales from the specimen to a coupling are assumed.")
    dropped = sum(r.dropped for r in recordings)
    if dropped:
        notes.append(
            f"{dropped} of {dropped + sum(len(r.time_s) for r in recordings)} samples dropped by "
            f"sampling.min_step_s = {m.sampling.min_step_s:g} s."
        )
    for r in recordings:
        if len(r.time_s) > 2:
            steps = np.diff(r.time_s)
            if steps.max() > 10 * np.median(steps):
                notes.append(f"{r.label}: the largest gap between samples is {steps.max():.3g} s.")
    notes += _specimen_notes(verdict)
    notes += [f"{e[0].upper()}{e[1:]}." for e in fit.edges]
    for key, value in fit.values.items():
        bound = None if key == "eps2" else at_bound(key, value)
        sigma = spread.sigma.get(key)
        if bound:
            notes.append(f"{key} = {value:.4g} is at its {bound} bound.")
        elif sigma is not None and sigma > SHARP * abs(value):
            notes.append(
                f"{key} = {value:.4g} is poorly determined (standard deviation "
                + (f"{sigma:.2g})." if math.isfinite(sigma) else "infinite).")
            )
    reach = max(float(np.abs(r.theta_rad).max()) for r in recordings)
    if fit.values["omega_rad"] >= reach:
        notes.append(
            "No stop slips within the recorded deflection: the stops are a spring there, not to be "
            "told from k1."
        )
    if fit.values["alpha_Nm_rad"] == 0:
        notes.append("The stop operators carry no torque: beta and omega mean nothing.")
    return tuple(notes)


def _specimen_notes(verdict: Verdict) -> list[str]:
    notes = []
    sets = [s for s, _, _ in verdict.sets]
    asymmetries = [s.asymmetry for s in sets if s.asymmetry is not None]
    if not asymmetries:
        notes.append(
            "Loaded to one side only: asymmetry cannot be judged, and the model's other side is an "
            "assumption."
        )
    else:
        worst = max(asymmetries, key=abs)
        verdict_text = "above" if abs(worst) > ASYMMETRY_LIMIT else "within"
        notes.append(
            f"Asymmetry: stiffness to the two sides differs by up to {100 * worst:+.1f} %, "
            f"{verdict_text} our limit of {100 * ASYMMETRY_LIMIT:g} % (the thesis discarded "
            "asymmetric specimens; it prints no limit)."
        )
    softening = [s.softening for s in sets if s.softening is not None]
    if softening:
        notes.append(
            f"Mullins effect or scragging: the last cycle of a block loses up to "
            f"{100 * max(softening):.0f} % less work than its first full one; the model has no "
            "term for it."
        )
    return notes
