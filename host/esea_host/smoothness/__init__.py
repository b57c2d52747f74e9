"""How smooth a movement is: arrays in, results out; needs NumPy and SciPy alone."""

from esea_host.smoothness.chain import Derivatives, derivatives
from esea_host.smoothness.checks import NoAnswerError, steady_rate
from esea_host.smoothness.jerk import dimensionless_jerk, ldlj
from esea_host.smoothness.peaks import peak_speed_ratio, submovements
from esea_host.smoothness.resampling import Resampling, resampled
from esea_host.smoothness.result import Processing, SmoothnessResult
from esea_host.smoothness.sensitivity import Band, sensitivity_band
from esea_host.smoothness.spectral import sparc
from esea_host.smoothness.vibration import rms_acceleration, vdv

__all__ = [
    "Band",
    "Derivatives",
    "NoAnswerError",
    "Processing",
    "Resampling",
    "SmoothnessResult",
    "derivatives",
    "dimensionless_jerk",
    "ldlj",
    "peak_speed_ratio",
    "resampled",
    "rms_acceleration",
    "sensitivity_band",
    "sparc",
    "steady_rate",
    "submovements",
    "vdv",
]
