"""Committed traces: unchanged behaviour, and readable differences."""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest

from esea_gen.device import Device, load_device, parse_device
from esea_gen.devices.file import shipped_devices
from esea_gen.errors import UserError
from esea_gen.verify import traces
from tests.conftest import ROOT

TRACES = ROOT / "tests" / "traces"


@pytest.fixture(scope="module")
def stored() -> str:
    return (TRACES / "elbow.csv").read_text()


@pytest.fixture(scope="module")
def trace(elbow):
    return traces.run_trace(elbow)


def changed_elbow(pattern: str, value: str) -> Device:
    text, count = re.subn(pattern, value, shipped_devices()["elbow"].read_text(), count=1)
    assert count == 1
    return parse_device(text, "elbow.toml")


# Steps of a Program are interpreted, one by one: CI runs it with the slow sample.
DEAR = {"elbow_mpc": pytest.mark.slow}
DEAR |= dict.fromkeys(("wrist_drive", "wrist_board"), pytest.mark.ci)
DEVICES = [
    pytest.param(name, marks=DEAR[name]) if name in DEAR else name
    for name in sorted(shipped_devices())
]


@cache
def checked(name: str) -> tuple[list[str], dict[str, np.ndarray]]:
    """What differs of a device, and the stream that it was run over."""
    streams, own = [], traces.trace_stream

    def kept(device):
        streams.append(own(device))
        return streams[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("esea_gen.verify.traces.trace_stream", kept)
        found = traces.check_traces(TRACES, {name: load_device(name)})
    ((stream, _),) = streams
    return found, stream


@pytest.mark.parametrize("name", DEVICES)
def test_every_shipped_device_behaves_as_accepted(name):
    found, _ = checked(name)
    assert not found, "\n".join([*found, "Accept with: esea-gen traces accept"])


def test_a_changed_parameter_shows(stored):
    device = changed_elbow(r"(k1_Nm_rad = \{ value = )[\d.]+", r"\g<1>9.391")
    found = traces.differences(traces.run_trace(device), stored)
    assert [line.split()[1] for line in found] == ["tau_Nm", "tau_spring_Nm"]
    for line in found:
        assert re.fullmatch(
            r"elbow: \w+ from step \d+ \(chirp in the domain\) on: \S+ -> \S+; \d+ of 400 rows "
            r"differ; largest change [\d.e-]+ % of full scale, step \d+ \([\w ]+\)",
            line,
        ), line


def test_a_changed_threshold_shows_as_flags(elbow, stored):
    device = changed_elbow(r"(tau_full_scale_Nm = \{ value = )[\d.]+", r"\g<1>3.0")
    found = traces.differences(traces.run_trace(device), stored)
    assert len(found) == 1
    assert re.search(r"sensor_status .*: 0 -> TORQUE_OUTSIDE; \d+ of 400 rows differ$", found[0])


def test_a_changed_input_is_told_first(stored):
    device = changed_elbow(r"(theta_max_rad = \{ value = )[\d.]+", r"\g<1>0.19")
    assert traces.differences(traces.run_trace(device), stored)[0].startswith(
        "elbow: theta_rad from step"
    )


def test_added_and_removed_columns_show(trace, stored):
    assert traces.differences(trace, stored.replace(",tau_rate_Nm,", ",tau_old_Nm,", 1)) == [
        "elbow: output tau_rate_Nm added",
        "elbow: column tau_old_Nm removed",
    ]


def test_a_last_digit_of_another_libm_does_not_show(trace, stored):
    other = {n: a * (1 + 1e-13) if n == "tau_Nm" else a for n, a in trace.outputs.items()}
    assert traces.differences(type(trace)(**(vars(trace) | {"outputs": other})), stored) == []
    other["tau_Nm"] = trace.outputs["tau_Nm"] + 4.47e-8
    assert len(traces.differences(type(trace)(**(vars(trace) | {"outputs": other})), stored)) == 1


@pytest.mark.parametrize("text", ["", "nonsense", "step,theta_rad\n1\n", "a,b\n1,2\n"])
def test_a_broken_file_is_told(trace, text):
    assert len(traces.differences(trace, text)) == 1
    assert "cannot be read" in traces.differences(trace, text)[0]


def test_a_shorter_file_is_told(trace, stored):
    cut = "\n".join(stored.splitlines()[:200])
    assert "the stream is another one: 198 rows" in traces.differences(trace, cut)[0]


@pytest.mark.ci
def test_accept_writes_then_keeps_then_replaces(elbow, tmp_path):
    devices = {"elbow": elbow}
    folder = tmp_path / "new" / "traces"
    assert traces.check_traces(folder, devices) == ["elbow: no trace is stored yet"]
    assert traces.accept_traces(folder, devices) == ["elbow: no trace is stored yet"]
    path = folder / "elbow.csv"
    assert traces.check_traces(folder, devices) == []
    before = path.stat().st_mtime_ns
    assert traces.accept_traces(folder, devices) == []
    assert path.stat().st_mtime_ns == before

    changed = {"elbow": changed_elbow(r"(k1_Nm_rad = \{ value = )[\d.]+", r"\g<1>9.5")}
    found = traces.check_traces(folder, changed)
    assert found
    assert traces.accept_traces(folder, changed) == found
    assert traces.check_traces(folder, changed) == []
    assert traces.check_traces(folder, devices) != []


def test_the_trace_of_a_device_that_is_gone(tmp_path, monkeypatch):
    one = {"elbow": shipped_devices()["elbow"]}
    monkeypatch.setattr("esea_gen.verify.traces.shipped_devices", lambda: one)
    traces.accept_traces(tmp_path)
    (tmp_path / "gone.csv").write_text(f"{traces.MARK}: gone\nstep\n")
    (tmp_path / "other.csv").write_text("not ours\n")
    gone = ["gone: a trace is stored, but there is no such device"]
    assert traces.check_traces(tmp_path) == gone
    assert traces.accept_traces(tmp_path) == gone
    assert traces.check_traces(tmp_path) == []
    assert (tmp_path / "other.csv").exists()


def test_a_folder_that_cannot_be_written(elbow, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot be written"):
        traces.accept_traces(tmp_path / "file" / "traces", {"elbow": elbow})


# -- what a drive's trace is run over: everything that it is to show happens in it ----------------


@pytest.fixture(scope="module")
def stream() -> dict[str, np.ndarray]:
    return checked("elbow_drive")[1]
