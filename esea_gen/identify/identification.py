"""From a mapping file to a device file and a report."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from esea_gen.identify.drafting import draft, fit_split, published_channels, sourced_device
from esea_gen.identify.identified import Identified, excused_of, gate_notes, gated
from esea_gen.identify.notes import band_notes, notes_of
from esea_gen.identify.published.fit import Fit, Progress, part_of
from esea_gen.identify.published.plant import Uncertainty, uncertainty
from esea_gen.identify.published.search_problem import Searching
from esea_gen.identify.published.space import at_bound, bounds_of
from esea_gen.identify.recording.channels import settled
from esea_gen.identify.recording.mapping import load_mapping
from esea_gen.identify.verdict import Verdict, worth_of
from esea_gen.language.ports import unit_of
from esea_gen.model.elastomer import MODEL_KEYS, RATE_KEYS


@dataclass(frozen=True, kw_only=True)
class Identification(Identified):
    """Result of an identification of the published model.

    Parameters
    ----------
    fit, spread : Fit, Uncertainty
        Parameters and what is known of them.
    without_rate : Verdict, optional
        Errors of the best model without Maxwell element, where one was asked for and kept.
    with_rate : Verdict, optional
        Errors of the best model with one, where it was not better on held-out data: left out.
    device, source, recordings, verdict, notes, worth, channels
        As in :class:`~esea_gen.identify.identified.Identified`.
    """

    fit: Fit
    spread: Uncertainty
    without_rate: Verdict | None
    with_rate: Verdict | None = None

    def to_dict(self) -> dict[str, Any]:
        """Report, JSON-ready and the same for the same input.

        Returns
        -------
        dict
            Parameters with standard deviation and bounds, errors per data set, notes.
        """
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
                "moved_by_bounds": self.spread.moved.get(key),
                "fixed": key == "eps2",
                "at_bound": None if key == "eps2" else at_bound(key, self.fit.values[key]),
                "low": low,
                "high": high,
            }
        without = self.without_rate
        return super().to_dict() | {
            "parameters": parameters,
            "uncertainty": {
                **({} if self.spread.resampled is None else self.spread.resampled.to_dict()),
                "correlation_factor": self.spread.correlation_factor,
                "weakest": self.spread.weakest,
            },
            "search": {
                "fitness": "mean over data sets of the mean square error",
                "method": self.fit.method,
                "seed": self.source.mapping.search.seed,
                "population": self.fit.population,
                "evaluations": self.fit.evaluations,
                "runner_up": self.fit.runner_up if math.isfinite(self.fit.runner_up) else None,
            },
            "without_rate_terms": None if without is None else self.errors(without),
            "with_rate_terms": None if self.with_rate is None else self.errors(self.with_rate),
        }


def identify(
    mapping_path: str | Path,
    data_folder: str | Path | None = None,
    progress: Progress | None = None,
    how: Searching | None = None,
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
    how : Searching, optional
        Which search, on how many cores, kept where, watched by whom; the answer depends on the
        first only.

    Returns
    -------
    Identification
        Device, errors on training and held-out cycles, uncertainty, notes.

    Raises
    ------
    UserError
        For anything wrong in the mapping file or the recordings.
    """
    tell: Progress = progress or (lambda share, text: None)
    tell(0.0, "reading")
    source = load_mapping(mapping_path, data_folder)
    source, recordings, channels = settled(source, lambda s, r: published_channels(s, r, how))
    rate_terms = source.mapping.device.rate_terms
    template = draft(source, recordings, rate_terms)
    bare = draft(source, recordings, False)
    without = with_rate = None
    if not rate_terms:
        fit, plant, device, verdict = fit_split(source, recordings, bare, tell, how)
    else:
        # The model without rate terms on the same data: does the Maxwell element earn its place?
        plain = fit_split(source, recordings, bare, part_of(tell, 0.0, 0.1), how)
        full = fit_split(source, recordings, template, part_of(tell, 0.1, 0.95), how)
        helps = full[3].misfits.mean_rms(True) < plain[3].misfits.mean_rms(True)
        fit, plant, device, verdict = full if helps or full[0].rate_dropped else plain
        if helps or full[0].rate_dropped:
            without = plain[3]
        else:
            with_rate = full[3]
    tell(0.95, "uncertainty")
    spread = uncertainty(plant, fit.values, fit.edges)
    device = sourced_device(source, recordings, device, fit, spread)
    device = gated(device, recordings)
    band, pair = spread.resampled, (without or verdict, with_rate or verdict)
    notes = (
        *gate_notes(recordings, excused_of(device)),
        *(n.note for n in channels),
        *notes_of(source, recordings, fit, spread, verdict, pair if rate_terms else None),
        *(band_notes(recordings, verdict, band, device.tau_full_scale_Nm) if band else ()),
    )
    tell(1.0, "done")
    return Identification(
        device=device,
        source=source,
        recordings=tuple(recordings),
        fit=fit,
        spread=spread,
        verdict=verdict,
        without_rate=without,
        with_rate=with_rate,
        notes=notes,
        worth=worth_of(device, recordings, verdict, band, plant.judged),
        channels=channels,
    )
