"""How the rubber's parameters may lie round the device file's: assumed, or as identified."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.identify.published.plant import ROWS_REFINE, FittedPlant, uncertainty
from esea_gen.identify.published.space import at_bound, bounds_of
from esea_gen.identify.recording.mapping import load_mapping
from esea_gen.identify.recording.reading import load_recordings
from esea_gen.language.ports import Array
from esea_gen.model.elastomer import MODEL_KEYS, RATE_KEYS

ASSUMED_SHARE = 0.05
WEAK = 0.5  # relative spread of a direction that the data do not determine is held to this


@dataclass(frozen=True)
class Spread:
    """How the rubber's parameters may lie round the device file's."""

    keys: tuple[str, ...]
    root: Array
    origin: str
    band_Nm: float | None = None

    @property
    def sigma(self) -> dict[str, float]:
        size = np.sqrt(np.sum(self.root**2, axis=1))
        return {k: float(s) for k, s in zip(self.keys, size, strict=True)}

    def draw(self, device: Device, rng: np.random.Generator) -> tuple[dict[str, float], int]:
        values = elastomer_values(device)
        factor = np.exp(self.root @ rng.standard_normal(self.root.shape[1]))
        clipped = 0
        for key, f in zip(self.keys, factor, strict=True):
            low, high = bounds_of(key)
            value = float(values[key] * f)
            values[key] = min(max(value, low), high)
            clipped += values[key] != value
        return values, clipped


def elastomer_values(device: Device) -> dict[str, float]:
    """The published model's parameters; refused for a device with another."""
    assert device.elastomer
    known = {c.name: c.value for c in device.constants("elastomer")}
    return {k: known[k] for k in (*MODEL_KEYS, *RATE_KEYS) if k in known}


def assumed_spread(device: Device, share: float = ASSUMED_SHARE) -> Spread:
    """Every parameter on its own, by a stated share."""
    keys = tuple(k for k, v in elastomer_values(device).items() if v > 0 and k != "eps2")
    origin = f"assumed: {100 * share:g} % (standard deviation) of each parameter, independent"
    return Spread(keys, share * np.eye(len(keys)), origin)


def identified_spread(device: Device, mapping: Path, data: Path | None = None) -> Spread:
    """The covariance of an identification, recomputed from its recording."""
    source = load_mapping(mapping, data)
    if source.mapping.device.name != device.name:
        raise UserError(
            f"{source.origin}: the recording identified '{source.mapping.device.name}', not "
            f"'{device.name}': its covariance says nothing of this device.",
            "Give the identified device's file, or leave --recording out for an assumed spread.",
        )
    recordings = load_recordings(source)
    reach = max(float(np.abs(r.theta_rad).max()) for r in recordings)
    limit = device.file.limits.theta_rad.value
    if reach > limit:
        raise UserError(
            f"{source.origin}: a recorded deflection of {reach:.3g} rad is above {device.name}'s "
            f"limits.theta_rad = {limit:g} rad.",
            "Give the recording that the device was identified with.",
        )
    rate_terms = device.elastomer.maxwell is not None
    fine = device.file.timing.sense_rate_Hz.value
    plant = FittedPlant(device, recordings, fine if rate_terms else None, ROWS_REFINE)
    values = elastomer_values(device)
    found = uncertainty(plant, values)
    free = [k for k, v in values.items() if k != "eps2" and v > 0 and at_bound(k, v) is None]
    if found.resampled is None or not np.any(np.isfinite([found.sigma[k] or 0.0 for k in free])):
        raise UserError(
            f"{source.origin}: the torque depends on none of the parameters.",
            "Leave --recording out for an assumed spread.",
        )
    variances, v = np.linalg.eigh(found.resampled.covariance)
    # A direction without effect moves nowhere when blocks are left out: it is not known at all.
    dead = variances <= 1e-12 * variances.max()
    sigmas = np.where(dead, np.inf, np.sqrt(np.maximum(variances, 0.0)))
    spread = np.minimum(sigmas, WEAK)
    weak = int(np.sum(sigmas > WEAK))
    held = f"; {weak} directions that it does not determine held to {100 * WEAK:g} %" * (weak > 0)
    origin = f"covariance of the identification by {source.origin}{held}"
    return Spread(tuple(free), v * spread, origin, found.resampled.band_Nm)
