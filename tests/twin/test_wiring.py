"""Wiring of both shipped drives, in order and delay, against a table typed by hand.

The table is what chapter 5, docs/control.md and docs/predictive.md ask for.  Where two signals
would both fit a port, the reason for the one that is meant stands beside it.
"""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.control.laws.predictive import device_horizon, predictive_delay_s
from esea_gen.device import load_device, parse_device
from esea_gen.model.sensing import zeros_missing
from esea_gen.twin.run import previews
from esea_gen.twin.trajectories import Trajectory

# -- from outside and to the outside ---------------------------------------------------------------

# Period, first tick and release, in base ticks of 1 ms: 1 kHz and 200 Hz, and a command that takes
# effect one tick after the start of the run that made it; two for predictive control.
RELEASE = {"elbow_drive": 1, "elbow_mpc": 2}
DEVICES = ("elbow_drive", "elbow_mpc")


@pytest.fixture(scope="module")
def systems():
    return {name: load_device(name).system for name in DEVICES}


# -- time ------------------------------------------------------------------------------------------


def run_commands(system, change_at: int | None, ticks: int) -> np.ndarray:
    """The motor's command at every tick, armed and on; one count off at a tick."""
    simulator = system.simulator(zeros_missing(system))
    sizes = {x.name: x.port.size for x in system.inputs}
    commands = np.zeros(ticks)
    for k in range(ticks):
        load = 520  # 0.8 rad
        given = {n: np.zeros(z) if z > 1 else 0.0 for n, z in sizes.items()}
        given |= {"count_load": load, "count_motor": load + 8 + (k == change_at)}
        given |= {"rearm": float(k >= 12), "mode": float(k >= 20), "tau_desired_Nm": 0.3}
        simulator.release(k)
        for task in system.tasks:
            if k % task.every == 0:
                named = {x.name for x in system.task_inputs(task)}
                out = simulator.step(task.name, **{n: v for n, v in given.items() if n in named})
                if task.name == "sense":
                    commands[k] = out["u_Nm"]
                    assert k < 20 or out["fault"] == 0
    return commands


@pytest.mark.parametrize("name", DEVICES)
def test_from_a_measurement_to_its_effect(systems, name):
    # A run of the control task at tick 35 holds what was measured at tick 34; the limits see its
    # command at its release.  A count changed at tick 34 shows then, at tick 35 five ticks later.
    base = run_commands(systems[name], None, 44)
    assert np.any(base != 0)
    shown = 35 + RELEASE[name]
    for change_at, seen_at in ((34, shown), (35, shown + 5), (33, shown)):
        other = run_commands(systems[name], change_at, 44)
        assert np.flatnonzero(other != base)[0] == seen_at, change_at


@pytest.mark.ci
@pytest.mark.parametrize(
    ("release", "ticks"),
    [
        # A measurement is released a tick after it was made, a command so many after its run began.
        ("0.001", 2),
        ("0.003", 4),
        ("0.005", 6),
        # No release in the file: the control task's whole period.
        (None, 6),
    ],
)
def test_the_prediction_reaches_as_far_as_the_effect(release, ticks):
    text = load_device("elbow_mpc").toml()
    (line,) = (x for x in text.splitlines() if x.startswith("control_release_s = "))
    other = "" if release is None else line.replace("value = 0.002", f"value = {release}")
    assert other != line
    device = parse_device(text.replace(line, other), "mine.toml")
    assert 1 + device.system.tasks[-1].release_ticks == ticks
    assert predictive_delay_s(device) == pytest.approx(ticks * 1e-3, abs=1e-12)
    ends = [ticks * 1e-3 + x for x in (0.015, 0.03, 0.045, 0.075, 0.105, 0.135)]
    assert device_horizon(device).ends_s == pytest.approx(ends, abs=1e-12)


def test_a_known_future_is_that_of_the_intervals_ends():
    # A run at tick 5 holds the measurement of tick 4 and acts from tick 7: its intervals end at
    # ticks 22, 37 ... 142.  Later than the path is long, the last value holds.
    n = 300
    t = np.arange(n, dtype=float)
    path = Trajectory("count", t, 2 * t, 3 * t, 4 * t, 0, n, True)
    found = previews(path, device_horizon(load_device("elbow_mpc")))
    ends = np.array([22, 37, 52, 82, 112, 142])
    for tick in (5, 10, 60, 90):
        at = ends + tick - 5
        assert found["tau_preview_Nm"][tick].tolist() == (4 * at).tolist()
        assert found["theta_preview_rad"][tick].tolist() == at.tolist()
        assert found["omega_preview_rad_s"][tick].tolist() == (2 * at).tolist()
    assert found["theta_preview_rad"][170].tolist() == [187, 202, 217, 247, 277, 299]
