"""The steps from a file to a recording one by one: limits at their ends, numbers by hand."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.errors import UserError
from esea_gen.identify.recording.mapping import MappingFile, load_mapping, parse_mapping
from esea_gen.identify.recording.quality import Finding
from esea_gen.identify.recording.reading import load_recordings
from esea_gen.identify.recording.reading import reading as recording
from esea_gen.identify.recording.tables import RecordingTable

MAPPING = """\
schema = 1
[device]
name = "rig"
title = "Rig"
rate_terms = false
[deflection]
column = "x"
unit = "rad"
[torque]
column = "y"
unit = "Nm"
[sampling]
time_column = "t"
[[recording]]
files = ["rig.csv"]
"""
PERIOD = 'time_column = "t"', 'period_s = { value = 0.01, status = "STATUS", source = "?" }'


def source(*changes: tuple[str, str]) -> MappingFile:
    text = MAPPING
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return MappingFile(parse_mapping(text, "map.toml"), "map.toml", Path())


def quantity(value: float) -> str:
    return f'{{ value = {value}, status = "assumed", source = "?" }}'


def loaded(folder: Path, columns: dict[str, np.ndarray], *changes: tuple[str, str]):
    names = [c[1] for c in changes if c[0] == '"rig.csv"'] or ['"rig.csv"']
    rows = zip(*columns.values(), strict=True)
    text = "\n".join([",".join(columns), *(",".join(f"{v:.17g}" for v in r) for r in rows)])
    for name in names[0].split(", "):
        (folder / name.strip('"')).write_text(text)
    (folder / "map.toml").write_text(_changed(*changes))
    return load_recordings(load_mapping(folder / "map.toml"))


def _changed(*changes: tuple[str, str]) -> str:
    text = MAPPING
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return text


def swings(cycles: int = 5) -> dict[str, np.ndarray]:
    """Cycles of 100 samples, 10 ms each, of a spring with a loss: 20 Nm/rad."""
    angle = 2 * np.pi * np.arange(100 * cycles + 1) / 100
    x = 0.1 * np.sin(angle)
    return {"t": np.arange(len(x)) * 0.01, "x": x, "y": 20 * x + 0.3 * np.cos(angle)}


# Length.


def times(*last: float) -> np.ndarray:
    return np.concatenate([np.arange(10.0), last])


def test_a_recording_has_twenty_million_steps_at_most():
    # 20000 s at 1 kHz; what counts is its last sample.
    at = source()
    recording._check_length(at, "rig", times(15000.0, 20000.0))
    with pytest.raises(UserError, match=r"lasts 2\.01e\+04 s.*after sample 10 of 12"):
        recording._check_length(at, "rig", times(18000.0, 20100.0))
    slow = source(('title = "Rig"', f'title = "Rig"\nsense_rate_Hz = {quantity(500)}'))
    recording._check_length(slow, "rig", times(39999.0))


def test_a_usual_step_is_a_fiftieth_of_the_sensing_period_at_least():
    at = source()
    recording._check_length(at, "rig", np.arange(100) * 2**-15)  # 30.5 us
    # 20 us but for rounding, which is far below a hundredth of it.
    recording._check_length(at, "rig", np.arange(100) * 20.001e-6)
    with pytest.raises(UserError, match=r"its usual step between samples is 2e-05 s"):
        recording._check_length(at, "rig", np.arange(100) * 19.999e-6)
    assert recording.LEAST_STEP == 2e-5 * 1000
    recording._check_length(at, "rig", np.array([0.0, 2e-5]))
    # The usual one is the median: a few quick ones are let pass.
    recording._check_length(at, "rig", np.cumsum(np.where(np.arange(100) < 40, 1e-6, 1e-3)))


def test_where_the_wrong_length_comes_from_is_told():
    long = np.arange(100.0) * 1e6
    for changes, said in (
        ((), "sampling.time_unit = 's'"),
        (((PERIOD[0], PERIOD[1].replace("STATUS", "assumed")),), "sampling.period_s"),
    ):
        with pytest.raises(UserError) as caught:
            recording._check_length(source(*changes), "rig", long)
        assert f"Check {said}," in caught.value.fix


# Time.


def test_samples_sooner_than_the_least_step_after_the_last_kept_one_are_dropped():
    time = np.array([0.0, 0.25, 0.375, 0.5, 0.625, 0.75, 0.9])
    # After 0.25 comes 0.5, by just the step; 0.625 and 0.9 are too near to what was kept.
    assert recording._keep(time, 0.25).tolist() == [0, 1, 3, 5]
    assert recording._keep(time, None).tolist() == list(range(7))
    assert recording._keep(time - 5, 0.25).tolist() == [0, 1, 3, 5]
    assert recording._keep(time - 5, None).dtype == recording._keep(time, 0.25).dtype == np.intp


@pytest.mark.parametrize(
    ("ms", "said"),
    [
        ((1, 2, 3, 3, 4), "stands still in column 't': 3 ms in row 12, then 3 ms in row 13 (1 "),
        ((1, 2, 5, 3, 1), "goes backwards in column 't': 5 ms in row 12, then 3 ms in row 13 (2 "),
        ((2, 1, 5, 6, 7), "goes backwards in column 't': 2 ms in row 10, then 1 ms in row 11 (1 "),
    ],
)
def test_a_time_that_does_not_rise_is_told_in_its_own_unit(ms, said):
    with pytest.raises(UserError) as caught:
        recording._check_time(np.array(ms) * 1e-3, np.arange(10, 15), "rig", "t", "ms")
    assert f"rig: time {said}such step" in str(caught.value)


def test_one_sample_in_a_hundred_may_be_dropped_and_time_starts_at_0(tmp_path):
    few = swings(4)
    for more in (4, 5):  # of 405 and of 406
        at = np.repeat(np.arange(401), np.where(np.arange(401) < more, 2, 1))
        columns = {k: v[at] for k, v in few.items()}
        columns["t"] = columns["t"] + 7.0
        rule = ('time_column = "t"', 'time_column = "t"\nmin_step_s = 0.005')
        if more == 5:
            with pytest.raises(UserError, match="would drop 5 of 406 samples"):
                loaded(tmp_path, columns, rule)
            continue
        (r,) = loaded(tmp_path, columns, rule)
        assert r.dropped == 4
        np.testing.assert_allclose(r.time_s, few["t"], atol=1e-12)
        np.testing.assert_allclose(r.theta_rad, few["x"], atol=1e-12)
        np.testing.assert_allclose(r.tau_Nm, few["y"], atol=1e-12)
    # Just one in a hundred: 4 of 400.
    at = np.repeat(np.arange(396), np.where(np.arange(396) < 4, 2, 1))
    columns = {k: v[at] for k, v in few.items()}
    assert loaded(tmp_path, columns, rule)[0].dropped == 4
    # And a little more: 5 of 498.
    at = np.repeat(np.arange(493), np.where(np.arange(493) < 5, 2, 1))
    with pytest.raises(UserError, match="would drop 5 of 498 samples"):
        loaded(tmp_path, {k: v[at] for k, v in swings(5).items()}, rule)


@pytest.mark.parametrize("status", ["assumed", "published"])
def test_a_period_makes_the_time_which_is_known_unless_it_is_assumed(tmp_path, status):
    made = swings(4)
    (r,) = loaded(tmp_path, made, (PERIOD[0], PERIOD[1].replace("STATUS", status)))
    np.testing.assert_allclose(r.time_s, made["t"], atol=1e-12)
    assert r.timed == (status == "published")
    assert r.dropped == 0
    (r,) = loaded(tmp_path, made)
    assert r.timed


@pytest.mark.parametrize(("count", "few"), [(50, False), (49, True)])
def test_fifty_samples_are_enough(tmp_path, count, few):
    columns = {k: v[::8][:count] for k, v in swings(4).items()}
    train = ('files = ["rig.csv"]', 'files = ["rig.csv"]\nuse = "train"')
    judge = '\n[[recording]]\nfiles = ["rig.csv"]\nuse = "held_out"'
    (tmp_path / "again.csv").write_text("t,x,y\n" + "".join(
        f"{a},{b},{c}\n" for a, b, c in zip(*swings(4).values(), strict=True)))  # fmt: skip
    more = train[0], train[1] + judge.replace("rig.csv", "again.csv")
    if few:
        with pytest.raises(UserError, match="has 49 samples, below the limit of 50"):
            loaded(tmp_path, columns, more)
    else:
        assert len(loaded(tmp_path, columns, more)[0].time_s) == 50


# Lag of the torque.


@pytest.mark.parametrize(("lag", "first"), [(0.25, 0), (-0.25, 1)])
def test_a_lag_takes_the_torque_from_later_and_drops_the_ends(lag, first):
    time = np.arange(100) * 0.25 + 3
    theta, tau = np.arange(100.0), np.arange(100.0) ** 2
    t, x, y = recording._without_lag("rig", lag, time, theta, tau)
    assert t.tolist() == (np.arange(99) * 0.25).tolist()
    assert x.tolist() == theta[first : first + 99].tolist()
    assert y.tolist() == tau[1 - first : 100 - first].tolist()
    # Between two samples, a straight line; nothing beyond either end.
    t, x, y = recording._without_lag("rig", lag / 2, time, theta, tau)
    assert x.tolist() == theta[first : first + 99].tolist()
    assert y.tolist() == (0.5 * (tau[1:] + tau[:-1])).tolist()


def test_a_lag_leaves_fifty_samples_at_least():
    time = np.arange(60) * 0.25
    assert len(recording._without_lag("rig", 2.5, time, time, time)[0]) == 50
    with pytest.raises(UserError, match=r"lag_s = 2\.75 s leaves 49 samples, below the limit of"):
        recording._without_lag("rig", 2.75, time, time, time)


# Temperature.


def temperature(values: list[float], unit: str) -> float | None:
    m = SimpleNamespace(temperature=SimpleNamespace(column="T", unit=unit))
    table = RecordingTable(files=["a"])
    return recording._temperature(m, table, "rig", {"T": np.array(values)})


def test_a_column_of_temperatures_gives_its_mean_in_degrees_celsius():
    assert temperature([20.0, 21.0, 23.0], "C") == pytest.approx(64 / 3)
    assert temperature([293.15, 294.15, 296.15], "K") == pytest.approx(64 / 3)
    # From -60 to 200 degC, and within 3 K.
    assert temperature([-60.0, -57.0], "C") == -58.5
    assert temperature([197.0, 200.0], "C") == 198.5
    for wrong, said in (
        ([-60.1, -59.0], "goes from -60.1 to -59 degC, outside -60 to 200 degC"),
        ([199.0, 200.1], "goes from 199 to 200.1 degC, outside"),
        ([20.0, 23.1], "from 20 to 23.1 degC, by more than 3 K"),
    ):
        with pytest.raises(UserError) as caught:
            temperature(wrong, "C")
        assert said in str(caught.value)


def test_without_a_column_the_files_own_temperature_stands():
    m = SimpleNamespace(temperature=None)
    said = recording.RecordingTable(
        files=["a"], temperature_C={"value": 31.5, "status": "assumed", "source": "?"}
    )
    assert recording._temperature(m, said, "rig", {}) == 31.5
    assert recording._temperature(m, RecordingTable(files=["a"]), "rig", {}) is None


def test_the_thermometers_column_is_read_from_the_file(tmp_path):
    made = swings(4) | {"bath": np.full(401, 300.15)}
    table = "[sampling]", '[temperature]\ncolumn = "bath"\nunit = "K"\n[sampling]'
    (r,) = loaded(tmp_path, made, table)
    assert r.temperature_C == pytest.approx(27.0)


# Zero, dead zone, gap.


@pytest.mark.parametrize(
    ("zero", "offset"), [("none", 0.0), ("first", 1.0), ("mean", 3.0), ("middle", 1.5)]
)
def test_what_is_subtracted(zero, offset):
    x = np.array([1.0, 2.0, 11.0, 9.0, -8.0])
    assert recording._zeroed(x, zero).tolist() == (x - offset).tolist()


def test_each_channel_has_its_own_zero_and_its_own_columns(tmp_path):
    made = swings(4)
    moved = {"t": made["t"], "x": made["x"] + 0.02, "y": made["y"] + 3.0}
    zeros = (
        ("[deflection]", '[deflection]\nzero = "first"'),
        ("[torque]", '[torque]\nzero = "middle"'),
    )
    (r,) = loaded(tmp_path, moved, *zeros)
    np.testing.assert_allclose(r.theta_rad, made["x"], atol=1e-12)
    np.testing.assert_allclose(r.tau_Nm, made["y"], atol=1e-12)


def test_a_gap_is_told_as_stopping_where_there_is_one():
    gap = source(("[deflection]", f"[deflection]\nbacklash_rad = {quantity(0.0125)}"))
    none = source(("[deflection]", f"[deflection]\nbacklash_rad = {quantity(0.0)}"))
    (f,) = recording._gap(gap.mapping.deflection.backlash_rad)
    assert (f.kind, f.stops) == ("backlash taken out", True)
    assert f.text.startswith("a backlash of 0.0125 rad is taken out of the deflection")
    assert recording._gap(none.mapping.deflection.backlash_rad) == recording._gap(None) == ()


# What is told of spikes and jumps.


@pytest.mark.parametrize(
    ("count", "text"),
    [
        (1, "1 sample at which the deflection jumps and comes back, bridged; they neither train"),
        (2, "2 samples at which the deflection jumps"),
    ],
)
def test_jumps_are_counted_in_plain_words(count, text):
    (f,) = recording._jumped(np.arange(9) < count)
    assert f.text.startswith(text)
    assert (f.kind, f.stops) == ("jumps", False)
    assert recording._jumped(np.zeros(9, dtype=bool)) == ()


def test_more_spikes_than_one_sample_in_a_hundred_are_noise():
    mask = np.zeros(200, dtype=bool)
    mask[[20, 21, 90]] = True
    tau = np.where(mask, -7.125, 2.0)
    told = "2 spikes (3 samples) in the torque, up to 7.125 Nm"
    # Two of 200 are just one in a hundred.
    (f,) = recording._spiked(mask, tau)
    assert (f.kind, f.stops, f.text) == ("spikes", False, f"{told}, neither train nor judge")
    (f,) = recording._spiked(mask[:199], tau[:199])
    assert (f.kind, f.stops, f.text) == ("noise", True, f"{told}: more than 1% of all samples")


# Physics.


def test_ends_of_deflection_torque_and_stiffness():
    at = source(('title = "Rig"', 'title = "Rig"\nlimit_factor = 2.0'))
    x = np.array([-1.0, 1.0, -1.0, 1.0])
    # A device's range is 3.2 rad at most, twice what was recorded; 1000 Nm; 1000 Nm/rad.
    recording._check_physics(at, "rig", 1.6 * x, x)
    recording._check_physics(at, "rig", 1.6 * x, 1000 * x)
    recording._check_physics(at, "rig", 0.5 * x, 500 * x)
    recording._check_physics(at, "rig", x, 1e-9 * x)
    for theta, tau, said in (
        (1.601 * x, x, r"\|deflection\| is 1\.601 rad after scaling, above the limit of 1\.6 rad"),
        (1.6 * x, 1000.5 * x, r"the largest \|torque\| is 10.* above the limit of 1000 Nm"),
        (0.5 * x, 500.5 * x, "the stiffness is 1001 Nm/rad after scaling, above the limit of 1000"),
        (x, 0 * x, "no stiffness"),
        (x, -1e-9 * x, "negative stiffness"),
    ):
        with pytest.raises(UserError, match=said):
            recording._check_physics(at, "rig", theta, tau)


def test_a_deflection_of_a_nanoradian_is_none():
    with pytest.raises(UserError, match=r"the deflection is constant \(column 'x'\)"):
        recording._check_moves("rig", np.array([0.0, 1e-9]), "x")
    recording._check_moves("rig", np.array([-0.51e-9, 0.0, 0.5e-9]), "x")


def test_behind_a_gap_as_wide_as_its_range_a_deflection_is_constant(tmp_path):
    wide = "[deflection]", f"[deflection]\nbacklash_rad = {quantity(0.201)}"
    with pytest.raises(UserError, match="the deflection is constant"):
        loaded(tmp_path, swings(4), wide)


def test_the_stiffness_is_the_slope_of_the_straight_line_through_all_samples():
    x = np.array([1.0, 2.0, 4.0, 9.0])
    y = np.array([3.0, 5.0, 5.0, 9.0])
    # Means 4 and 5.5: -3, -2, 0, 5 and -2.5, -0.5, -0.5, 3.5 give 26 over 38.
    assert recording._stiffness(x, y) == pytest.approx(26 / 38, rel=1e-12)
    assert recording._stiffness(np.ones(4), y) == 0


def test_the_stiffness_of_a_test_of_relaxation_is_that_of_its_ramp():
    x = np.concatenate([np.arange(11) / 10, np.ones(30)])
    # Up to the first sample at the end: of x^2 over 0 to 1 the slope is 1, over 0 to 0.9 it is 0.9.
    y = np.concatenate([np.arange(11) ** 2 / 100, np.linspace(0.9, -3.0, 30)])
    assert recording._stiffness(x, y) == pytest.approx(1.0, rel=1e-12)
    assert recording._stiffness(3 - x, -y) == pytest.approx(1.0, rel=1e-12)


def test_a_deflection_is_held_within_a_fiftieth_of_its_way_for_more_than_half():
    x = np.array([2.0, 2.9799, 2.98, 2.99, 3.0, 1.1])
    # The farthest from the first sample is 1 off: what is 0.98 off or more is at the end.
    assert recording._at_end(x - 2).tolist() == [False, False, True, True, True, False]
    assert recording._at_end(2 - x).tolist() == [False, False, True, True, True, False]
    assert not recording._held(x)
    assert recording._held(np.append(x, 3.0))
    assert recording._held((np.arange(201) >= 100) * 1.0)  # 101 of 201
    assert not recording._held((np.arange(201) >= 101) * 1.0)


# Files.


def labels(*files: tuple[str, RecordingTable]) -> list[str]:
    return recording._labels("map.toml", list(files))


def test_labels_of_files():
    plain = RecordingTable(files=["*.csv"])
    own, other = (RecordingTable(files=["*"], label=x) for x in ("slow", "quick"))
    assert labels(("a/b.csv", plain), ("c.csv", plain)) == ["b", "c"]
    assert labels(("a/b.csv", plain), ("d/b.csv", plain)) == ["a/b", "d/b"]
    # The only file of a table has the table's label, of several each has its own name beside it.
    assert labels(("b.csv", own), ("c.csv", plain), ("d.csv", other)) == ["slow", "c", "quick"]
    assert labels(("b.csv", own), ("c.csv", own)) == ["slow b", "slow c"]
    assert labels(("a/b.csv", own), ("c/b.csv", own)) == ["slow a/b", "slow c/b"]
    with pytest.raises(UserError, match=r"the label 'c' of 'c\.csv' is used by another recording"):
        labels(("b.csv", RecordingTable(files=["b.csv"], label="c")), ("c.csv", plain))


def test_conditions_are_those_of_whose_patterns_one_matches(tmp_path):
    rules = (
        "[sampling]",
        '[[condition]]\nname = "slow"\nfiles = ["x*", "rig.*"]\n'
        '[[condition]]\nname = "all"\nfiles = ["*.csv"]\n'
        '[[condition]]\nname = "odd"\nfiles = ["odd.csv"]\n[sampling]',
    )
    names = '"rig.csv"', '"rig.csv", "odd.csv"'
    found = loaded(tmp_path, swings(4), rules, names)
    assert [r.conditions for r in found] == [("slow", "all"), ("all", "odd")]
    with pytest.raises(UserError, match=r"condition 'odd': none .* is named odd\.csv"):
        loaded(tmp_path, swings(4), rules)


def test_on_one_rig_all_files_may_be_turned(tmp_path):
    made = swings(4)
    made["y"] = -made["y"]
    sign = "[torque]", '[torque]\nsign = "fit"'
    both = loaded(tmp_path, made, sign, ('"rig.csv"', '"rig.csv", "odd.csv"'))
    for r in both:
        assert recording.TURNED in r.findings
        assert np.polyfit(r.theta_rad, r.tau_Nm, 1)[0] == pytest.approx(20, rel=0.01)


def test_what_is_soft_or_relaxes_to_the_other_side_is_not_turned(tmp_path):
    made = swings(4)
    k = np.arange(401)
    # Held after its first tenth, while the torque goes from 1 to -3: what counts is how it rose.
    ramp = np.minimum(k, 40) / 400
    relaxed = {"t": made["t"], "x": ramp, "y": np.where(k <= 40, 10 * ramp, 1 - (k - 40) / 90)}
    rows = [f"{a},{b},{c}" for a, b, c in zip(*relaxed.values(), strict=True)]
    (tmp_path / "held.csv").write_text("\n".join(["t,x,y", *rows]))
    more = (
        'files = ["rig.csv"]',
        'files = ["rig.csv"]\n[[recording]]\nfiles = ["held.csv"]\nuse = "train"',
    )
    soft = made | {"y": 0.03 * made["y"]}  # 0.6 Nm/rad
    found = loaded(tmp_path, soft, ("[torque]", '[torque]\nsign = "fit"'), more)
    assert [recording.TURNED in r.findings for r in found] == [False, False]
    np.testing.assert_allclose(found[0].tau_Nm, soft["y"], atol=1e-12)
    np.testing.assert_allclose(found[1].tau_Nm, relaxed["y"], atol=1e-12)


def test_a_files_own_format_goes_before_the_mappings(tmp_path):
    made = swings(4)
    rows = zip(*made.values(), strict=True)
    text = "\n".join(["t;x;y", *(";".join(f"{v:.12g}" for v in r) for r in rows)])
    (tmp_path / "other.csv").write_text(text)
    both = (
        'files = ["rig.csv"]',
        'files = ["rig.csv"]\n[[recording]]\nfiles = ["other.csv"]\nformat = { delimiter = ";" }',
    )
    a, b = loaded(tmp_path, made, both)
    np.testing.assert_allclose(b.tau_Nm, a.tau_Nm, atol=1e-9)
    assert (a.label, b.label, a.file, b.file) == ("rig", "other", "rig.csv", "other.csv")
    # sha256sum other.csv, of which sixteen digits stand for the file.
    assert len(a.digest) == len(b.digest) == 16
    assert a.digest != b.digest


def test_without_a_cycle_to_train_or_to_judge_both_are_told(tmp_path):
    rules = "[sampling]", "[cycles]\nskip_first = 9\n[sampling]"
    with pytest.raises(UserError, match=r"left to train on \(cycles found - rig.csv: 4; "):
        loaded(tmp_path, swings(5), rules)
    rules = "[sampling]", "[cycles]\nskip_first = 0\nhold_out_last = 9\n[sampling]"
    with pytest.raises(UserError, match=r"cycle is left to train on .*hold_out_last = 9"):
        loaded(tmp_path, swings(5), rules)


def test_a_number_left_to_the_fit_is_refused_before_any_file_is_read():
    for key, table in (("lag_s", "[torque]"), ("backlash_rad", "[deflection]")):
        with pytest.raises(UserError, match=rf"\.{key} = 'fit' is found by esea-gen identify"):
            load_recordings(source((table, f'{table}\n{key} = "fit"')))


def test_findings_stand_in_the_order_in_which_the_file_was_worked_on(tmp_path):
    made = swings(8)
    made["x"][325] += 0.03
    made["y"][550] += 9.0
    made["y"] = -made["y"]
    changes = (
        ("[torque]", '[torque]\nsign = "fit"'),
        ("[deflection]", f"[deflection]\nbacklash_rad = {quantity(1e-6)}"),
    )
    (r,) = loaded(tmp_path, made, *changes)
    kinds = [f.kind for f in r.findings]
    assert kinds == ["jumps", "spikes", "sign", "backlash taken out"]
    assert all(isinstance(f, Finding) for f in r.findings)
