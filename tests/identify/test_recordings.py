"""Mapping files and tables: recordings, cycles, roles; rejected input."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.errors import UserError
from esea_gen.identify import load_mapping, load_recordings, parse_mapping
from esea_gen.identify.recording.cycles import divide, reversals
from esea_gen.identify.recording.tables import Cycles
from tests.conftest import ROOT
from tests.rigs import changed, mapped, rig, says, table, written
from tests.rigs import refused as unread

ONE = '{ value = 1.0, status = "assumed", source = "x" }'
WARM = 'temperature_C = { value = 20, status = "assumed", source = "x" }'
MAPPING = changed(('unit = "rad"', 'unit = "deg"'))


def loops(cycles: int = 6, per: int = 100) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, deflection in degrees, torque of a stiff, lossy specimen."""
    t = np.arange(cycles * per + 1) / per
    x = 5 * np.sin(2 * np.pi * t)
    return t, x, 0.1 * x + 0.05 * np.cos(2 * np.pi * t)


def refused(
    folder: Path, mapping: str = MAPPING, csv: str | bytes | None = None, name: str = "rig.csv"
) -> UserError:
    """The error that a mapping and a recording give."""
    if csv is None:
        csv = table(*loops())
    (folder / "map.toml").write_text(mapping, encoding="utf-8")
    (folder / name).write_bytes(csv.encode() if isinstance(csv, str) else csv)
    with pytest.raises(UserError) as caught:
        load_recordings(load_mapping(folder / "map.toml"))
    return caught.value


# -- mapping -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("schema = 1", "schema = 1\ntitel = 1", ["unknown key titel", "Known keys here", "device"]),
        ('column = "x"', 'colum = "x"', ["deflection.colum", "Did you mean column"]),
        ('title = "Rig"\n', "", ["key device.title is missing", "One line for reports", "Add it"]),
        ("rate_terms = false", 'rate_terms = "maybe"', ["device.rate_terms = 'maybe'"]),
        ('unit = "deg"', 'unit = "grad"', ["deflection.unit = 'grad'", "rad, mrad, deg and m, cm"]),
        (
            'unit = "deg"',
            'unit = "mm"',
            ["deflection.scale_rad_per_m is missing", "'mm'", "assumed"],
        ),
        (
            'unit = "deg"',
            'unit = "deg"\nscale_rad_per_m = { value = 1.0, status = "assumed", source = "x" }',
            ["deflection.scale_rad_per_m = 1 has no meaning", "Remove it"],
        ),
        (
            'unit = "deg"',
            'unit = "mm"\nscale_rad_per_m = { value = -1.0, status = "assumed", source = "x" }',
            ["deflection.scale_rad_per_m = -1 is below its limit 1e-06", "from 1e-06 to 1e+06"],
        ),
        ('unit = "deg"', 'unit = "mm"\nscale_rad_per_m = 3', ["scale_rad_per_m = 3", "{ value = "]),
        (
            'title = "Rig"',
            'title = "Rig"\nstops = { value = 40, status = "assumed", source = "x" }',
            ["device.stops = 40 is above its limit 32"],
        ),
        (
            'title = "Rig"',
            'title = "Rig"\nsense_rate_Hz = { value = 100, status = "assumed", source = "x" }\n'
            'bandwidth_Hz = { value = 15, status = "assumed", source = "x" }',
            ["device.bandwidth_Hz = 15 Hz is above its limit", "10 Hz"],
        ),
        ('time_column = "t"', "", ["[sampling] has neither time_column and period_s", "assumed"]),
        (
            'time_column = "t"',
            'time_column = "t"\nperiod_s = { value = 0.01, status = "assumed", source = "x" }',
            ["[sampling] has both time_column and period_s"],
        ),
        ('time_column = "t"', 'time_column = "x"', ["column 'x' is named twice"]),
        (
            'time_column = "t"',
            'time_column = "t"\ntime_unit = "h"',
            ["sampling.time_unit = 'h'", "ms"],
        ),
        (
            'time_column = "t"',
            'time_column = "t"\nfit_rate_Hz = 2000',
            ["sampling.fit_rate_Hz = 2000 Hz is above its limit", "1000 Hz"],
        ),
        (
            'files = ["rig.csv"]',
            'files = ["rig.csv"]\nuse = "train"',
            ["every recording has use = 'train'", "held_out"],
        ),
        (
            'files = ["rig.csv"]',
            'files = ["rig.csv"]\nuse = "held_out"',
            ["every recording has use = 'held_out'", "nothing is left to fit"],
        ),
        (
            'files = ["rig.csv"]',
            'files = ["rig.csv"]\nformat = { encoding = "gb1803" }',
            ["recording[0].format.encoding = 'gb1803'", "gb18030"],
        ),
        (
            'files = ["rig.csv"]',
            'files = ["rig.csv"]\nformat = { first_data_line = 1 }',
            ["first_data_line = 1 is not below the header", "Give 2 or more"],
        ),
        (
            "[sampling]",
            "[search]\npopulation = 100\n[sampling]",
            ["search.population = 100", "128"],
        ),
        (
            'files = ["rig.csv"]',
            f'files = ["rig.csv"]\n{WARM}\n[[recording]]\nfiles = ["b.csv"]',
            ["key recording[1].temperature_C is missing: other recordings have one"],
        ),
        (
            'files = ["rig.csv"]',
            f'files = ["rig.csv"]\n{WARM}\n[temperature]\ncolumn = "T"',
            ["recording[0].temperature_C and [temperature] are both given"],
        ),
        (
            'files = ["rig.csv"]',
            f'files = ["rig.csv"]\n{WARM.replace("20", "201")}',
            ["recording[0].temperature_C = 201 is above its limit 200"],
        ),
        ("[torque]", '[torque]\nlag_s = "fitt"', ["torque.lag_s = 'fitt'", 'or "fit"']),
        ("[torque]", f"[torque]\nlag_s = {ONE.replace('1.0', '1.01')}", ["above its limit 1"]),
        (
            'time_column = "t"',
            f"min_step_s = 0.1\nperiod_s = {ONE}",
            ["sampling.min_step_s = 0.1 needs a time column"],
        ),
        ("[sampling]", "[sampling", ["not valid TOML"]),
    ],
)
def test_a_wrong_mapping_is_explained(old: str, new: str, parts: list[str]) -> None:
    assert old in MAPPING
    with pytest.raises(UserError) as caught:
        parse_mapping(MAPPING.replace(old, new, 1), "map.toml")
    says(caught.value, "map.toml", *parts)


def test_a_missing_mapping_or_folder_is_explained(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(MAPPING)
    with pytest.raises(UserError) as caught:
        load_mapping(tmp_path / "mapp.toml")
    says(caught.value, "There is no mapping file", "mapp.toml", "Did you mean map.toml?")
    with pytest.raises(UserError) as caught:
        load_mapping(tmp_path / "map.toml", tmp_path / "nowhere")
    says(caught.value, "There is no data folder", "nowhere")


def test_the_example_mapping_is_valid() -> None:
    folder = ROOT / "esea_gen" / "identify" / "examples"
    for path in folder.glob("*.toml"):
        assert load_mapping(path).mapping.device.rate_terms


# -- recordings ----------------------------------------------------------------------------------


def test_a_missing_recording_is_explained(tmp_path: Path) -> None:
    error = refused(tmp_path, MAPPING.replace("rig.csv", "rigg.csv"))
    says(error, "map.toml: recording[0].files: 'rigg.csv' does not exist", "Did you mean rig.csv?")
    error = refused(tmp_path, MAPPING.replace("rig.csv", "*.txt"))
    says(error, "'*.txt' matches no file", "--data")
    error = refused(tmp_path, MAPPING.replace('"rig.csv"', '"rig.csv", "*.csv"'))
    says(error, "names 'rig.csv' a second time")


def test_a_wrong_column_is_explained(tmp_path: Path) -> None:
    error = refused(tmp_path, csv=table(*loops()).replace("t,x,y", "t,xx,y"))
    says(error, "rig.csv, line 1: there is no column 'x'; the columns are 't', 'xx', 'y'")
    says(error, "Did you mean xx?")
    error = refused(tmp_path, csv=table(*loops()).replace("t,x,y", "t,x,z"))
    says(error, "rig.csv, line 1: there is no column 'y'", "'t', 'x', 'z'")
    error = refused(tmp_path, csv="t,x,y,x\n1,2,3,4\n")
    says(error, "the column name 'x' occurs 2 times", "header_line = 0")


@pytest.mark.parametrize(
    ("line", "row", "parts"),
    [
        (
            6,
            "0.01,1.2,0.1",
            ["time goes backwards in column 't': 0.03 s in line 5, then 0.01 s in line 6"],
        ),
        (6, "0.03,1.2,0.1", ["time stands still in column 't'", "sampling.min_step_s"]),
    ],
)
def test_a_bad_row_is_explained(tmp_path: Path, line: int, row: str, parts: list[str]) -> None:
    lines = table(*loops()).splitlines()
    lines[line - 1] = row
    says(refused(tmp_path, csv="\n".join(lines)), "rig.csv", *parts)


def test_bad_physics_is_explained(tmp_path: Path) -> None:
    t, x, y = loops()
    says(
        refused(tmp_path, csv=table(t, x, -y)),
        "rig.csv: negative stiffness",
        "slope -5.73 Nm/rad, not above its limit 0 Nm/rad",
        "sign = -1",
        "map.toml",
    )
    says(refused(tmp_path, csv=table(t, x, 0 * y)), "no stiffness", "slope 0 Nm/rad")
    says(refused(tmp_path, csv=table(t, 0 * x, y)), "the deflection is constant (column 'x')")
    says(
        refused(tmp_path, csv=table(t, 100 * x, y)),
        "the largest |deflection| is 8.727 rad after scaling, above the limit of 2.133 rad",
        "deflection.unit",
    )
    says(
        refused(tmp_path, csv=table(t, x, 1e4 * y)),
        "the largest |torque| is 5023 Nm after scaling, above the limit of 1000 Nm",
    )
    says(
        refused(tmp_path, csv=table(t, x, 300 * y)),
        "the stiffness is 1719 Nm/rad after scaling, above the limit of 1000 Nm/rad",
    )
    says(
        refused(tmp_path, csv=table(t[:20], x[:20], y[:20])),
        "has 20 samples, below the limit of 50",
    )


def test_too_few_cycles_are_explained(tmp_path: Path) -> None:
    error = refused(tmp_path, csv=table(*loops(cycles=2)))
    says(error, "no cycle is left to train on", "rig.csv: 1", "skip_first = 1", "hold_out_last = 1")


def test_a_foreign_csv_is_read(tmp_path: Path) -> None:
    t, x, y = loops()
    rows = [
        f'"{a:.6f}";"{b:.6f}";"{c:.6f}"'.replace(".", ",") for a, b, c in zip(t, x, y, strict=True)
    ]
    text = "\r\n".join(["", "时间;位移;力", "(s);(mm);(N)", *rows, ""])
    (tmp_path / "a.csv").write_bytes(text.encode("gb18030"))
    mapping = (
        MAPPING.replace('"t"', '"时间"')
        .replace('"y"', '"力"')
        .replace('"x"', '"位移"')
        .replace("rig.csv", "*.csv")
        + 'format = { encoding = "gb18030", delimiter = ";", decimal = ",", header_line = 2, '
        "first_data_line = 4 }\n"
    )
    (tmp_path / "map.toml").write_text(mapping, encoding="utf-8")
    (recording,) = load_recordings(load_mapping(tmp_path / "map.toml"))
    np.testing.assert_allclose(recording.theta_rad, np.radians(x), atol=1e-6)
    np.testing.assert_allclose(recording.time_s, t, atol=1e-6)
    assert recording.file == "a.csv"


def test_glitches_are_dropped_and_counted(tmp_path: Path) -> None:
    t, x, y = loops()
    t2, x2, y2 = (np.insert(a, 200, a[199] + d) for a, d in ((t, 0.001), (x, 3.0), (y, 0.0)))
    mapping = MAPPING.replace('"t"\n', '"t"\nmin_step_s = 0.005\n')
    (tmp_path / "map.toml").write_text(mapping)
    (tmp_path / "rig.csv").write_text(table(t2, x2, y2))
    (recording,) = load_recordings(load_mapping(tmp_path / "map.toml"))
    assert recording.dropped == 1
    np.testing.assert_allclose(recording.theta_rad, np.radians(x), atol=1e-6)
    error = refused(tmp_path, mapping.replace("0.005", "0.015"))
    says(error, "min_step_s = 0.015 s would drop 300 of 601", "limit of 1%", "median step is 0.01")


def test_labels_are_told_apart(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "rig.csv").write_text(table(*loops()))
    (tmp_path / "map.toml").write_text(MAPPING.replace("rig.csv", "*/rig.csv"))
    recordings = load_recordings(load_mapping(tmp_path / "map.toml"))
    assert [r.label for r in recordings] == ["a/rig", "b/rig"]
    one = '[[recording]]\nfiles = ["{}/rig.csv"]\nlabel = "same"\n'
    head = MAPPING[: MAPPING.index("[[recording]]")]
    (tmp_path / "map.toml").write_text(head + one.format("a") + one.format("b"))
    with pytest.raises(UserError) as caught:
        load_recordings(load_mapping(tmp_path / "map.toml"))
    says(caught.value, "map.toml", "label 'same'", "b/rig.csv", "its own label")


# -- reading -------------------------------------------------------------------------------------


def test_a_period_makes_the_time_which_is_known_unless_it_is_assumed(tmp_path: Path) -> None:
    t, x, y = rig(0.1, 0.1, 0.1, 0.1)
    for status in ("assumed", "published"):
        period = f'period_s = {{ value = 0.01, status = "{status}", source = "?" }}'
        path = written(tmp_path, t, x, y, ('time_column = "t"', period))
        (r,) = load_recordings(load_mapping(path))
        np.testing.assert_allclose(r.time_s, t, atol=1e-12)
        assert r.timed == (status == "published")


def test_each_channel_has_its_own_zero(tmp_path: Path) -> None:
    t, x, y = rig(0.1, 0.1, 0.1, 0.1)
    zeros = (
        ("[deflection]", '[deflection]\nzero = "first"'),
        ("[torque]", '[torque]\nzero = "middle"'),
    )
    (r,) = load_recordings(load_mapping(written(tmp_path, t, x + 0.02, y + 3.0, *zeros)))
    np.testing.assert_allclose(r.theta_rad, x, atol=1e-12)
    assert r.tau_Nm.max() == pytest.approx(-r.tau_Nm.min())
    np.testing.assert_allclose(r.tau_Nm - y, (r.tau_Nm - y).mean(), atol=1e-12)


def test_conditions_and_files_are_named_by_pattern(tmp_path: Path) -> None:
    t, x, y = rig(0.1, 0.1, 0.1, 0.1)
    rules = (
        "[sampling]",
        '[[condition]]\nname = "slow"\nfiles = ["x*", "rig.*"]\n'
        '[[condition]]\nname = "all"\nfiles = ["*.csv"]\n'
        '[[condition]]\nname = "odd"\nfiles = ["odd.csv"]\n[sampling]',
    )
    assert "condition 'odd': none" in unread(written(tmp_path, t, x, y, rules))
    (tmp_path / "odd.csv").write_bytes((tmp_path / "rig.csv").read_bytes())
    (tmp_path / "e.csv").mkdir()  # a folder is no file
    found = load_recordings(load_mapping(mapped(tmp_path, rules, ('"rig.csv"', '"*.csv"'))))
    assert [(r.file, r.conditions) for r in found] == [
        ("odd.csv", ("all", "odd")),
        ("rig.csv", ("slow", "all")),
    ]


def test_what_is_soft_or_relaxes_to_the_other_side_is_not_turned(tmp_path: Path) -> None:
    """Held, while the torque goes from 1 to -3: what counts is how it rose."""
    t, x, y = rig(0.1, 0.1, 0.1, 0.1)
    k = np.arange(401)
    ramp = np.minimum(k, 40) / 400
    relaxed = np.where(k <= 40, 10 * ramp, 1 - (k - 40) / 90)
    (tmp_path / "held.csv").write_text(table(k / 100, ramp, relaxed))
    more = '["rig.csv"]', '["rig.csv"]\n[[recording]]\nfiles = ["held.csv"]\nuse = "train"'
    sign = "[torque]", '[torque]\nsign = "fit"'
    soft, held = load_recordings(load_mapping(written(tmp_path, t, x, 0.03 * y, sign, more)))
    np.testing.assert_allclose(soft.tau_Nm, 0.03 * y, atol=1e-12)
    np.testing.assert_allclose(held.tau_Nm, relaxed, atol=1e-5)


def test_a_files_own_format_goes_before_the_mappings(tmp_path: Path) -> None:
    path = written(tmp_path, *rig(0.1, 0.1, 0.1, 0.1))
    (tmp_path / "other.csv").write_text((tmp_path / "rig.csv").read_text().replace(",", ";"))
    own = '["rig.csv"]\n[[recording]]\nfiles = ["other.csv"]\nformat = { delimiter = ";" }'
    a, b = load_recordings(load_mapping(mapped(tmp_path, ('["rig.csv"]', own))))
    np.testing.assert_array_equal(b.tau_Nm, a.tau_Nm)
    assert a.digest != b.digest
    assert path.name == "map.toml"


# -- cycles --------------------------------------------------------------------------------------


@settings(max_examples=60)
@given(
    cycles=st.integers(2, 8),
    noise=st.floats(0, 0.015),
    phase=st.floats(0, 6.28),
    seed=st.integers(0, 1000),
)
def test_reversals_count_the_cycles_in_noise(
    cycles: int, noise: float, phase: float, seed: int
) -> None:
    angle = phase + 2 * np.pi * np.arange(cycles * 97) / 97
    theta = np.sin(angle) + np.random.default_rng(seed).uniform(-noise, noise, len(angle))
    points = reversals(theta, 0.1)
    assert points == sorted(set(points))
    assert points[0] == 0
    assert points[-1] == len(theta) - 1
    inner = [p for p in points[1:-1] if abs(theta[p]) > 0.9]
    assert abs(len(inner) - 2 * cycles) <= 1
    signs = np.sign(theta[inner])
    assert (signs[1:] == -signs[:-1]).all()


def test_blocks_and_roles() -> None:
    one = np.sin(2 * np.pi * np.arange(100) / 100)
    theta = np.concatenate([np.tile(one, 5) * 0.1, np.tile(one, 5) * 0.2, [0.0]])
    cycles = divide(theta, Cycles(), "cycles")
    block = ["conditioning", "training", "training", "held_out"]
    assert [c.role for c in cycles] == [*block, "transition", *block]
    assert all(a.stop == b.start for a, b in itertools.pairwise(cycles))
    assert {c.role for c in divide(theta, Cycles(), "train")} == {"training"}


def test_one_sided_loading_is_a_cycle() -> None:
    theta = np.concatenate([np.linspace(0, 1, 100), np.linspace(1, 0, 100)])
    (cycle,) = divide(theta, Cycles(), "train")
    assert (cycle.start, cycle.stop) == (0, 199)
