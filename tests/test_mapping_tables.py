"""Every table of a mapping file, typed a second time: what is taken, and what is left out."""

from __future__ import annotations

import datetime
import math
from typing import Any

import pytest
from pydantic import BaseModel, ValidationError

from esea_gen.identify import tables
from esea_gen.identify.tables import (
    ANGLE,
    FORCE,
    LENGTH,
    TIME,
    TORQUE,
    ConditionTable,
    Cycles,
    Deflection,
    DeviceTable,
    Mapping,
    RecordingTable,
    Sampling,
    Search,
    SpecimenTable,
    TableFormat,
    Temperature,
    ToFit,
    Torque,
)

COLUMN = {"column": "a", "unit": "N"}
MAPPING = {
    "schema": 1,
    "device": {"name": "a", "title": "A", "rate_terms": False},
    "deflection": COLUMN,
    "torque": COLUMN,
    "sampling": {},
    "recording": [{"files": ["f"]}],
}
# The least that each table wants, all of it; what the others are where nobody says.
WANTED: dict[type[BaseModel], dict[str, Any]] = {
    DeviceTable: MAPPING["device"],
    Deflection: COLUMN,
    Torque: COLUMN,
    Temperature: {"column": "a"},
    Sampling: {},
    Cycles: {},
    Search: {},
    TableFormat: {},
    RecordingTable: {"files": ["f"]},
    ConditionTable: {"name": "a", "files": ["f"]},
    SpecimenTable: {},
    Mapping: MAPPING,
}
LEFT_OUT = {
    DeviceTable: {"bandwidth_Hz": None, "limit_factor": 1.5},
    Deflection: {
        "sign": 1,
        "scale_rad_per_m": None,
        "zero": "none",
        "backlash_rad": None,
        "dead_zone_rad": None,
    },
    Torque: {"sign": 1, "lag_s": None, "scale_Nm_per_N": None, "zero": "none"},
    Temperature: {"unit": "C"},
    Sampling: {
        "time_column": None,
        "time_unit": "s",
        "period_s": None,
        "min_step_s": None,
        "fit_rate_Hz": None,
    },
    Cycles: {
        "skip_first": 1,
        "hold_out": None,
        "hold_out_last": None,
        "hysteresis": 0.05,
        "block_tolerance": 0.1,
    },
    Search: {"seed": 20240229, "population": None},
    TableFormat: {
        "kind": None,
        "delimiter": None,
        "quote": '"',
        "decimal": None,
        "encoding": None,
        "header_line": None,
        "first_data_line": None,
    },
    RecordingTable: {"use": "cycles", "label": None, "temperature_C": None, "format": None},
    ConditionTable: {},
    SpecimenTable: {
        "name": None,
        "serial": None,
        "material": None,
        "geometry": None,
        "measured": [],
    },
    Mapping: {
        "specimen": SpecimenTable(),
        "temperature": None,
        "cycles": Cycles(),
        "search": Search(),
        "format": TableFormat(),
        "full_scale_Nm": None,
        "condition": [],
    },
}
ZERO = (("none", "first", "mean", "middle"), ("", "last", None))
QUANTITY = {"value": 3.0, "status": "assumed", "source": "a guess"}
FIT = ("fit", {"value": 0.1, "status": "assumed", "source": "a guess"}, None)
# Of every other field: what is taken, what is not.
TAKEN: dict[type[BaseModel], dict[str, tuple[tuple[Any, ...], tuple[Any, ...]]]] = {
    DeviceTable: {
        "name": (("a", "z9_", "abcdefghijklmno"), ("", "A", "9a", "_a", "aB", "abcdefghijklmnop")),
        "title": (("A", "Ab"), ("", None)),
        "rate_terms": ((True, False), ("maybe", 2, None)),
    },
    Deflection: {
        "column": (("a", "ab"), ("", None)),
        "unit": (("", "m", "deg"), (None, 1)),
        "sign": ((-1, 1), (0, 2, -2, "fit", None)),
        "zero": ZERO,
        "backlash_rad": (FIT, ("fitted", "", 0.0)),
        "dead_zone_rad": (FIT, ("fitted", "", 0.0)),
        "scale_rad_per_m": ((QUANTITY, None), ("fit", 3.0)),
    },
    Torque: {
        "column": (("a", "ab"), ("", None)),
        "unit": (("", "N"), (None, 1)),
        "sign": ((-1, 1, "fit"), (0, 2, -2, "", None)),
        "zero": ZERO,
        "lag_s": (FIT, ("fitted", "", 0.0)),
        "scale_Nm_per_N": ((QUANTITY, None), ("fit", 3.0)),
    },
    Temperature: {"column": (("a", "ab"), ("", None)), "unit": (("C", "K"), ("F", "", None))},
    Sampling: {
        "time_column": (("a", "ab", None), (1,)),
        "time_unit": (("s", "ms"), (None, 1)),
        "period_s": ((QUANTITY, None), ("fit", 3.0)),
    },
    Cycles: {"hold_out": (("a", "ab", None), ("",))},
    Search: {},
    TableFormat: {
        "kind": (("csv", "mat", "hdf5", "parquet", "json", None), ("xls", "")),
        "delimiter": ((",", "\t", " ", None), ("", ",,")),
        "quote": (('"', "'", ""), ("''", None)),
        "decimal": ((".", ",", None), ("", ";")),
        "encoding": (("gb18030", "latin-1", None), (1,)),
    },
    RecordingTable: {
        "files": ((["a"], ["a", "b", "c"]), ([], None, "a")),
        "use": (("cycles", "train", "held_out"), ("test", "", None)),
        "label": (("a", "ab", None), (1,)),
        "format": ((TableFormat(), None), ("csv",)),
        "temperature_C": ((QUANTITY, None), ("fit", 3.0)),
    },
    ConditionTable: {
        "name": (("a", "ab"), ("", None)),
        "files": ((["a"], ["a", "b", "c"]), ([], None, "a")),
    },
    SpecimenTable: {
        "name": (("a", "ab", None), ("",)),
        "serial": ((1, 2, 70000, None), (0, -1, 1.5)),
        "material": (("a", "ab", None), ("",)),
        "geometry": (("a", "ab", None), ("",)),
        "measured": (([], ["2024-02-29"], ["2024-03-01", "2024-03-02"]), (["2023-02-29"], None)),
    },
    Mapping: {
        "schema": ((1,), (0, 2, "1", None)),
        "recording": (([{"files": ["f"]}], [{"files": ["f"]}, {"files": ["g"]}]), ([], None)),
        "condition": (([], [{"name": "a", "files": ["f"]}]), (None, [{}])),
        "temperature": (({"column": "a"}, None), ({},)),
        "full_scale_Nm": ((QUANTITY, None), ("fit", 3.0)),
    },
}


@pytest.mark.parametrize("table", WANTED, ids=lambda t: t.__name__)
def test_fields_of_a_table(table):
    known, wanted = LEFT_OUT[table], WANTED[table]
    made = table(**wanted)
    assert {name: getattr(made, name) for name in known} == known
    for name in wanted:
        with pytest.raises(ValidationError):
            table(**{k: v for k, v in wanted.items() if k != name})
    for name, (right, wrong) in TAKEN[table].items():
        for given in right:
            table(**wanted | {name: given})
        for given in wrong:
            with pytest.raises(ValidationError):
                table(**wanted | {name: given})
    # Every field is wanted or may be left out, but for a device's assumed quantities.
    named = {f.alias or n for n, f in table.model_fields.items()}
    quantities = {"stops", "sense_rate_Hz", "resolution_bits"} if table is DeviceTable else set()
    assert named == {*wanted, *known} | quantities


@pytest.mark.parametrize("table", WANTED, ids=lambda t: t.__name__)
def test_a_table_takes_no_other_name_and_stays_as_read(table):
    with pytest.raises(ValidationError, match="Extra inputs are not permitted"):
        table(**WANTED[table], colour="red")
    made = table(**WANTED[table])
    for name in table.model_fields:
        with pytest.raises(ValidationError, match="frozen"):
            setattr(made, name, getattr(made, name))


def test_no_number_of_a_table_is_infinite():
    for table, name in ((DeviceTable, "limit_factor"), (Cycles, "hysteresis")):
        for wrong in (math.nan, math.inf, -math.inf):
            with pytest.raises(ValidationError, match="finite"):
                table(**WANTED[table], **{name: wrong})


def test_tables_are_all_here():
    made = {t for t in vars(tables).values() if isinstance(t, type) and issubclass(t, BaseModel)}
    made = {t for t in made if t.__module__ in (tables.__name__, TableFormat.__module__)}
    assert made - {tables._Table, ToFit} == {*WANTED}


def test_a_number_to_be_fitted_is_zero_until_then():
    for table, name in (
        (Torque, "lag_s"),
        (Deflection, "backlash_rad"),
        (Deflection, "dead_zone_rad"),
    ):
        found = getattr(table(**COLUMN, **{name: "fit"}), name)
        assert isinstance(found, ToFit)
        assert (found.value, found.status, found.source) == (0.0, "assumed", "to be fitted")
        assert not isinstance(getattr(table(**COLUMN, **{name: QUANTITY}), name), ToFit)


def test_what_a_device_is_where_nobody_says():
    made = DeviceTable(**WANTED[DeviceTable])
    assert [(q.value, q.status, q.source) for q in (made.stops, made.sense_rate_Hz)] == [
        (10, "assumed", "default: as many as published"),
        (1000, "assumed", "default of identify"),
    ]
    for q, value in ((made.resolution_bits, 14), (made.bandwidth, 15)):
        assert (q.value, q.status, q.source) == (value, "assumed", "default of identify")


def test_held_out_cycles_are_one_where_nobody_says():
    assert [Cycles(hold_out_last=n).held_out_last for n in (None, 1, 2, 7)] == [1, 1, 2, 7]


def test_days_of_a_specimen_are_dates():
    days = SpecimenTable(measured=["2024-02-29", "2024-03-01"]).measured
    assert days == [datetime.date(2024, 2, 29), datetime.date(2024, 3, 1)]


def test_units_in_si():
    # International pound and inch: 0.45359237 kg, 25.4 mm; standard gravity 9.80665 m/s2.
    assert pytest.approx(LENGTH, rel=1e-15) == {
        "m": 1,
        "cm": 0.01,
        "mm": 0.001,
        "um": 1e-6,
        "in": 25.4 / 1000,
    }
    assert pytest.approx(ANGLE, rel=1e-15) == {"rad": 1, "mrad": 1e-3, "deg": math.pi / 180}
    assert pytest.approx(FORCE, rel=1e-15) == {
        "N": 1,
        "mN": 1e-3,
        "kN": 1e3,
        "kgf": 9.80665,
        "tonf": 9806.65,
        "lbf": 0.45359237 * 9.80665,
    }
    assert pytest.approx(TORQUE, rel=1e-15) == {"Nm": 1, "mNm": 1e-3, "Ncm": 0.01, "kNm": 1e3}
    assert pytest.approx(TIME, rel=1e-15) == {"s": 1, "ms": 1e-3, "us": 1e-6, "min": 60}
