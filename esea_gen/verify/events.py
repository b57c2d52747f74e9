"""Streams that a Block brings along: what random inputs do not bring about.

A latch that opens, a controller that takes over, an encoder that slips: each needs inputs that fit
together over many steps.  Found by the Block's name; all numbers come from the Block's own ports,
tunables and constants.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from esea_gen.language.block import Block
from esea_gen.language.ports import Array
from esea_gen.language.system import System, Task
from esea_gen.model.inverse import NESTING_ROOM_RAD
from esea_gen.verify.streams import SPECIAL, Stream, single


def events(block: Block, seed: int = 1) -> list[Stream]:
    """The streams that a Block brings along, for every comparison."""
    make = _EVENTS.get(block.name)
    return make(block, np.random.default_rng(seed)) if make else []


def memories(block: Block, dtype: npt.DTypeLike = np.float32, seed: int = 2) -> list[Stream]:
    """The streams that a Block brings along for comparisons bit by bit only.

    return: coefficients that the limits must refuse; zeros and steps of an encoder at the edge of
        what they decide; states of the exact inverse that only a long past brings; empty for other
        Blocks.
    """
    if block.name == "limits":
        return [_bad_coefficients(block, np.dtype(dtype))]
    if block.name.startswith("encoder_"):
        return [_encoder_edges(block, np.dtype(dtype))]
    if {"play_rad", "theta_prev_rad", "tau_r_Nm"} <= {p.name for p in block.state}:
        return [_nested_plays(block, np.random.default_rng(seed))]
    return []


# -- limits ----------------------------------------------------------------------------------------


class _Joint:
    """Inputs of the limits: a joint where all is in order, and what happens to it."""

    def __init__(self, block: Block, steps: int, rng: np.random.Generator) -> None:
        k: Array = np.arange(float(steps))
        self.block, self.rng = block, rng
        self.ports = {p.name: p for p in block.inputs}
        self.t = {t.name: t.default for t in block.tunables}
        self.constant = {c.name: c.value for c in block.constants}
        self.steps = steps
        self.deliver = int(self.constant["stale_ticks"]) // 2  # periods of the control task
        self.middle = 0.5 * (self.t["rom_min_rad"] + self.t["rom_max_rad"])
        self.bent = 0.2 * self.t["theta_max_rad"]
        self.x: dict[str, Array] = {name: np.zeros(steps) for name in self.ports}
        # From near its end, so that the stamp's wrap is seen.
        self.x["control_beat"] = 1.0 + (240 + k // self.deliver) % 255
        self.x["request_ok"][:] = 1
        self.x["sensing_ok"][:] = 1
        self.x["theta_load_rad"][:] = self.middle
        self.x["theta_motor_rad"][:] = self.middle + self.bent
        self.x["theta_rad"][:] = self.bent
        self.x["tau_Nm"][:] = 0.1 * self.t["tau_max_Nm"]
        self.at = 3

    def command(self, reach: float) -> None:
        """A command that wanders, new at every delivery, up to a multiple of the largest."""
        wild = self.rng.uniform(-reach, reach, self.steps // self.deliver + 1) * self.t["u_max_Nm"]
        self.x["u_command_Nm"][:] = np.repeat(wild, self.deliver)[: self.steps]

    def release(self, mode: float = 1.0) -> None:
        """Off, a request, and on again."""
        a, b = self.at, self.at + 8
        for name in ("mode", "u_command_Nm", "stop"):
            self.x[name][a:b] = 0
        self.x["rearm"][a + 4 :] = (self.x["rearm"][a] + 1) % 8
        self.x["mode"][b:] = mode
        self.at = b + 6

    def put(self, length: int, **values: float | Array) -> None:
        """Hold some inputs for a while; other angles follow the joint."""
        for name, value in values.items():
            self.x[name][self.at : self.at + length] = value
        self.at += length

    def stream(self, name: str, injections: dict[int, dict[str, Array]] | None = None) -> Stream:
        """What was put together."""
        assert self.at < self.steps, (name, self.at)
        return Stream(name, {k: single(v) for k, v in self.x.items()}, injections or {})


def _above(limit: float, share: float = 1.02) -> tuple[float, float]:
    return share * limit, -share * limit


def _limits(block: Block, rng: np.random.Generator) -> list[Stream]:
    return [
        _faults(block, rng),
        _causes_together(block, rng),
        _held_back(block, rng),
        _requests(block, rng),
        _energy(block, rng),
        _contradictions(block, rng),
    ]


def _faults(block: Block, rng: np.random.Generator) -> Stream:
    # Every cause, one by one, each from the released state and with a proper release behind it.
    j = _Joint(block, 6000, rng)
    t, middle = j.t, j.middle
    j.command(0.8)
    low = t["rom_min_rad"] - j.constant["rom_margin_rad"]
    high = t["rom_max_rad"] + j.constant["rom_margin_rad"]
    causes: list[dict[str, float | Array]] = [
        {"stop": 1.0},
        {"stop": 0.5},
        {"stop": np.nan},
        {"request_ok": 0.0},
        {"sensing_ok": 0.0},
        {"sensing_ok": 0.5},
        {"control_beat": 0.0},
        {"mode": 0.5},
        {"rearm": 2.5},
    ]
    causes += [{"theta_rad": v} for v in _above(t["theta_max_rad"])]
    causes += [{"theta_motor_rad": middle + v} for v in _above(t["theta_max_rad"])]
    causes += [{"tau_Nm": v} for v in _above(t["tau_max_Nm"])]
    for name in ("omega_load_rad_s", "omega_motor_rad_s"):
        causes += [{name: v} for v in _above(t["omega_max_rad_s"])]
    for v in (low - 0.01, high + 0.01):
        causes.append({"theta_load_rad": v, "theta_motor_rad": v + j.bent})
    for p in j.ports.values():
        causes += [{p.name: v} for v in (np.nan, 2 * p.high + 1, 2 * min(p.low, 0.0) - 1)]
    j.release()
    for cause in causes:
        for length in (1, 3):
            j.put(length, **cause)
            j.at += 3
            j.release(float(rng.choice([1.0, 2.0])))
    # A control task that falls silent: for one delivery, which is let pass, and for good.
    for missed in (1, 3):
        frozen = j.x["control_beat"][j.at]
        j.put(missed * j.deliver + 1, control_beat=frozen)
        j.at += 2 * j.deliver
        j.release()
    return j.stream("every fault, and its release")


def _causes_together(block: Block, rng: np.random.Generator) -> Stream:
    # Any two causes in one step, from the released state: one reason is kept, not a mixture.
    j = _Joint(block, 2600, rng)
    t = j.t
    j.command(0.8)
    slots = next(p for p in block.state if p.name == "slots_J")
    beyond = t["rom_max_rad"] + j.constant["rom_margin_rad"] + 0.01
    causes: list[dict[str, float]] = [
        {"key": 1.0},
        {"stop": 1.0},
        {"rearm": 2.5},
        {"sensing_ok": 0.0},
        {"control_beat": 0.0},
        {"theta_rad": 1.02 * t["theta_max_rad"]},
        {"tau_Nm": 1.02 * t["tau_max_Nm"]},
        {"omega_motor_rad_s": 1.02 * t["omega_max_rad_s"]},
        {"theta_load_rad": beyond, "theta_motor_rad": beyond + j.bent},
        {"slots_J": 2.0 * t["energy_max_J"] / slots.size},
    ]
    states = {p.name: p.size for p in block.state}
    injections: dict[int, dict[str, Array]] = {}
    for k, one in enumerate(causes):
        for other in causes[k:]:
            j.release()
            both = one | other
            injections[j.at] = {
                n: np.full(states[n], np.float32(v)) for n, v in both.items() if n in states
            }
            j.put(1, **{n: v for n, v in both.items() if n not in states})
            injections[j.at + 2] = {"slots_J": np.zeros(slots.size)}
            j.at += 4
    return j.stream("two causes at once", injections)


def _held_back(block: Block, rng: np.random.Generator) -> Stream:
    # Commands beyond every limit while the joint goes to both ends of its range and of its speed.
    j = _Joint(block, 3000, rng)
    t = j.t
    j.command(1.6)
    j.release()
    margin, width = j.constant["rom_margin_rad"], 400
    wave = np.sin(np.linspace(0, 2 * np.pi, width))
    half = 0.5 * (t["rom_max_rad"] - t["rom_min_rad"])
    for reach in (half - 0.3 * margin, half + 0.6 * margin):
        angle = j.middle + reach * wave
        j.put(width, theta_load_rad=angle, theta_motor_rad=angle + j.bent * wave)
    for share in (0.87, 0.95):
        fast = share * t["omega_max_rad_s"] * wave
        j.put(width, omega_load_rad_s=fast, omega_motor_rad_s=0.5 * fast)
        j.put(width, omega_load_rad_s=-0.5 * fast, omega_motor_rad_s=fast)
    j.put(40, mode=0.0)  # off is no fault: the command is ramped down
    j.put(20, mode=2.0)
    return j.stream("held back by range of motion and speed")


def _requests(block: Block, rng: np.random.Generator) -> Stream:
    # Requests that must be refused, each with all other conditions met, and the wrap of rearm.
    j = _Joint(block, 1500, rng)
    j.command(0.5)
    rearm = j.x["rearm"]

    def latch() -> None:
        j.put(2, stop=1.0)
        j.at += 3

    def request(jump: int = 1, **others: float) -> None:
        rearm[j.at :] = (rearm[j.at] + jump) % 8
        quiet = {"mode": 0.0, "u_command_Nm": 0.0} | others
        j.put(4, **quiet)
        j.at += 3

    request(3)  # before anything was ever released
    for _ in range(9):  # all the way round
        j.release()
    for jump in (2, 5, 7):
        latch()
        request(jump)
        j.release()
    for wrong in (
        {"mode": 1.0},
        {"u_command_Nm": 0.01},
        {"stop": 1.0},
        {"tau_Nm": 1.1 * j.t["tau_max_Nm"]},
    ):
        latch()
        request(1, **wrong)
        j.release()
    request(1)  # while released: nothing to do
    j.release()
    latch()
    rearm[j.at] = 3.5  # no request, and no number to count from
    request(1)
    j.release()
    return j.stream("requests")


def _energy(block: Block, rng: np.random.Generator) -> Stream:
    # Energy at nine tenths of torque and speed until it trips, a braked motion, and waiting until
    # the window has forgotten.
    t = {x.name: x.default for x in block.tunables}
    slot = int(next(c.value for c in block.constants if c.name == "slot_ticks"))
    power = 0.9 * t["tau_max_Nm"] * 0.75 * t["omega_max_rad_s"]
    ticks = int(1.2 * t["energy_max_J"] / (power * block.period_s))
    j = _Joint(block, 2 * ticks + 17 * slot + 400, rng)
    j.command(0.5)
    j.release()
    for sign in (1.0, -1.0):
        j.put(
            ticks,
            tau_Nm=0.9 * t["tau_max_Nm"],
            omega_load_rad_s=sign * 0.75 * t["omega_max_rad_s"],
        )
        j.at += 4
        j.release()
    j.at += 13 * slot
    j.release()
    return j.stream("energy")


def _contradictions(block: Block, rng: np.random.Generator) -> Stream:
    # Memory in which one part contradicts another, released and latched; plausible in itself.
    j = _Joint(block, 3000, rng)
    state = {p.name: p for p in block.state}
    j.command(0.5)
    j.release()
    step = float(rng.uniform(0.2, 0.4)) * state["u_last_Nm"].high
    cases: list[dict[str, float]] = [
        {"fault_mirror": -3.0},
        {"fault_stored": 4.0},
        {"rearm_mirror": 0.0},
        {"rearm_last": 5.0},
        {"u_mirror_Nm": step},
        {"u_last_Nm": step},
        {"key": 0.0},
        {"key": 1.0},
        {"key": state["key"].high},
        {"fault_stored": 4.0, "fault_mirror": -4.0},
        {"fault_stored": 0.0, "fault_mirror": 0.0},
        {"u_last_Nm": step, "u_mirror_Nm": -step},
        {"rearm_last": -1.0, "rearm_mirror": 1.0},
        {"key": 0.0, "fault_stored": 2.0, "fault_mirror": -2.0},
        {"key": 0.0, "fault_stored": 0.0, "fault_mirror": 0.0},
        {"key": np.nan},
        {"age": np.inf},
    ]
    injections = {}
    for case in cases:
        for latched in (False, True):
            if latched:
                j.put(2, stop=1.0)
            injections[j.at + 2] = {k: np.array([float(np.float32(v))]) for k, v in case.items()}
            j.at += 6
            j.release()
    return j.stream("memory that contradicts itself", injections)


def _bad_coefficients(block: Block, dtype: np.dtype[Any]) -> Stream:
    # Each coefficient just inside and just outside its compiled range, and no number at all.
    cases: list[dict[str, float]] = [{}]
    for p in block.coefficients:
        low, high = dtype.type(p.low), dtype.type(p.high)
        below, above = (np.nextafter(x, dtype.type(s * np.inf)) for x, s in ((low, -1), (high, 1)))
        for v in (low, high, below, above, *SPECIAL):
            cases.append({p.name: float(v)})
    # A range of motion turned round, each end inside its own range; and one that is as narrow as
    # none was meant to be, at either end, but in order.
    t = {p.name: p for p in block.coefficients}
    least, most = t["rom_min_rad"].low, t["rom_max_rad"].high
    hair = 0.02 * (most - least)
    cases += [
        {"rom_min_rad": low, "rom_max_rad": high}
        for low, high in ((most, least), (least, least + hair), (most - hair, most), (most, most))
    ]
    # Trips as wide as their ports let them be, a hair wider than compiled in, and the joint there.
    margin = next(c.value for c in block.constants if c.name == "rom_margin_rad")
    angles: dict[int, float] = {}
    for name, end, sign in (
        ("trip_low_rad", "rom_min_rad", -1),
        ("trip_high_rad", "rom_max_rad", 1),
    ):
        widest = t[name].low if sign < 0 else t[name].high
        edge = next(x.default for x in block.tunables if x.name == end) + sign * margin
        near = np.float32(edge) + np.spacing(np.float32(edge)) * np.arange(-4, 5)
        for angle in (*near, 0.5 * (edge + widest)):
            angles[len(cases)] = float(angle)
            cases.append({name: widest})
    each = 24
    j = _Joint(block, each * len(cases) + 60, np.random.default_rng(4))
    j.command(0.5)
    changes: dict[int, dict[str, Array]] = {}
    for k, case in enumerate(cases):
        j.release()
        changes[j.at] = {name: np.array([v]) for name, v in case.items()}
        if k in angles:
            j.x["theta_load_rad"][j.at : j.at + 4] = angles[k]
            j.x["theta_motor_rad"][j.at : j.at + 4] = angles[k] + j.bent
        j.at += 6
        changes[j.at] = {}
        j.at += 4
    x = {k: single(v) for k, v in j.x.items()}
    return Stream("coefficients out of their ranges", x, {}, changes)


# -- elastomer -------------------------------------------------------------------------------------


_MOTION = {"v_rad_s", "a_rad_s2", "w1_rad_s", "w2_rad_s"}


def _nested_plays(block: Block, rng: np.random.Generator) -> Stream:
    # Play states with a common history lie within a threshold of each other; any other memory is
    # refused by the exact inverse.  From such states, all else anywhere, a few steps on.
    steps, every = 3000, 4
    gap = next(c.value for c in block.constants if c.name == "omega_rad")
    ports = {p.name: p for p in block.state}
    injections: dict[int, dict[str, Array]] = {}
    for k in range(0, steps, every):
        state = {
            p.name: single(
                rng.choice([1.0, 0.98, 0.3, 0.02, 0.0])
                * rng.choice([p.low, p.high, rng.uniform(p.low, p.high)])
                * np.ones(p.size)
            )
            for p in block.state
        }
        state["primed"] = np.array([1.0 if rng.random() < 0.9 else 0.0])
        if rng.random() < 0.6:  # at rest, where the viscosity is large
            state |= {n: np.zeros(p.size) for n, p in ports.items() if n in _MOTION}
        theta = float(state["theta_prev_rad"][0])
        # At a threshold, and a little beyond, which rounding may be the cause of.
        edge = 1.0 + 0.9 * NESTING_ROOM_RAD / gap
        choice = [-edge, edge, -0.99, 0.99, 0.0, float(rng.uniform(-1, 1))]
        moves = rng.choice(choice, ports["play_rad"].size)
        if rng.random() < 0.5:  # all stops to one side
            moves = np.abs(moves) * rng.choice([-1.0, 1.0])
        state["play_rad"] = single(theta + np.cumsum(gap * moves))
        injections[k] = state
    inputs = {}
    for p in block.inputs:
        near = rng.choice([1.0, 0.3, 0.05, 0.001], steps) * rng.uniform(p.low, p.high, steps)
        hit = rng.random(steps)
        value = np.where(hit < 0.15, rng.choice([p.low, p.high], steps), near)
        inputs[p.name] = single(np.where(hit > 0.98, np.nan, value))
    return Stream("any memory of the model", inputs, injections)


# -- encoders --------------------------------------------------------------------------------------


def _encoder(block: Block, rng: np.random.Generator) -> list[Stream]:
    # A joint that moves slower than is believed, with frames missing, jumps that are bridged, a
    # slip that stays, and turns beyond what is counted; back to the start by memory as after init.
    port = next(p for p in block.inputs if p.name == "count")
    word = next(p for p in block.inputs if p.name == "frame_error")
    constant = {c.name: c.value for c in block.constants}
    full, most = round(port.high) + 1, int(constant["step_max_counts"])
    held = int(constant["held_max"])
    parts: list[tuple[Array, Array]] = []
    fresh: list[int] = []
    now = 0.37 * full

    def go(steps: int, rate: float, bad: tuple[int, ...] = (), jump: float = 0.0) -> None:
        nonlocal now
        path = now + jump + rate * np.arange(1, steps + 1)
        frame = np.zeros(steps)
        frame[list(bad)] = rng.integers(1, round(word.high) + 1, len(bad))
        parts.append((np.floor(path) % full, frame))
        now = float(path[-1])

    def length() -> int:
        return sum(len(a) for a, _ in parts)

    def restart() -> None:
        fresh.append(length())

    for rate in (0.9 * most, -0.9 * most, 3.0):
        go(60, rate, bad=(20, 30, 31))
        # As many bad frames as may be bridged, and one more: then it starts again.
        go(20, rate, bad=tuple(range(8, 8 + held)))
        go(30, rate, bad=tuple(range(8, 9 + held)))
    for _ in range(3):  # a jump and back: held, and good again
        go(held - 1, 0.0, jump=4.0 * most)
        go(12, 0.0, jump=-4.0 * most)
    go(12, 0.0, jump=(held + 3.0) * most)  # a slip: it settles, the reference is lost
    restart()
    go(4, 0.0)
    go(3, 0.0, jump=full / 3)  # while settling: the odd frame becomes the reference
    go(12, 1.0)
    for rate in (0.9 * most, -0.9 * most):  # more turns than are counted
        restart()
        go(int(6.0 * full / (0.9 * most)), rate)
        go(5, 0.0, bad=(1, 2))
    start = {p.name: np.full(p.size, p.init) for p in block.state}
    count = np.concatenate([a for a, _ in parts])
    frame = np.concatenate([b for _, b in parts])
    inputs = {"count": count, "frame_error": frame}
    broken = {k: v.copy() for k, v in inputs.items()}
    for p in block.inputs:
        hit = rng.random(len(count)) < 0.04
        broken[p.name][hit] = rng.choice([*SPECIAL, p.high + 1.0], int(hit.sum()))
    again = dict.fromkeys(fresh, start)
    return [
        Stream("motion, gaps and slips", inputs, again),
        Stream("the same, with invalid inputs", broken, again),
    ]


def _encoder_edges(block: Block, dtype: np.dtype[Any]) -> Stream:
    # Zeros that put a first frame half way between two turns, a hair to either side, and a little
    # less than a percent; whether zeroed, at its threshold; and steps as far as is believed after
    # so many bad frames, and one count farther.
    count, word = block.inputs
    constant = {c.name: c.value for c in block.constants}
    most, held = int(constant["step_max_counts"]), int(constant["held_max"])
    offset, zeroed = block.coefficients
    start = {p.name: np.full(p.size, p.init) for p in block.state}
    full = count.high + 1
    turn = block.step.n_out() + [name for name, _ in block.labels].index("turn_wanted")

    def wanted(zero: float, at: float) -> float:
        # The Block's own formula: the turn that a first frame asks for.
        first = [zero, 0.0, *(p.init for p in block.state), at, 0.0]
        return float(block.labelled_step.call([ca.DM(x) for x in first])[turn])

    frames: list[tuple[dict[str, Array], dict[str, Array], float]] = []
    for at in (0.0, 1.0, np.floor(full / 3), full - 1):
        here, slope = wanted(0.0, at), wanted(1.0, at) - wanted(0.0, at)
        for half in np.arange(-5, 5) + 0.5:
            zero = (half - here) / slope
            if not offset.low < zero < offset.high:
                continue
            tie = dtype.type(zero)
            near = [tie + k * np.spacing(tie) for k in range(-6, 7)]
            near += [dtype.type((half * (1 + s) - here) / slope) for s in (-4e-3, 4e-3)]
            frames += [(start, {offset.name: np.array([float(z)])}, at) for z in near]
    edge = dtype.type(0.5)
    for value in (edge - np.spacing(edge), edge, edge + np.spacing(edge), dtype.type(0.503)):
        frames.append((start, {zeroed.name: np.array([float(value)])}, 0.0))
    for bad in range(held + 1):
        for far in (0, 1):
            for way in (-1, 1):
                step = way * (most * (bad + 1) + far)
                for settled, last in product((2.0, 4.0), (full // 2, 2.0, full - 3.0)):
                    past = {"held": bad, "settled": settled, "count_last": last, "turn": 1.0}
                    state = start | {k: np.array([float(v)]) for k, v in past.items()}
                    frames.append((state, {}, (last + step) % full))
    return Stream(
        "edges of turn, zero and reach",
        {count.name: np.array([f[2] for f in frames]), word.name: np.zeros(len(frames))},
        {k: f[0] for k, f in enumerate(frames)},
        {k: f[1] for k, f in enumerate(frames)},
    )


# -- control ---------------------------------------------------------------------------------------


def _sliding_mode(block: Block, rng: np.random.Generator) -> list[Stream]:
    # On and off, the command applied one or two periods late, clipped, or held at zero; errors from
    # a hundredth of the boundary layer to far beyond it.
    steps = 3000
    t = np.arange(steps)
    ports = {p.name: p for p in block.inputs}
    sizes = {p.name: np.zeros(steps) for p in block.inputs}

    def wave(name: str, share: float, period: float) -> Array:
        size = share * ports[name].high
        return np.asarray(size * np.sin(2 * np.pi * t / period + rng.uniform(0, 6)))

    sizes["mode"] = np.where((t // 170) % 4 == 3, 0.0, 1.0 + (t // 700) % 2)
    grow = 10.0 ** (-2 + 2 * (t % 900) / 900)
    for name, period in (("delta_set_rad", 260.0), ("theta_rad", 240.0)):
        sizes[name] = grow * wave(name, 0.3, period)
    for name, share, period in (
        ("delta_rate_rad_s", 0.05, 70.0),
        ("delta_acc_rad_s2", 0.02, 50.0),
        ("omega_motor_rad_s", 0.05, 80.0),
        ("omega_load_rad_s", 0.05, 85.0),
        ("tau_Nm", 0.1, 150.0),
        ("tau_h_Nm", 0.1, 190.0),
        ("d4_rad_s2", 0.1, 110.0),
        ("u_a_Nm", 0.5, 60.0),
    ):
        sizes[name] = (0.2 + grow) * wave(name, share, period)
    applied = ports["u_applied_Nm"].high
    out = []
    for name, late in (("applied one step late", 1), ("applied two steps late", 2)):
        # What the Block itself asked for, so that only a true difference holds it back.
        x = {k: single(v) for k, v in sizes.items()}
        simulator = block.simulator()
        asked = [0.0, 0.0]
        for k in range(steps):
            u = asked[-late] if late <= len(asked) else 0.0
            part = k // 200 % 5
            if part == 3:
                u = float(np.clip(u, -0.3 * applied, 0.3 * applied))
            elif part == 4:
                u = 0.0
            x["u_applied_Nm"][k] = single(u)
            y = simulator.step(**{n: float(v[k]) for n, v in x.items()})
            asked.append(float(single(y["u_command_Nm"])))
        out.append(Stream(name, x))
    return out


def _reference(block: Block, rng: np.random.Generator) -> list[Stream]:
    # Modes held for a while, so that offsets fade; samples that are no number in between.
    steps = 3000
    t = np.arange(steps)
    x = {
        p.name: single(0.5 * (p.low + p.high) + 0.3 * (p.high - p.low) * np.sin(t / (40.0 + 7 * i)))
        for i, p in enumerate(block.inputs)
    }
    x["mode"] = np.array([1.0, 2.0, 0.0, 2.0, 1.0, 0.0])[t // 250 % 6]
    for p in block.inputs:
        hit = rng.random(steps) < 0.002
        x[p.name][hit] = rng.choice(SPECIAL, int(hit.sum()))
    return [Stream("modes held", x)]


def _joint(block: Block, rng: np.random.Generator) -> list[Stream]:
    # Both sides together, a deflection apart; each encoder usable or not.
    steps = 1500
    low, high = next((p.low, p.high) for p in block.inputs if p.name == "theta_load_rad")
    bent = next(p.high for p in block.outputs if p.name == "theta_rad")
    t = np.arange(steps)
    load = single(0.5 * (low + high) + 0.4 * (high - low) * np.sin(t / 90))
    motor = single(load + 1.2 * bent * np.sin(t / 17))
    usable = np.array(list(product((1.0, 0.0, 0.5), repeat=2)))[t // 40 % 9]
    names = ("motor_usable", "load_usable")
    x = {"theta_load_rad": load, "theta_motor_rad": motor}
    x |= {name: usable[:, k] for k, name in enumerate(names)}
    return [Stream("both sides together", x)]


_EVENTS: dict[str, Callable[[Block, np.random.Generator], list[Stream]]] = {
    "limits": _limits,
    "encoder_motor": _encoder,
    "encoder_load": _encoder,
    "sliding_mode": _sliding_mode,
    "reference": _reference,
    "joint": _joint,
}


# -- whole systems ---------------------------------------------------------------------------------


def working_inputs(system: System, task: Task, steps: int) -> dict[str, Array]:
    """Inputs of a task under which a controlling System works: encoders move, a law acts.

    return: by external input, float32 numbers: counts that move slowly, modes in turn, one request
        to release the limits, one stop near the end, waves on all else.
    """
    t = np.arange(float(steps))
    found = {}
    for i, x in enumerate(system.task_inputs(task)):
        name = x.name
        if name.startswith("count"):
            value = np.floor(0.02 * x.port.high * (1 + np.sin(t / 150 + 0.9 * i)))
        elif name.startswith("frame_error"):
            value = np.where((t > 0) & (t % 211 == 7 * i), 1.0, 0.0)
        elif name == "mode":
            value = np.where(t < 60, 0.0, 1.0 + (t // 300) % 2)
        elif name == "rearm":
            value = np.where(t < 30, 0.0, 1.0)
        elif name == "stop":
            value = np.where(t > steps - 50, 1.0, 0.0)
        else:
            value = 0.2 * x.port.high * np.sin(t / (37 + 5 * i))
        found[name] = single(value if x.port.size == 1 else np.tile(value[:, None], x.port.size))
    return found
