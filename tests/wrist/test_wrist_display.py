"""The wrist display: telemetry to pictures, the guided calibration, its file, its window."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import esea_gen
from esea_gen.emit.dialect import load_dialect
from esea_gen.errors import UserError
from esea_host.connection import Batch
from esea_host.connection.decoder import TelemetryDecoder
from esea_host.connection.identity import column_texts
from esea_host.wrist.calibration import (
    calibration_of,
    cursor_maps,
    load_calibration,
    save_calibration,
)
from esea_host.wrist.display import CalibrationGuide, WristDisplay
from esea_host.wrist.tasks import Follower

DEVICE_AXES = {"fe_deg": "flexion", "ru_deg": "deviation"}


@dataclass
class Board:
    """A wrist's streams, filled by hand."""

    name: str

    def __post_init__(self):
        self.device = esea_gen.load_device(self.name)
        decoder = TelemetryDecoder(load_dialect(self.device), *column_texts(self.device))
        self._layouts = {x.name: x for x in decoder.layouts.values()}

    def batch(self, name: str, time_s, degrees, acts) -> Batch:
        """Rows of one axis."""
        axis = DEVICE_AXES[name]
        layout = self._layouts[f"sense_{axis}_out"]
        rows = np.zeros(len(time_s), layout.dtype)
        rows[f"theta_load_{axis}_rad"] = np.radians(degrees)
        if f"acts_{axis}" in rows.dtype.names:
            rows[f"acts_{axis}"] = acts
        return Batch(layout, rows, np.round(np.array(time_s) * 1e9).astype(np.int64), 0)


@pytest.fixture(scope="module")
def drive():
    return Board("wrist_drive")


@pytest.fixture(scope="module")
def led(drive):
    """A simulated person who was led through a calibration: its guide, the display, the frames."""
    display, person, frames = WristDisplay(drive.device), Follower(np.random.default_rng(1)), []
    display.guide = guide = CalibrationGuide(True, range_s=3.0, movements=3)
    while (step := guide.current) is not None:
        time_s, told = person.react(guide.scene, {"impairment": float(step.constrained)})
        assert time_s < 300, "no calibration takes longer than five minutes"
        frames.append((time_s, told["fe_deg"], told["ru_deg"], step.constrained))
        display.receive([drive.batch(n, [time_s], [told[n]], step.constrained) for n in told])
    return guide, display, np.array(frames)


@pytest.fixture(scope="module")
def calibration(led):
    return calibration_of(led[0].past, "wrist_drive", "0" * 64, True)


@settings(max_examples=6)
@given(st.data())
def test_how_rows_are_grouped_changes_no_frame(drive, led, data):
    frames, guides = led[2][:700], []
    for cuts in ([], data.draw(st.lists(st.integers(0, len(frames)), max_size=12))):
        display = WristDisplay(drive.device)
        display.guide = CalibrationGuide(True, range_s=3.0, movements=3)
        for a, b in zip([0, *sorted(cuts)], [*sorted(cuts), len(frames)], strict=True):
            part = frames[a:b]
            order = data.draw(st.permutations([("fe_deg", 1), ("ru_deg", 2)]))
            display.receive(
                [drive.batch(n, part[:, 0], part[:, k], part[:, 3]) for n, k in order if len(part)]
            )
        guides.append((display.guide.past, display.guide.scene.digest(), display.picture()))
    assert guides[0] == guides[1]


def test_the_constrained_cursor_goes_through_the_studys_maps(drive, led, calibration):
    guide, display, _ = led
    display.calibrate(calibration)
    stored = calibration.state(True)
    display.receive(
        [drive.batch(n, [500.0], [x], 1.0) for n, x in (("fe_deg", -20), ("ru_deg", 3))]
    )
    shown = {a.name: a for a in display.picture().axes}
    assert shown["FE"].theta_deg == pytest.approx(-20 - stored.neutral_fe_deg, abs=1e-4)
    map_of = cursor_maps(guide.past, "rbf")["FE"]
    assert shown["FE"].cursor_deg == pytest.approx(float(map_of.position(shown["FE"].theta_deg)))
    assert shown["FE"].factor == pytest.approx(float(map_of.scaling(shown["FE"].theta_deg)))
    # Healthy, as the board reports it, nothing is normalised.
    display.receive([drive.batch(n, [500.1], [-20.0], 0.0) for n in DEVICE_AXES])
    assert [a.factor for a in display.picture().axes] == [1.0, 1.0]
    assert display.picture().axes[0].cursor_deg == display.picture().axes[0].theta_deg


def test_a_step_waits_for_the_constraint_and_a_small_range_is_measured_again(drive):
    guide = CalibrationGuide(True, range_s=1.0, movements=2)
    still = {"fe_deg": 0.0, "ru_deg": 0.0}
    for k in range(700):
        guide.step(0.01 * k, still, acts=True)  # it should be healthy
    assert guide.past == []
    for k in range(520):
        guide.step(10 + 0.01 * k, still, acts=False)
    assert guide.current.task == "wrist.range"
    assert len(guide.past) < 3
    assert "range" in guide.advice


def test_the_file_comes_back_and_nothing_is_overwritten(calibration, tmp_path):
    first = save_calibration(tmp_path / "wrist.toml", calibration)
    second = save_calibration(tmp_path / "wrist.toml", calibration)
    assert first != second
    assert load_calibration(first) == load_calibration(second) == calibration
    assert "SIMULATED" in first.read_text().splitlines()[0]


HOSTILE = {
    "edited": (r"low_deg = -(\d)", r"low_deg = -1\1", "sha256"),
    "not a number": (r"low_deg = \S+", "low_deg = nan", "low_deg"),
    "huge": (r"low_deg = \S+", "low_deg = 1e300", "low_deg"),
    "empty nodes": (r"nodes_deg = \[.*?\]", "nodes_deg = []", "sha256"),
    "a table too many": (r"\[healthy\]", "[more]\na = 1\n[healthy]", "more"),
    "deep": (r"schema = .*", "schema = " + "[" * 500, "TOML"),
    "no text": (r"schema", "\udcff", "text"),
}


@pytest.mark.parametrize("how", HOSTILE)
def test_hostile_files_are_refused_with_their_name(how, calibration, tmp_path):
    old, new, told = HOSTILE[how]
    path = save_calibration(tmp_path / "wrist.toml", calibration)
    path.write_bytes(re.sub(old, new, path.read_text(), count=1).encode(errors="surrogateescape"))
    with pytest.raises(UserError, match=told) as refused:
        load_calibration(path)
    assert path.name in str(refused.value)


def test_consistent_hash_does_not_excuse_impossible_values(calibration, tmp_path):
    """Someone who edits and hashes anew still gives no file that breaks the maps."""
    axis = calibration.healthy.FE
    for change in (
        {"low_deg": 20.0, "high_deg": -20.0},
        {"nodes_deg": axis.nodes_deg[:-1]},
        {"speeds_deg_s": (0.0,) * len(axis.nodes_deg)},
    ):
        healthy = calibration.healthy.model_copy(update={"FE": replace(axis, **change)})
        forged = calibration.model_copy(update={"healthy": healthy})
        forged = forged.model_copy(update={"sha256": forged.digest()})
        path = save_calibration(tmp_path / "forged.toml", forged)
        with pytest.raises(UserError, match=r"forged.*\.toml"):
            load_calibration(path)
