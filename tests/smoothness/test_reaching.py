"""Reaching on a screen: published recordings and their published results, and reaches by hand."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from esea_gen.errors import UserError
from esea_host.cli.app import app
from esea_host.recording.foreign import import_table, read_mapping
from esea_host.recording.log import open_log
from esea_host.wrist.reaching import reaches, summary
from tests.conftest import ROOT

HERE = ROOT / "tests"
DATA = HERE / "data" / "reach_stroke"
MAPPING = HERE.parent / "examples" / "reach_stroke.toml"
# Samples, duration, peak and mean speed, as the recordings' authors give them.
PUBLISHED = {
    "cp01-1": [
        (59, 1.74, 2860.943900183997, 443.58072505138585),
        (58, 1.71, 4761.448192397865, 510.34460522936166),
        (59, 1.74, 3020.1177313328562, 415.47293460543773),
        (57, 1.68, 3655.475345286849, 458.10581063053854),
    ],
    "pp03-1": [
        (119, 3.54, 1059.4810050208541, 327.6212331219599),
        (101, 3.0, 1083.3333333333321, 318.3042510246042),
        (316, 9.45, 4800.462940638545, 314.71379463491144),
    ],
}


def imported(source, target):
    report = import_table(source, read_mapping(MAPPING), target)
    with open_log(target) as log:
        found, left_out = reaches(log["reach"])
    assert bool(found) != bool(left_out)
    return report, found or left_out


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_recordings_give_the_published_numbers(name, tmp_path):
    report, found = imported(DATA / f"{name}.dat", tmp_path / "x.mcap")
    above = 2 if name.startswith("pp") else 1  # lines above the numbers
    assert sum(int(x.split()[0]) for x in report.left_out) == above
    assert report.rows == 5 + sum(n for n, *_ in PUBLISHED[name])  # and no sample with them
    assert [x.samples for x in found] == [n for n, *_ in PUBLISHED[name]]
    for x, (_, duration_s, peak, mean) in zip(found, PUBLISHED[name], strict=True):
        assert x.duration_s == pytest.approx(duration_s, abs=0.002)
        assert x.peak_px_s == pytest.approx(peak, rel=1e-9)
        assert x.mean_px_s == pytest.approx(mean, rel=1e-9)


def test_who_had_a_stroke_reaches_later_and_less_smoothly(tmp_path):
    whole = {k: summary(imported(DATA / f"{k}.dat", tmp_path / f"{k}.mcap")[1]) for k in PUBLISHED}
    young, stroke = whole["cp01-1"], whole["pp03-1"]
    assert young["achieved"] == 4
    assert stroke["reach_s"] > 2 * young["reach_s"]
    assert stroke["sparc"] < young["sparc"] < -1
    assert stroke["submovements"] > young["submovements"]


def made(path, at, inside, step_ms=20):
    """A target at 500 px from the start; a target elsewhere before."""
    rows = ["0 0 0 9 9 20 0"]
    for k, (x, within) in enumerate(zip(at, inside, strict=True), start=1):
        rows.append(f"{x:.9g} 0 {k * step_ms} 500 0 20 {int(within)}")
    path.write_text("\n".join(rows) + "\n")
    return path


def test_a_reach_by_hand(tmp_path):
    """Even speed for 1 s, 4 % beyond, and back after 0.2 s to stay."""
    t = np.arange(200) * 0.02
    at = np.where(t <= 1, 500 * t, np.where(t < 1.2, 520.0, 500.0))
    _, (x,) = imported(made(tmp_path / "a.dat", at, t >= 1.2), tmp_path / "a.mcap")
    assert (x.achieved, x.away) == (True, False)
    assert x.reach_s == pytest.approx(1.2)
    assert x.beyond == pytest.approx(0.04)
    # The integral of (1 - t)^2 over 1 s, and 0.04^2 for a fifth of one, 100 a second.
    assert x.sse == pytest.approx(100 * (1 / 3 + 0.2 * 0.04**2), abs=1.1)
    assert x.mean_px_s == pytest.approx((500 + 40) / 3.98, rel=0.02)


@pytest.mark.parametrize(
    ("at", "inside"),
    [
        (lambda t: 500 * np.minimum(t, 1), lambda t: (t > 1) & (np.round(t / 0.02) % 30 > 0)),
        (lambda t: np.where(t < 10.5, 0.0, 500.0), lambda t: t > 10.5),
    ],
)
def test_a_stay_that_is_too_short_or_too_late_is_none(tmp_path, at, inside):
    t = np.arange(600) * 0.02
    _, (x,) = imported(made(tmp_path / "a.dat", at(t), inside(t)), tmp_path / "a.mcap")
    assert not x.achieved
    assert x.reach_s is None
    assert x.sse is None


@pytest.mark.parametrize(
    ("start", "count", "last", "why"),
    [
        (0, 20, "nan 0 420", "a position is missing"),
        (0, 20, "0 0 400", "its times do not rise"),
        (0, 20, "0 0 1400", "1.00 s without a sample"),
        (0, 8, "0 0 180", "9 samples, and 10 are needed"),
        (500, 20, "0 0 420", "it begins on its target"),
    ],
)
def test_a_reach_that_cannot_be_measured_is_left_out_and_told(tmp_path, start, count, last, why):
    path = made(tmp_path / "a.dat", np.full(count, start), np.zeros(count))
    path.write_text(f"{path.read_text()}{last} 500 0 20 0\n")
    _, (told,) = imported(path, tmp_path / "a.mcap")
    assert told.endswith(why)


def test_the_command_tells_each_recording_and_refuses_what_has_no_reach(tmp_path):
    for name in PUBLISHED:
        imported(DATA / f"{name}.dat", tmp_path / f"{name}.mcap")
    to = tmp_path / "x.json"
    files = [str(tmp_path / f"{n}.mcap") for n in PUBLISHED]
    done = CliRunner().invoke(app, ["analyse", "reaches", *files, "--json", str(to)])
    assert done.exit_code == 0, done.output
    told = json.loads(to.read_text())
    assert [len(told["files"][x]["reaches"]) for x in files] == [4, 3]
    lines = (DATA / "cp01-1.dat").read_text().splitlines()[:5]
    (tmp_path / "cut.dat").write_text("\n".join(lines) + "\n")
    with pytest.raises(UserError, match="No target changes"):
        imported(tmp_path / "cut.dat", tmp_path / "cut.mcap")
    mapping = read_mapping(MAPPING)
    short = mapping.model_copy(update={"columns": mapping.columns[:2]})
    import_table(DATA / "cp01-1.dat", short, tmp_path / "short.mcap")
    with (
        open_log(tmp_path / "short.mcap") as log,
        pytest.raises(UserError, match="no column target_x"),
    ):
        reaches(log["reach"])
