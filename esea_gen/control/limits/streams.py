"""Test streams of the limits: every fault and its release, requests, corrupt memory."""

from __future__ import annotations

from typing import Any

import numpy as np

from esea_gen.control.limits.safety import STALE_PERIODS
from esea_gen.language.block import Block
from esea_gen.language.ports import Array
from esea_gen.language.stream import OwnStreams, Stream, coefficient_edges, single


class _Joint:
    """Inputs of the limits: a sound joint, then events."""

    def __init__(self, block: Block, steps: int, rng: np.random.Generator) -> None:
        k: Array = np.arange(float(steps))
        self.block, self.rng = block, rng
        self.ports = {p.name: p for p in block.inputs}
        self.t = {t.name: t.default for t in block.tunables}
        self.constant = {c.name: c.value for c in block.constants}
        self.steps = steps
        self.deliver = (
            int(self.constant["stale_ticks"]) // STALE_PERIODS
        )  # periods of the control task
        self.middle = 0.5 * (self.t["rom_min_rad"] + self.t["rom_max_rad"])
        self.bent = 0.2 * self.t["theta_max_rad"]
        self.x: dict[str, Array] = {name: np.zeros(steps) for name in self.ports}
        # From near its end, so that the stamp's wrap is seen.
        self.x["control_beat"] = 1.0 + (240 + k // self.deliver) % 255
        self.x["request_ok"][:] = 1
        self.x["sensing_ok"][:] = 1
        self.x["clock_ok"][:] = 1
        self.x["coeffs_ok"][:] = 1
        if "u_thermal_Nm" in self.ports:
            self.x["u_thermal_Nm"][:] = self.ports["u_thermal_Nm"].high
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
        assert self.at < self.steps, (name, self.at)
        return Stream(name, {k: single(v) for k, v in self.x.items()}, injections or {})


def _above(limit: float, share: float = 1.02) -> tuple[float, float]:
    return share * limit, -share * limit


def _events(block: Block, rng: np.random.Generator) -> list[Stream]:
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
    j = _Joint(block, 7200, rng)
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
        {"clock_ok": 0.0},
        {"clock_ok": 0.5},
        {"late_level": 129.0},
        {"coeffs_ok": 0.0},
        {"coeffs_ok": 0.5},
    ]
    causes += [{"doubt": v} for v in (0.5, 1.0, 2.0, 3.0) if "doubt" in j.ports]
    causes += [{"u_thermal_Nm": 0.0}] if "u_thermal_Nm" in j.ports else []
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
    # A control task that falls silent: for as long as is let pass, and for longer.
    for missed in (STALE_PERIODS - 1, STALE_PERIODS + 1):
        frozen = j.x["control_beat"][j.at]
        j.put(missed * j.deliver + 1, control_beat=frozen)
        j.at += 2 * j.deliver
        j.release()
    return j.stream("every fault, and its release")


def _causes_together(block: Block, rng: np.random.Generator) -> Stream:
    # Any two causes in one step, from the released state: one reason is kept, not a mixture.
    j = _Joint(block, 4400, rng)
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
        {"clock_ok": 0.0},
        {"late_level": 255.0},
        {"coeffs_ok": 0.0},
    ]
    causes += [{"doubt": 1.0}] if "doubt" in j.ports else []
    causes += [{"u_thermal_Nm": 0.0}] if "u_thermal_Nm" in j.ports else []
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
    if "u_thermal_Nm" in j.ports:
        j.put(200, u_thermal_Nm=0.3 * t["u_max_Nm"])
    j.put(40, mode=0.0)  # off is not a fault: the command is ramped down
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

    def request(jump: int, **others: float) -> None:
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
    rearm[j.at] = 3.5  # no request, and no number to count from: the one before it counts
    j.at += 1
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
            ticks, tau_Nm=0.9 * t["tau_max_Nm"], omega_load_rad_s=sign * 0.75 * t["omega_max_rad_s"]
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


def _bad_coefficients(
    block: Block, dtype: np.dtype[Any], _rng: np.random.Generator
) -> list[Stream]:
    cases = coefficient_edges(block, dtype)
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
    return [Stream("coefficients out of their ranges", x, {}, changes)]


STREAMS = OwnStreams(_events, _bad_coefficients)
