"""Several specimens: one model for all of them, and how far their recordings agree."""

import json
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from esea_gen.cli import app
from esea_gen.errors import UserError
from esea_gen.identify import specimens as specimens_file
from esea_gen.identify.recording.mapping import load_mapping
from esea_gen.identify.recording.reading import load_recordings
from esea_gen.identify.reliability import coefficients
from esea_gen.identify.specimens import NODES, joint_fit, torque_table

from .result_schemas import held
from .test_quality import mapped, rig

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
    y = rig(*(0.1,) * 4)[2][400:]
    rms = 100 * float(np.sqrt(np.mean(y**2))) / found["full_scale_Nm"]
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


def test_errors_are_means_over_a_specimens_blocks_in_percent_of_one_full_scale(
    tmp_path, monkeypatch
):
    """Every fit is made up: errors by what it trains on and by block; a block without one too."""
    rms_Nm = {"all": {"a": 0.4, "b": 0.1}, "a": {"a": 0.2}, "b": {"b": 0.05}}
    said, fits = [], []

    def fit(source, some, template, tell, how):
        specimens = sorted({c for r in some for c in r.conditions})
        of = rms_Nm["all" if len(specimens) > 1 else specimens[0]]
        fits.append(specimens)
        blocks = [(s, r.conditions[0]) for r in some for s in r.sets]
        sets = [(s, None, SimpleNamespace(rms=of[c])) for s, c in blocks]
        sets.append((SimpleNamespace(label="nothing held out"), None, None))
        # The full scale is that of the fit to all.
        device = SimpleNamespace(tau_full_scale_Nm=8.0 if len(specimens) > 1 else 5.0)
        return None, None, device, SimpleNamespace(misfits=SimpleNamespace(sets=sets))

    monkeypatch.setattr(specimens_file, "fit_split", fit)
    monkeypatch.setattr(specimens_file, "draft", lambda source, some, rate: None)
    path = recorded(tmp_path, {"a": 1.0, "b": 0.8})
    found = joint_fit(path, progress=lambda share, text: said.append((share, text)))
    assert fits == [["a", "b"], ["a"], ["b"]]
    assert found.full_scale_Nm == 8.0
    assert found.joint_pct == pytest.approx({"a": 5.0, "b": 1.25})
    assert found.own_pct == pytest.approx({"a": 2.5, "b": 0.625})
    assert said == [
        (0, "fit of all together"),
        (pytest.approx(1 / 3), "fit of a"),
        (pytest.approx(2 / 3), "fit of b"),
    ]


def zigzag(corners, factor, seed) -> SimpleNamespace:
    """A deflection over straight lines of 40 samples, a torque that is any number."""
    theta = factor * np.concatenate(
        [np.linspace(a, b, 40, endpoint=False) for a, b in pairwise(corners)]
    )
    rows = np.random.default_rng(seed).permutation(len(theta))
    sets = (
        SimpleNamespace(training=rows[:50], held_out=rows[50:60]),
        SimpleNamespace(training=rows[60:60], held_out=rows[65:]),
    )
    tau = np.random.default_rng(seed + 1).normal(size=len(theta))
    return SimpleNamespace(theta_rad=theta, tau_Nm=tau, sets=sets)


def test_each_cell_is_the_mean_between_two_deflections_on_one_way():
    corners = ((0.0, 0.1, -0.07, 0.09, 0.0), (0.0, 0.05, -0.05, 0.0))
    specimens = {
        n: [zigzag(c, f, 10 * k + i) for i, c in enumerate(corners)]
        for k, (n, f) in enumerate({"a": 1.0, "b": 0.8, "c": 1.1}.items())
    }
    expected = {n: [] for n in specimens}
    for test in range(2):
        some = {n: r[test] for n, r in specimens.items()}
        used = {}
        for n, r in some.items():
            used[n] = sorted(k for s in r.sets for k in (*s.training, *s.held_out))
        # Nine tenths of what all of them reach to either side, in nine parts.
        low = 0.9 * max(min(some[n].theta_rad[used[n]]) for n in some)
        high = 0.9 * min(max(some[n].theta_rad[used[n]]) for n in some)
        for up in (True, False):
            for node in range(9):
                between = [low + (high - low) * (node + e) / 9 for e in (0, 1)]
                for n, r in some.items():
                    cell = []
                    for k in used[n]:
                        before = r.theta_rad[max(k - 1, 0)]
                        after = r.theta_rad[min(k + 1, len(r.theta_rad) - 1)]
                        way = after - before
                        if between[0] <= r.theta_rad[k] < between[1] and way * (1, -1)[not up] > 0:
                            cell.append(r.tau_Nm[k])
                    expected[n].append(np.mean(cell) if cell else None)
    kept = [k for k in range(36) if all(e[k] is not None for e in expected.values())]
    assert 20 < len(kept) <= 36
    found = torque_table(specimens)
    assert list(found) == ["a", "b", "c"]
    for n, cells in expected.items():
        assert found[n] == pytest.approx([cells[k] for k in kept])
    # Where one of them never was there is no cell.
    one = specimens["b"][1]
    one.sets = (SimpleNamespace(training=np.arange(20), held_out=np.arange(0)),)
    assert len(torque_table(specimens)["a"]) < len(kept)
