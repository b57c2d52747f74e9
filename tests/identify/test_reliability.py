"""Agreement of specimens against published examples and formulas of other tools."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
import statsmodels.api as sm
from scipy.stats import f_oneway
from statsmodels.formula.api import ols
from typer.testing import CliRunner

from esea_gen.cli import app
from esea_gen.errors import UserError
from esea_gen.identify.reliability import (
    agreement,
    coefficients,
    mean_squares,
    read_specimens,
    reliability,
)

# Shrout and Fleiss 1979, table 2: six targets, four judges.
SHROUT = np.array(
    [[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]], float
)


def test_the_published_example():
    # Table 3 of the paper: mean squares; table 4: coefficients.  Intervals as R's psych and
    # pingouin print them for these data.
    assert mean_squares(SHROUT) == pytest.approx((11.24, 32.49, 1.02), abs=0.005)
    two, three = coefficients(SHROUT)
    assert two.value == pytest.approx(0.29, abs=0.005)
    assert three.value == pytest.approx(0.71, abs=0.005)
    assert (two.low, two.high) == pytest.approx((0.02, 0.76), abs=0.005)
    assert (three.low, three.high) == pytest.approx((0.34, 0.95), abs=0.005)


def test_mean_squares_against_another_tool():
    rng = np.random.default_rng(0)
    table = rng.normal(0, 1, (8, 1)) + rng.normal(0, 0.3, (1, 3)) + rng.normal(0, 0.2, (8, 3))
    rows, columns = np.indices(table.shape)
    data = {"y": table.ravel(), "row": rows.ravel(), "column": columns.ravel()}
    anova = sm.stats.anova_lm(ols("y ~ C(row) + C(column)", pd.DataFrame(data)).fit())
    assert mean_squares(table) == pytest.approx(tuple(anova["mean_sq"]))
    # Consistency does not see a constant of each specimen; agreement does.
    moved = table + np.array([0.0, 2.0, -1.0])
    assert coefficients(moved)[1].value == pytest.approx(coefficients(table)[1].value)
    assert coefficients(moved)[0].value < 0.7 * coefficients(table)[0].value
    assert f_oneway(*moved.T).pvalue < 0.05  # the constant is one that shows


def test_intervals_hold_the_truth_as_often_as_they_say():
    # Variances 1, 0.2 and 0.1 of rows, specimens and rest: 1/1.3 and 1/1.1.
    rng = np.random.default_rng(4)
    held = np.zeros(2)
    for _ in range(300):
        table = (
            rng.normal(0, 1, (20, 1))
            + rng.normal(0, np.sqrt(0.2), (1, 6))
            + rng.normal(0, np.sqrt(0.1), (20, 6))
        )
        truth = (1 / 1.3, 1 / 1.1)
        held += [c.low <= x <= c.high for c, x in zip(coefficients(table), truth, strict=True)]
    # Of consistency the interval is exact; of agreement it is Satterthwaite's approximation, which
    # is somewhat narrow with few specimens.
    assert 0.92 < held[1] / 300 < 0.985
    assert 0.87 < held[0] / 300 < 0.985


def test_specimens_of_a_table_and_the_command(tmp_path):
    rng = np.random.default_rng(2)
    true = np.linspace(-4, 4, 12)
    table = {
        "a": true * 1.00 + rng.normal(0, 0.02, 12),
        "b": true * 1.02 + rng.normal(0, 0.02, 12),
        "odd": true * 1.2 + 0.3,
    }
    path, out = tmp_path / "t.csv", tmp_path / "t.json"
    lines = ["condition," + ",".join(table)]
    lines += [f"c{i}," + ",".join(repr(float(x[i])) for x in table.values()) for i in range(12)]
    path.write_text("\n".join(lines) + "\n")
    done = CliRunner().invoke(app, ["reliability", str(path), "--json", str(out)])
    assert done.exit_code == 0, done.output
    assert "ICC(2,1)" in done.output
    assert "2.93" in done.output  # chapter 3's beside it
    found, own = json.loads(out.read_text()), reliability(table)
    assert found["absolute"]["value"] == pytest.approx(own.absolute.value, rel=1e-9)
    assert max(own.apart_pct, key=own.apart_pct.__getitem__) == "odd"
    assert len(own.agreements) == 3
    biases = {(x.first, x.second): x.bias_Nm for x in own.agreements}
    assert biases["a", "odd"] == pytest.approx(np.mean(table["a"] - table["odd"]))


def test_limits_of_agreement_worked_out_by_hand():
    """Differences -2 to 2: deviation sqrt(2.5), z 1.959964, t of four degrees 2.776445."""
    first = np.array([10.0, 12.0, 14.0, 16.0, 18.0])
    bias, low, high, half = agreement(first + [-2, -1, 0, 1, 2] + 0.5, first)
    assert bias == pytest.approx(0.5)
    assert (low, high) == pytest.approx((0.5 - 3.098975, 0.5 + 3.098975), abs=1e-6)
    # Of a limit: sd sqrt(1/5 + z^2 / 8), as var(sd) is sd^2 / (2 (n - 1)) [Bland, Altman 1999].
    assert half == pytest.approx(2.776445 * 1.581139 * np.sqrt(0.2 + 3.841459 / 8), rel=1e-6)


@pytest.mark.parametrize("size", [1e-5, 1.0, 1e7])
def test_what_rounding_alone_leaves_is_no_variance_whatever_the_torques_size(size):
    true = size * np.array([0.1, 0.7, -0.3, 0.9, 0.2, -0.8])
    shifted = true + 0.3 * size  # rounded once more in each row
    with pytest.raises(UserError, match="differ only by a constant"):
        reliability({"a": true, "b": shifted})
    # A billionth of the torque is a difference.
    rng = np.random.default_rng(3)
    found = reliability({"a": true, "b": shifted + 1e-9 * size * rng.normal(size=6)})
    assert found.consistent.value == pytest.approx(1.0)


def test_the_fewest_specimens_and_conditions():
    rows = {"a": np.array([1.0, 3, 2, 5, 4]), "b": np.array([1.5, 3, 2.5, 5, 4.5])}
    assert reliability(rows).rows == 5
    for wrong, words in (
        ({"a": rows["a"]}, r"1 specimens at \[5\] conditions: reliability needs 2 or more at the"),
        ({n: x[:4] for n, x in rows.items()}, r"2 specimens at \[4\] .* same 5 or more"),
        (rows | {"c": np.zeros(7)}, r"3 specimens at \[5, 7\] conditions"),
        (rows | {"c": np.array([1, 2, np.nan, 4, np.inf])}, "specimen c, condition 3: no finite"),
        # Conditions that differ in no mean, though the specimens do.
        ({"a": np.arange(5.0), "b": -np.arange(5.0)}, "or the conditions do not differ"),
    ):
        with pytest.raises(UserError, match=words):
            reliability(wrong)


def test_a_table_of_specimens_is_read(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(" Condition , left,right \nslow,1,2.5\n\nfast,-3e1, 4\n")
    _, found = read_specimens(path)
    assert {n: x.tolist() for n, x in found.items()} == {"left": [1, -30], "right": [2.5, 4]}
    path.write_text("conditions,a\n1,2\n")
    assert list(read_specimens(path)[1]) == ["conditions", "a"]
    for text in ("a,b,simulated\n1,2,1\n", "# simulated\na,b\n1,2\n"):
        path.write_text(text)
        table, found = read_specimens(path)
        assert list(found) == ["a", "b"]
        assert table.report().endswith("; SIMULATED")
    path.write_text("a,b [mNm]\n1,2\n")
    with pytest.raises(UserError, match="states the unit mNm"):
        read_specimens(path)
    path.write_text("row,a\n" + "".join(f"{k},{k * k}\n" for k in range(1, 6)))
    with pytest.raises(UserError, match="column 'row' counts the rows, from 1 to 5"):
        read_specimens(path)
    path.write_text("a,,b\n1,2,3\n")
    with pytest.raises(UserError, match="does not name each specimen"):
        read_specimens(path)
