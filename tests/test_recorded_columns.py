"""What a mapping makes of a file's columns: scales, limits, files."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from esea_gen.errors import UserError
from esea_gen.identify.recording.mapping import FITTABLE, MappingFile, load_mapping, parse_mapping
from esea_gen.identify.recording.tables import ToFit

from .test_recording_steps import MAPPING as ONE

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
