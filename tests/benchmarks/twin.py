"""The virtual exoskeleton as a benchmark: simulated seconds per second, and how exact they are.

The loop of plant and controller, both as generated C, and the plant alone in the same C, against
the same equations as one writes them in Python: ``scipy.integrate.solve_ivp``, and a fixed step.
All run what the tuning case makes the drive do.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from esea_gen.device import Device
from esea_gen.language.ports import Array
from esea_gen.twin.closed_loop import ClosedLoop
from esea_gen.twin.recorded import tuning_signals
from esea_gen.twin.run import plant_variant
from tests.benchmarks.peers import NumpyPeer
from tests.benchmarks.row import Row
from tests.benchmarks.twin_peers import (
    LoopPeer,
    PlantEquations,
    SolvePeer,
    TwinPeer,
    python_peers,
    replay_system,
)

REAL_TIME_NS = 1e6  # a millisecond
FAST_MS, SLOW_MS = 20_000, 1000  # how much is simulated in C, and in Python
GOAL = 200.0
LOOP = "twin, closed loop"
PLANT = "twin, plant"
REAL_TIME = "real time"
TRUTH = "solve_ivp, LSODA, 1e-10, tenths of ms"
ERROR = "torque error of the twin's plant, {} "


def compare_twins(name: str, ours: TwinPeer, peer: TwinPeer, pairs: int) -> Row:
    """Time two simulations in turns."""
    return _paired(name, *_in_turns(ours, peer, pairs))


def _in_turns(ours: TwinPeer, peer: TwinPeer, pairs: int) -> tuple[Array, Array]:
    # ns a simulated millisecond of both.
    a, b = np.empty(pairs), np.empty(pairs)
    for k in range(pairs):
        turn = [(a, ours), (b, peer)]
        for store, p in turn if k % 2 == 0 else turn[::-1]:
            store[k] = 1e9 * p.run() / p.milliseconds
    return a, b


def _paired(name: str, ours: Array, peer: Array) -> Row:
    low, ratio, high = (float(x) for x in np.quantile(peer / ours, [0.25, 0.5, 0.75]))
    return Row(name, float(np.median(ours)), float(np.median(peer)), ratio, "ns", low, high)


def torque_errors(torque_Nm: Array, truth_Nm: Array) -> tuple[float, float]:
    """How far a simulation is off."""
    n = min(len(torque_Nm), len(truth_Nm))
    error = torque_Nm[:n] - truth_Nm[:n]
    return float(np.sqrt(np.mean(error * error))), float(np.max(np.abs(error)))


def twin_rows(
    device: Device,
    pairs: int,
    say: Callable[[str], None],
    fast_ms: int = FAST_MS,
    slow_ms: int = SLOW_MS,
) -> list[Row]:
    """Speed and accuracy of the virtual exoskeleton.

    return: ns a simulated millisecond (``ratio`` against real time is simulated seconds per
        second), then the torque's errors in Nm.
    """
    say("twin: compiling")
    plant = plant_variant(device, "real", "none", 0)
    loop = ClosedLoop(device.system, plant, "f32")
    whole = LoopPeer(LOOP, loop, tuning_signals(device, loop, fast_ms), plant)
    whole.run()
    assert whole.result is not None
    u_Nm = np.asarray(whole.result.controller["u_Nm"], dtype=float)
    replay = ClosedLoop(replay_system(device), plant, "f64")
    alone = LoopPeer(PLANT, replay, {"u_recorded_Nm": u_Nm}, plant)
    alone.run()
    if alone.torque_Nm().tobytes() != whole.torque_Nm().tobytes():
        raise RuntimeError("the plant alone computes other bits than in the loop")
    say("twin: C")
    plants, loops = _in_turns(alone, whole, pairs)
    clock = np.full(pairs, REAL_TIME_NS)
    rows = [
        _paired(f"{LOOP} vs {REAL_TIME}", loops, clock),
        _paired(f"{PLANT} vs {REAL_TIME}", plants, clock),
        _paired(f"{PLANT} vs the loop with its controller", plants, loops),
    ]
    if not NumpyPeer.fits(device):
        say("twin: its elastomer is not what the Python peers have; they are left out")
        return rows
    defaults = {t.name: t.default for t in loop.plant.blocks["plant"].tunables}
    equations = PlantEquations(device, plant, defaults)
    say(f"twin: {TRUTH}")
    truth = SolvePeer(TRUTH, equations, u_Nm[:slow_ms], "LSODA", 1e-10, 1e-12, pieces=10)
    truth.run()
    short = LoopPeer(PLANT, replay, {"u_recorded_Nm": u_Nm[: slow_ms + 1]}, plant)
    short.run()
    ours = torque_errors(short.torque_Nm(), truth.torque_Nm())
    errors = []
    for peer in python_peers(equations, u_Nm[:slow_ms]):
        say(f"twin: {peer.name}")
        rows.append(compare_twins(f"{PLANT} vs {peer.name}", alone, peer, max(3, pairs // 10)))
        theirs = torque_errors(peer.torque_Nm(), truth.torque_Nm())
        for kind, mine, other in zip(("RMS", "largest"), ours, theirs, strict=True):
            errors.append(Row.exact(ERROR.format(kind) + f"vs {peer.name}", mine, other, "Nm"))
    return rows + errors


def twin_table(rows: list[Row]) -> list[str]:
    """Speed and accuracy beside each other, and whether the goal is met."""
    found = {r.name: r for r in rows}
    whole = found.get(f"{LOOP} vs {REAL_TIME}")
    if whole is None:
        return []
    cells: list[tuple[str, float, str, str]] = [
        ("closed loop in C, f32 controller", whole.ratio, "", "")
    ]
    alone = found[f"{PLANT} vs {REAL_TIME}"]
    errors: dict[str, dict[str, Row]] = {}
    for r in rows:
        for kind in ("RMS", "largest"):
            lead = ERROR.format(kind) + "vs "
            if r.name.startswith(lead):
                errors.setdefault(r.name.removeprefix(lead), {})[kind] = r
    first = next(iter(errors.values()), None)
    own = (f"{first['RMS'].ours:.1e}", f"{first['largest'].ours:.1e}") if first else ("", "")
    cells.append(("plant alone in C", alone.ratio, *own))
    for name, pair in errors.items():
        speed = REAL_TIME_NS / found[f"{PLANT} vs {name}"].peer
        off = (f"{pair['RMS'].peer:.1e}", f"{pair['largest'].peer:.1e}")
        cells.append((name, speed, *off))
    width = max(len(c[0]) for c in cells)
    lines = [
        f"The twin, tuning case: simulated seconds per second, torque error against {TRUTH}, in Nm",
        f"{'':{width}}  {'times':>8}  {'RMS':>8}  {'largest':>8}",
    ]
    lines += [f"{n:{width}}  {x:8.3g}  {rms:>8}  {most:>8}" for n, x, rms, most in cells]
    met = "met" if whole.ratio >= GOAL else "MISSED"
    lines.append(
        f"goal, closed loop at least {GOAL:g} times real time: {whole.ratio:.0f} "
        f"({whole.low:.0f} to {whole.high:.0f}), {met}"
    )
    return lines


__all__ = ["compare_twins", "torque_errors", "twin_rows", "twin_table"]
