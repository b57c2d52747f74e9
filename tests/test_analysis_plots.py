"""What the pictures of experiments draw: curves, bars and bands, with numbers and names."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from esea_gen.analysis.plots import (
    crossed,
    rms_by_case,
    save,
    torque_tracking,
)
from esea_gen.errors import UserError

N = 50
T = np.linspace(0, 2, N)
DESIRED = np.sin(T)


def test_cases_that_ended_badly_are_crossed_wherever_they_stand():
    figure = rms_by_case(["a", "b\nlong"], {"mpc": [1.0, 2.0]})
    figure.axes[0].set_title("smc: a: 3", loc="left")
    figure.axes[0].set_title("ab", loc="center")
    assert crossed(figure, {}) is figure
    assert figure.get_supxlabel() == ""
    done = crossed(figure, {"a": "tripped", "long": "failed"})
    (axes,) = done.axes
    assert [t.get_text() for t in axes.get_xticklabels()] == ["✗ a", "✗ b\nlong"]
    assert axes.get_xticks().tolist() == [0, 1]
    assert (axes.get_title("left"), axes.get_title("center")) == ("✗ smc: a: 3", "ab")
    assert done.get_supxlabel() == "✗ a: tripped\n✗ long: failed"
    for count, last in ((6, "✗ 5: off"), (7, "and 1 more cases"), (9, "and 3 more cases")):
        said = crossed(Figure(), {str(k): "off" for k in range(count)}).get_supxlabel()
        assert said.split("\n")[5:] == ["✗ 5: off", *([last] if count > 6 else [])]


def test_a_picture_of_an_unknown_kind_is_refused(tmp_path):
    figure = torque_tracking(T, DESIRED, DESIRED)
    with pytest.raises(UserError, match=r"x.abc: cannot be drawn .*Format 'abc'"):
        save(figure, tmp_path / "x.abc")
    save(figure, tmp_path / "X.SVG")
    assert (tmp_path / "X.SVG").read_text(encoding="utf-8").lstrip().startswith("<?xml")
    assert figure.get_dpi() == 130
