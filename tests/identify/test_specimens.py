"""Several specimens: one model for all of them, and how far their recordings agree."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from esea_gen.cli import app
from esea_gen.errors import UserError
from esea_gen.identify.recording.mapping import load_mapping
from esea_gen.identify.recording.reading import load_recordings
from esea_gen.identify.reliability import NODES, coefficients, joint_fit, torque_table
from tests.result_schemas import held
from tests.rigs import mapped, rig

FACTORS = {"a": 1.0, "b": 1.1, "c": 0.8}


def conditions(names) -> str:
    return "".join(f'\n[[condition]]\nname = "{n}"\nfiles = ["{n}.csv"]\n' for n in names)


def recorded(folder, factors=FACTORS, names=None):
    t, x, y = rig(*(0.1,) * 4)
    for name, factor in factors.items():
        rows = np.column_stack([t, x, factor * y])
        np.savetxt(folder / f"{name}.csv", rows, "%.9g", ",", header="t,x,y", comments="")
    files = ", ".join(f'"{n}.csv"' for n in factors)
    last = "[cycles]\nhold_out_last = 1\n[sampling]"
    path = mapped(folder, ('"rig.csv"', files), ("[sampling]", last))
    path.write_text(path.read_text() + conditions(names or factors))
    return path


def test_a_table_has_the_torques_at_the_same_deflections(tmp_path):
    recordings = load_recordings(load_mapping(recorded(tmp_path)))
    table = torque_table({r.conditions[0]: [r] for r in recordings})
    assert list(table) == list(FACTORS)
    assert len(table["a"]) == 2 * NODES
    for name, factor in FACTORS.items():
        np.testing.assert_allclose(table[name], factor * table["a"], rtol=1e-6, atol=1e-9)
    # On the way up first, by deflection; a loop is wider on the way up.
    up, down = table["a"][:NODES], table["a"][NODES:]
    assert np.all(np.diff(up) > 0)
    assert np.all(up > down)
    middle = 0.09 * 2 * (NODES - 1) / NODES / 2
    assert up[-1] - up[0] == pytest.approx(2 * (20 * middle + 500 * middle**3), rel=0.2)


@pytest.mark.ci
def test_one_model_for_all_costs_what_the_specimens_differ_by(tmp_path):
    out, two = tmp_path / "r.json", {"a": 1.0, "b": 0.8}
    done = CliRunner().invoke(app, f"reliability {recorded(tmp_path, two)} --json {out}")
    assert done.exit_code == 0, done.output
    found = json.loads(out.read_text())
    held("reliability", found)
    # The least squares' mean of the factors, and the loop's RMS torque.
    rms = 100 * float(np.sqrt(np.mean(rig(*(0.1,) * 4)[2][400:] ** 2))) / found["full_scale_Nm"]
    mean = np.mean(list(two.values()))
    for name, factor in two.items():
        assert found["own_pct"][name] < 1.0
        expected = np.hypot(abs(factor - mean) * rms, found["own_pct"][name])
        assert found["joint_pct"][name] == pytest.approx(expected, abs=0.5)
    assert "one model for all" in done.output
    recordings = load_recordings(load_mapping(tmp_path / "map.toml"))
    table = torque_table({r.conditions[0]: [r] for r in recordings})
    two, three = coefficients(np.column_stack(list(table.values())))
    assert found["absolute"]["value"] == pytest.approx(two.value)
    assert found["consistent"]["value"] == pytest.approx(three.value)


def test_what_is_no_set_of_specimens_is_refused(tmp_path):
    with pytest.raises(UserError, match=r"c\.csv belongs to 0 conditions"):
        joint_fit(recorded(tmp_path, names=("a", "b")))
    path = recorded(tmp_path)
    text = path.read_text()
    # By default the condition in the middle judges as a whole: here that is a specimen.
    path.write_text(text.replace("hold_out_last = 1", ""))
    with pytest.raises(UserError, match="specimen 'a' has nothing to hold out"):
        joint_fit(path)
    path.write_text(text)
    recordings = load_recordings(load_mapping(path))
    with pytest.raises(UserError, match="different numbers of files"):
        torque_table({"a": recordings[:2], "b": recordings[2:]})
