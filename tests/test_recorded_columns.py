"""Columns of a file and what a mapping makes of them: numbers, messages, scales."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from esea_gen.errors import UserError
from esea_gen.identify.columns import missing_column, shortened, vectors
from esea_gen.identify.mapping import FITTABLE, MappingFile, load_mapping, parse_mapping
from esea_gen.identify.readers import read_json
from esea_gen.identify.reading import read_csv, read_table
from esea_gen.identify.tables import FileFormat, ToFit

from .test_recording_steps import MAPPING as ONE

# Texts.


def test_a_cell_is_shown_to_forty_letters_on_one_line():
    assert shortened("a" * 40) == "a" * 40
    assert shortened("a" * 41) == "a" * 40 + "..."
    assert shortened(" a \n b\t c ") == "a b c"


@pytest.mark.parametrize(
    ("count", "more"), [(19, ""), (20, ""), (21, " and 1 more"), (57, " and 37 more")]
)
def test_of_columns_that_are_there_twenty_are_named(count, more):
    error = missing_column("rig", "speed", [f"k{i}" for i in range(count)], "column")
    named = ", ".join(f"'k{i}'" for i in range(min(count, 20)))
    assert error.what == f"rig: there is no column 'speed'; there are {named}{more}."
    assert error.fix == "Correct the column in the mapping file."


def test_a_column_of_nearly_that_name_is_offered():
    error = missing_column("rig", "torque", ["t", "torqe", "torques"], "variable")
    assert error.fix == "Did you mean 'torques'? Correct the column in the mapping file."
    assert "there are none." in missing_column("rig", "torque", [], "column").what


# Arrays.


def test_columns_are_vectors_of_two_numbers_or_more():
    content = {
        "row": np.array([[1, 2]]),
        "column": np.array([[3.5], [4.5]], dtype=np.float32),
        "count": np.array([7, 8], dtype=np.uint8),
        "one": np.array([5.0]),
        "word": "text",
    }
    out, rows = vectors("rig", content, ["column", "row", "count"], "variable")
    assert {k: v.tolist() for k, v in out.items()} == {
        "row": [1.0, 2.0],
        "column": [3.5, 4.5],
        "count": [7.0, 8.0],
    }
    assert all(v.dtype == np.float64 for v in out.values())
    assert (rows.tolist(), rows.dtype) == ([1, 2], np.intp)
    with pytest.raises(UserError, match="no variable 'one'; there are 'row', 'column', 'count'"):
        vectors("rig", content, ["one"], "variable")


@pytest.mark.parametrize(
    "value",
    [np.array([True, False]), np.array([1j, 2]), np.array(["a", "b"]), np.ones((2, 2))],
    ids=["bool", "complex", "text", "matrix"],
)
def test_what_is_no_vector_of_real_numbers_is_refused(value):
    with pytest.raises(UserError, match="it is not a vector of real numbers"):
        vectors("rig", {"x": value}, ["x"], "variable")


def test_columns_are_equally_long():
    content = {"x": np.zeros(3), "y": np.zeros(4)}
    with pytest.raises(UserError, match=r"different lengths \{'x': 3, 'y': 4\}"):
        vectors("rig", content, ["x", "y"], "variable")
    assert vectors("rig", content, ["y"], "variable")[1].tolist() == [1, 2, 3, 4]


# JSON.


def from_json(content: object) -> dict[str, list[float]]:
    found, _ = read_json(json.dumps(content).encode(), "rig", FileFormat(kind="json"), ["x"])
    return found["x"].tolist()


def test_null_is_no_number_and_neither_true_nor_false_is_one():
    found = from_json({"x": [1, None, 2.5]})
    assert found[::2] == [1.0, 2.5]
    assert math.isnan(found[1])
    for odd in (True, False, "1"):
        with pytest.raises(UserError, match="it is not a vector of real numbers"):
            from_json({"x": [1, odd, 2.5]})
    # Of rows one may lack a column.
    found = from_json([{"x": 1}, {"y": 2}, {"x": 3}])
    assert found[::2] == [1.0, 3.0]
    assert math.isnan(found[1])
    for wrong in ([], [{"x": 1}, 2], {"x": 1}, 5):
        with pytest.raises(UserError, match="holds neither columns by name nor a list of rows"):
            from_json(wrong)


# Text.


def test_a_decimal_comma_and_a_point():
    comma = FileFormat(delimiter=";", decimal=",")
    for form, raw in (
        (comma, b"a;b\n1,5;-2\n3;1,25e1\n"),
        (FileFormat(), b"a,b\n1.5,-2\n3,1.25e1\n"),
    ):
        found, rows = read_csv(raw, "rig", form, ["b", "a"])
        assert {k: v.tolist() for k, v in found.items()} == {"a": [1.5, 3.0], "b": [-2.0, 12.5]}
        assert rows.tolist() == [2, 3]
    with pytest.raises(UserError, match="line 2, column 'a': '1,5' is not a number"):
        read_csv(b"a;b\n1,5;2\n", "rig", FileFormat(delimiter=";"), ["a"])


def test_cells_beyond_the_header_may_be_empty_but_hold_nothing():
    found, _ = read_csv(b"a,b\n1,2,,  \n3,4\n", "rig", FileFormat(), ["a", "b"])
    assert found["b"].tolist() == [2.0, 4.0]
    with pytest.raises(UserError, match="line 2 has 3 cells, but there are 2 columns"):
        read_csv(b"a,b\n1,2,5\n", "rig", FileFormat(), ["a", "b"])
    with pytest.raises(UserError, match="line 3 has 1 cells, too few for column 'b'"):
        read_csv(b"a,b\n1,2\n3\n", "rig", FileFormat(), ["a", "b"])


@pytest.mark.parametrize(
    ("start", "title", "kind"),
    [
        (b"MATLAB 5.0 MAT-file, x", "MATLAB", "mat"),
        (b"MATLAB 7.3 MAT-file, x", "MATLAB", "mat"),
        (b"\x89HDF\r\n\x1a", "hdf5", "hdf5"),
        (b"PAR1x", "parquet", "parquet"),
    ],
)
def test_a_file_that_is_no_text_is_told_by_how_it_begins(start, title, kind):
    with pytest.raises(UserError, match=f"is a {title} file, but it is read as text") as told:
        read_csv(start, "rig", FileFormat(), ["a"])
    assert f"kind = '{kind}'" in told.value.fix


def test_a_long_or_broken_cell_is_blamed_on_a_quote():
    for cell, quote in (("x" * 40, False), ("x" * 41, True), ('"a\nb"', True), ("abc", False)):
        with pytest.raises(UserError) as told:
            read_csv(f"a,b\n1,{cell}\n".encode(), "rig", FileFormat(), ["b"])
        assert ("A quote that is not closed" in told.value.fix) == quote


def test_a_table_has_finite_numbers_and_a_format_of_its_own(tmp_path: Path):
    path = tmp_path / "t.csv"
    found = read_table(
        path, "a;b\n1,5;2\n", ["a"], "mend it", FileFormat(delimiter=";", decimal=",")
    )
    assert found["a"].tolist() == [1.5]
    with pytest.raises(UserError, match="line 3, column 'a': inf is not finite") as told:
        read_table(path, "a,b\n1,2\ninf,2\n", ["b", "a"], "mend it")
    assert told.value.fix == "mend it"


# Mapping.

MAPPING = ONE.replace("rig.csv", "a.csv") + '[[recording]]\nfiles = ["b.csv"]\n'


def parsed(*changes: tuple[str, str]) -> MappingFile:
    text = MAPPING
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return MappingFile(parse_mapping(text, "map.toml"), "map.toml", Path())


def number(value: float) -> str:
    return f'{{ value = {value}, status = "assumed", source = "?" }}'


def test_scales_and_signs_multiply_the_units():
    plain = parsed()
    assert (plain.rad_per_unit, plain.Nm_per_unit) == (1.0, 1.0)
    x = f'unit = "cm"\nsign = -1\nscale_rad_per_m = {number(7.0)}'
    y = f'unit = "kN"\nsign = -1\nscale_Nm_per_N = {number(0.03)}'
    found = parsed(('unit = "rad"', x), ('unit = "Nm"', y))
    assert found.rad_per_unit == pytest.approx(-0.07)
    assert found.Nm_per_unit == pytest.approx(-30.0)
    other = parsed(('unit = "Nm"', 'unit = "mNm"\nsign = "fit"'), ('unit = "rad"', 'unit = "deg"'))
    assert other.Nm_per_unit == pytest.approx(1e-3)
    assert other.rad_per_unit == pytest.approx(math.pi / 180)


def test_what_may_be_left_to_the_fit_and_what_is_put_in_its_place():
    assert FITTABLE == ("torque.lag_s", "deflection.backlash_rad", "deflection.dead_zone_rad")
    found = parsed(
        ("[torque]", '[torque]\nlag_s = "fit"'),
        ("[deflection]", f"[deflection]\nbacklash_rad = {number(0.004)}"),
    )
    lag, gap, zone = (found.fittable()[k] for k in FITTABLE)
    assert isinstance(lag, ToFit)
    assert (gap.value, zone) == (0.004, None)
    done = found.settled({"torque.lag_s": gap, "deflection.backlash_rad": None})
    assert [done.fittable()[k] for k in FITTABLE] == [gap, None, None]
    assert done.mapping.torque.unit == "Nm"
    assert (done.origin, done.folder) == (found.origin, found.folder)
    assert found.fittable()["torque.lag_s"] == lag


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            [('["a.csv"]', f'["a.csv"]\ntemperature_C = {number(20)}')],
            "key recording[1].temperature_C is missing: other recordings have one",
        ),
        (
            [('["b.csv"]', f'["b.csv"]\ntemperature_C = {number(20)}')],
            "key recording[0].temperature_C is missing",
        ),
        (
            [
                ('["b.csv"]', f'["b.csv"]\ntemperature_C = {number(20)}'),
                ("[sampling]", '[temperature]\ncolumn = "T"\n[sampling]'),
            ],
            "recording[1].temperature_C and [temperature] are both given",
        ),
        (
            [('["b.csv"]', f'["b.csv"]\ntemperature_C = {number(201)}')],
            "recording[1].temperature_C = 201 is above its limit 200",
        ),
        (
            [("[sampling]", '[temperature]\ncolumn = "y"\n[sampling]')],
            "column 'y' is named twice",
        ),
        (
            [("[torque]", f"[torque]\nlag_s = {number(-1.01)}")],
            "lag_s = -1.01 is below its limit -1",
        ),
        (
            [("time_column", "min_step_s = 0.1\nperiod_s = " + number(1) + " #")],
            "sampling.min_step_s = 0.1 needs a time column",
        ),
        (
            [
                (
                    'title = "Rig"',
                    f'title = "Rig"\nbandwidth_Hz = {number(10.1)}\nsense_rate_Hz = {number(100)}',
                )
            ],
            "device.bandwidth_Hz = 10.1 Hz is above its limit, a tenth",
        ),
        (
            [("time_column", "fit_rate_Hz = 1000.5\ntime_column")],
            "sampling.fit_rate_Hz = 1000.5 Hz is above its limit",
        ),
        (
            [('["b.csv"]', '["b.csv"]\nformat = { header_line = 4, first_data_line = 4 }')],
            "recording[1].format.first_data_line = 4 is not below the header",
        ),
        (
            [("[sampling]", "[search]\npopulation = 96\n[sampling]")],
            "population = 96 is not a power",
        ),
    ],
)
def test_what_a_mapping_may_not_say(changes, said):
    with pytest.raises(UserError) as told:
        parsed(*changes)
    assert said in told.value.what


def test_what_a_mapping_may_say_at_its_limits():
    warm = f"temperature_C = {number(200)}"
    both = parsed(('["a.csv"]', f'["a.csv"]\n{warm}'), ('["b.csv"]', f'["b.csv"]\n{warm}'))
    assert [r.temperature_C.value for r in both.mapping.recording] == [200, 200]
    more = (
        (
            'title = "Rig"',
            f'title = "Rig"\nbandwidth_Hz = {number(10)}\nsense_rate_Hz = {number(100)}',
        ),
        ("time_column", "fit_rate_Hz = 100\ntime_column"),
        ("[torque]", f"[torque]\nlag_s = {number(-1)}"),
        ("[sampling]", '[temperature]\ncolumn = "T"\n[search]\npopulation = 64\n[sampling]'),
        (
            '["a.csv"]',
            '["a.csv"]\nformat = { header_line = 4, first_data_line = 5 }\nuse = "train"',
        ),
    )
    assert parsed(*more).mapping.search.population == 64


def test_files_are_found_by_name_and_by_pattern_in_order(tmp_path: Path):
    for name in ("c.csv", "a.csv", "b.txt", "sub/d.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("x")
    (tmp_path / "e.csv").mkdir()  # a folder is no file
    text = MAPPING.replace('["a.csv"]', '["b.txt", "[ac].csv"]').replace('"b.csv"', '"sub/?.csv"')
    (tmp_path / "map.toml").write_text(text)
    found = list(load_mapping(tmp_path / "map.toml").paths())
    assert [name for _, name, _ in found] == ["b.txt", "a.csv", "c.csv", "sub/d.csv"]
    assert [p.relative_to(tmp_path).as_posix() for p, _, _ in found] == [n for _, n, _ in found]
    assert [t.files[0] for _, _, t in found] == ["b.txt"] * 3 + ["sub/?.csv"]
    for wrong, said in (
        ("*", "recording[0].files: 'x*.csv' matches no file"),
        ("", "recording[0].files: 'x.csv' does not exist"),
    ):
        (tmp_path / "map.toml").write_text(text.replace('"b.txt"', f'"x{wrong}.csv"'))
        with pytest.raises(UserError) as told:
            list(load_mapping(tmp_path / "map.toml").paths())
        assert said in told.value.what
    (tmp_path / "map.toml").write_text(text.replace("sub/?.csv", "c.csv"))
    with pytest.raises(UserError, match=r"recording\[1\]\.files names 'c\.csv' a second time"):
        list(load_mapping(tmp_path / "map.toml").paths())
