"""The tables of a mapping file, as they are written."""

from __future__ import annotations

import datetime
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from esea_gen.devices.designed import suited_bandwidth_Hz
from esea_gen.devices.numbers import Quantity
from esea_gen.devices.rubber import COLDEST_C, HOTTEST_C, MAX_DEAD_ZONE_RAD
from esea_gen.tables import TableFormat

BANDWIDTH_SHARE = 0.1  # of the sensing rate, at most
LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
ANGLE = {"rad": 1.0, "mrad": 1e-3, "deg": 0.017453292519943295}
FORCE = {"N": 1.0, "mN": 1e-3, "kN": 1e3, "kgf": 9.80665, "tonf": 9806.65, "lbf": 4.4482216152605}
TORQUE = {"Nm": 1.0, "mNm": 1e-3, "Ncm": 1e-2, "kNm": 1e3}
VOLTAGE = {"V": 1e3, "mV": 1.0, "uV": 1e-3}  # in mV
TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0}
KINDS = LENGTH, ANGLE, FORCE, TORQUE, VOLTAGE, TIME

Use = Literal["cycles", "train", "held_out"]


def _assumed(value: float, why: str) -> Quantity:
    return Quantity(value=value, status="assumed", source=why)


class ToFit(Quantity):
    """A number that the mapping leaves to the fit: ``"fit"``; 0 until then."""


def _to_fit(given: Any) -> Any:
    return ToFit(value=0.0, status="assumed", source="to be fitted") if given == "fit" else given


Fittable = Annotated[Quantity | None, BeforeValidator(_to_fit)]


def _limits(low: float, high: float, text: str, **more: Any) -> Any:
    return Field(description=text, json_schema_extra={"low": low, "high": high}, **more)


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class DeviceTable(_Table):
    """The device file to write."""

    name: str = Field(
        pattern=r"^[a-z][a-z0-9_]{0,14}$",
        description="Name of the device: a lower case letter, then at most 14 of a-z, 0-9 and _.",
    )
    title: str = Field(min_length=1, description="One line for reports.")
    rate_terms: bool = Field(description="Whether to identify the Maxwell element; needs time.")
    stops: Quantity = _limits(
        1, 32, "Number of stop operators.", default=_assumed(10, "default: as many as published")
    )
    sense_rate_Hz: Quantity = _limits(
        50, 10000, "Rate of the sensing task.", default=_assumed(1000.0, "default of identify")
    )
    bandwidth_Hz: Quantity | None = _limits(
        2, 100, "Bandwidth of the velocity estimate; by the encoder if left out.", default=None
    )
    resolution_bits: Quantity = _limits(
        8, 24, "Encoder counts per turn.", default=_assumed(14, "default of identify")
    )
    limit_factor: float = Field(
        default=1.5, ge=1.0, le=10.0, description="Ports' physical ranges over the identified ones."
    )

    @property
    def bandwidth(self) -> Quantity:
        """That of the velocity estimate, as given or as suits encoder and sensing rate."""
        suited = suited_bandwidth_Hz(self.resolution_bits.value)
        suited = min(suited, BANDWIDTH_SHARE * self.sense_rate_Hz.value)
        return self.bandwidth_Hz or _assumed(suited, "default of identify")


class Deflection(_Table):
    """Column of the deflection."""

    column: str = Field(min_length=1, description="Column or variable name.")
    unit: str = Field(description="Unit of the recorded number.")
    sign: Literal[-1, 1] = Field(default=1, description="-1 turns the recording's direction round.")
    scale_rad_per_m: Quantity | None = _limits(
        1e-6, 1e6, "Radians of coupling per metre of specimen (lengths only).", default=None
    )
    zero: Literal["none", "first", "mean", "middle"] = Field(
        default="none", description="What is subtracted: nothing, first value, mean, or mid-range."
    )
    backlash_rad: Fittable = _limits(
        0.0,
        1.0,
        "By how much the deflection turns before the rubber follows, the whole gap; or fit.",
        default=None,
    )
    dead_zone_rad: Fittable = _limits(
        0.0, MAX_DEAD_ZONE_RAD, "Deflection below which there is no torque; or fit.", default=None
    )


class Torque(_Table):
    """Column of the torque."""

    column: str = Field(min_length=1, description="Column or variable name.")
    unit: str = Field(description="Unit of the recorded number.")
    sign: Literal[-1, 1, "fit"] = Field(
        default=1,
        description="-1 turns the recording's direction round; fit: as for a positive stiffness.",
    )
    lag_s: Fittable = _limits(
        -1.0,
        1.0,
        "By how much the torque was recorded later than the deflection; or fit.",
        default=None,
    )
    scale_Nm_per_N: Quantity | None = _limits(
        1e-9, 1e6, "Newton-metres of coupling per newton on the specimen (forces, voltages).",
        default=None,
    )  # fmt: skip
    sensitivity_mV_per_N: Quantity | None = _limits(
        1e-9, 1e6, "Load cell's rated output (mV/V) by excitation (V) over capacity (N); "
        "voltages only.", default=None,
    )  # fmt: skip
    zero: Literal["none", "first", "mean", "middle"] = Field(
        default="none", description="What is subtracted: nothing, first value, mean, or mid-range."
    )


class Temperature(_Table):
    """Column of the rubber's temperature, where files have one."""

    column: str = Field(min_length=1, description="Column or variable name.")
    unit: Literal["C", "K"] = Field(default="C", description="Of that column: degC or kelvin.")


class Sampling(_Table):
    """Time: a column, or a nominal period."""

    time_column: str | None = Field(default=None, min_length=1, description="Column of time.")
    time_unit: str = Field(default="s", description="Unit of that column.")
    period_s: Quantity | None = _limits(
        1e-6, 100, "Sampling period, where there is no time column.", default=None
    )
    min_step_s: float | None = Field(
        default=None,
        gt=0,
        le=10,
        description="Glitch rule: a sample less than this after the last kept one is dropped, "
        "counted and reported.",
    )
    fit_rate_Hz: float | None = Field(
        default=None,
        ge=50,
        le=10000,
        description="Rate of the search (the result is refined and judged at the device's rate).",
    )


class Cycles(_Table):
    """Which cycles condition, train and judge, in every block of equal amplitude."""

    skip_first: int = Field(default=1, ge=0, le=1000, description="Conditioning cycles per block.")
    hold_out: str | None = Field(
        default=None,
        min_length=1,
        description="Condition that judges as a whole: a [[condition]], a block of equal "
        "amplitude or a file. Where there are three or more, and neither this nor hold_out_last "
        "is given, the one of middle amplitude.",
    )
    hold_out_last: int | None = Field(
        default=None, ge=1, le=1000, description="Held-out cycles per block, 1 where it counts."
    )
    hysteresis: float = Field(
        default=0.05, gt=0, lt=0.5, description="Reversal threshold over the deflection's range."
    )
    block_tolerance: float = Field(
        default=0.1, gt=0, lt=1, description="Amplitude change that starts a new block."
    )

    @property
    def held_out_last(self) -> int:
        """Last cycles of each block that judge, where no whole condition does."""
        return 1 if self.hold_out_last is None else self.hold_out_last


class Search(_Table):
    """The search for parameters; the same numbers give the same result."""

    seed: int = Field(default=20240229, ge=0, description="Seed of the starting population.")
    population: int | None = Field(
        default=None, ge=16, le=65536, description="Starting population, a power of two."
    )


class RecordingTable(_Table):
    """One or several files of one kind."""

    files: list[str] = Field(min_length=1, description="Paths or patterns, relative to the folder.")
    use: Use = Field(
        default="cycles",
        description="cycles: by the rules of [cycles]; train or held_out: the whole file.",
    )
    label: str | None = Field(default=None, description="Name in reports; the file's by default.")
    temperature_C: Quantity | None = _limits(
        COLDEST_C, HOTTEST_C, "The rubber's temperature, where no column has it.", default=None
    )
    format: TableFormat | None = Field(default=None, description="Where it differs from [format].")


class ConditionTable(_Table):
    """Common conditions of several files: a rate, an amplitude, a specimen."""

    name: str = Field(min_length=1, description="Name in reports.")
    files: list[str] = Field(min_length=1, description="Names or patterns, as in [[recording]].")


class SpecimenTable(_Table):
    """Description of the specimen, for its page."""

    name: str | None = Field(
        default=None, min_length=1, description="Its name in a table of reliability."
    )
    serial: int | None = Field(
        default=None, ge=1, description="Number on the coupling, by which a board counts its life."
    )
    material: str | None = Field(default=None, min_length=1, description="What it is made of.")
    geometry: str | None = Field(default=None, min_length=1, description="Shape and sizes, units.")
    measured: list[datetime.date] = Field(default=[], description="Days of the recordings.")


class Mapping(_Table):
    """A mapping file, as written."""

    schema_version: Literal[1] = Field(alias="schema", description="Version of this format.")
    device: DeviceTable
    specimen: SpecimenTable = Field(default=SpecimenTable())
    deflection: Deflection
    torque: Torque
    sampling: Sampling
    temperature: Temperature | None = Field(default=None)
    cycles: Cycles = Field(default=Cycles())
    search: Search = Field(default=Search())
    format: TableFormat = Field(default=TableFormat())
    full_scale_Nm: Quantity | None = _limits(
        1e-3, 1000, "100 % of errors; the largest recorded |torque| by default.", default=None
    )
    recording: list[RecordingTable] = Field(min_length=1)
    condition: list[ConditionTable] = Field(
        default=[], description="What a comparison of models leaves out as a whole."
    )
