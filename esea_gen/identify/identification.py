"""From a mapping file to a device file and a report."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.device import Device
from esea_gen.identify.device_file import marked_toml, write_marked
from esea_gen.identify.drafting import draft, fitted_device, sourced_device
from esea_gen.identify.fit import Fit, Progress, search
from esea_gen.identify.mapping import MappingFile, load_mapping
from esea_gen.identify.notes import notes_of
from esea_gen.identify.parameters import at_bound, bounds_of
from esea_gen.identify.plant import FittedPlant
from esea_gen.identify.recording import Recording, load_recordings
from esea_gen.identify.space import Space
from esea_gen.identify.uncertainty import Uncertainty, uncertainty
from esea_gen.identify.verdict import Verdict, judge
from esea_gen.language.ports import Array, unit_of
from esea_gen.model.elastomer import MODEL_KEYS, RATE_KEYS

FIT_RATE_HZ = 100.0


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
            "rate_terms": self.device.elastomer.maxwell is not None,
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
            **self._errors(self.verdict),
            "without_rate_terms": None
            if self.without_rate is None
            else self._errors(self.without_rate),
            "notes": list(self.notes),
        }

    def _errors(self, verdict: Verdict) -> dict[str, Any]:
        sets = [
            {
                "label": s.label,
                "amplitude_rad": s.amplitude_rad,
                "cycles": dict(sorted(s.cycles.items())),
                **errors,
                "asymmetry": s.asymmetry,
                "work_first_J": s.work_first_J,
                "work_last_J": s.work_last_J,
                "softening": s.softening,
            }
            for s, errors in verdict.misfits.rows(self.full_scale_Nm)
        ]
        return {"sets": sets, "mean_rms": verdict.misfits.means(self.full_scale_Nm)}

    def summary(self) -> list[str]:
        """A few lines for the terminal: fit on training and held-out cycles, notes."""
        lines = [f"{self.device.title}: fit in % of full scale ({self.full_scale_Nm:g} Nm), RMS"]
        misfits = self.verdict.misfits
        width = max(len(s.label) for s, _, _ in misfits.sets)
        for s, trained, held in misfits.sets:
            cells = [
                f"{what} {100 * e.rms / self.full_scale_Nm:5.2f} %"
                for what, e in (("training", trained), ("held out", held))
                if e
            ]
            lines.append(f"  {s.label:{width}}  {', '.join(cells)}")
        means = misfits.means(self.full_scale_Nm)
        lines.append(
            f"  {'mean':{width}}  training {means['training_percent']:5.2f} %, "
            f"held out {means['held_out_percent']:5.2f} %"
        )
        return lines + [f"note: {note}" for note in self.notes]

    def toml(self) -> str:
        """The device file, its first line saying that it is ours and unchanged."""
        return marked_toml(self.device)

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
        write_marked(self.device, path, overwrite)
        return path


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

    template = draft(source, recordings, rate_terms)
    bare = draft(source, recordings, False)
    if not rate_terms:
        fit, plant, device, verdict = fit_split(source, recordings, bare, tell)
        without = None
    else:
        # The model without rate terms on the same data: does the Maxwell element earn its place?
        _, _, _, without = fit_split(source, recordings, bare, _part(tell, 0.0, 0.1))
        fit, plant, device, verdict = fit_split(
            source, recordings, template, _part(tell, 0.1, 0.95)
        )
    tell(0.95, "uncertainty")
    spread = uncertainty(plant, fit.values)
    device = sourced_device(source, recordings, device, fit, spread)
    notes = notes_of(source, recordings, fit, spread, verdict, without, device.tau_full_scale_Nm)
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


def fit_split(
    source: MappingFile, recordings: list[Recording], template: Device, tell: Progress
) -> tuple[Fit, FittedPlant, Device, Verdict]:
    """Search the thesis' parameters on the training samples, and judge the device's C.

    Parameters
    ----------
    source : MappingFile
        What was asked.
    recordings : list of Recording
        Divided into training and held-out samples.
    template : Device
        Ranges, and whether there are rate terms.
    tell : callable
        As ``progress`` of :func:`identify`.

    Returns
    -------
    tuple of Fit, FittedPlant, Device, Verdict
        Parameters, what they were fitted with, the device, its errors.
    """
    rate_terms = template.elastomer.maxwell is not None
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
        template = draft(source, recordings, False)
    device = fitted_device(source, recordings, template, fit, 0.0)
    plant = FittedPlant(template, recordings, None if rate is None or fit.rate_dropped else rate)
    verdict = judge(device, recordings)
    device = fitted_device(source, recordings, template, fit, verdict.largest_rate_Nm)
    return fit, plant, device, verdict
