"""The semantics of the limits a second time, as a plain state machine, and streams to try it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import strategies as st

from esea_gen.control.limits.block import limits
from esea_gen.control.limits.faults import Fault
from esea_gen.device import Device, parse_device
from esea_gen.hostlib.library import CRunner, compile_block
from esea_gen.language.stream import SPECIAL, single

REALS = ["f64", "f32"]
REARMS = range(8)


def down(x: float) -> float:
    """The largest float32 not above a positive number."""
    y = np.float32(x)
    return float(y if float(y) <= x else np.nextafter(y, np.float32(0)))


@dataclass(frozen=True)
class Numbers:
    """Safety maxima of the device under test, typed again."""

    u: float = down(0.221)
    step: float = down(50.0 * 1e-3)
    tau: float = 8.0
    theta: float = down(0.3)
    low: float = -down(0.15)
    high: float = 2.5
    margin: float = down(0.2)
    omega: float = 10.0
    energy: float = 15.0
    window_ticks: int = 1000
    ranges: dict = field(
        default_factory=lambda: {
            "u_command_Nm": (-4 * 0.221, 4 * 0.221),
            "control_beat": (0, 255),
            "mode": (0, 2),
            "stop": (0, 1),
            "rearm": (0, 7),
            "request_ok": (0, 1),
            "sensing_ok": (0, 1),
            "theta_rad": (-0.35, 0.35),
            "theta_motor_rad": (-0.95, 3.35),
            "omega_motor_rad_s": (-12, 12),
            "theta_load_rad": (-0.6, 3.0),
            "omega_load_rad_s": (-12, 12),
            "tau_Nm": (-20, 20),
            "clock_ok": (0, 1),
            "late_level": (0, 255),
            "coeffs_ok": (0, 1),
            "doubt": (0, 3),
        }
    )


SHIPPED = Numbers()
BRISK = Numbers(energy=1.0, window_ticks=50)  # the energy limit acts within a short stream
FLAGS = [
    "INPUT_INVALID", "STATE_REPAIRED", "TUNABLE_INVALID", "STOPPED", "SENSING_LOST",
    "CONTROL_STALE", "DEFLECTION", "INTERACTION_TORQUE", "SPEED", "RANGE_OF_MOTION", "ENERGY",
    "TORQUE_CLIPPED", "RATE_LIMITED", "ROM_LOW", "ROM_HIGH", "SPEED_LIMITED", "REARM_REFUSED",
    "FAULT_LATCHED", "CLOCK", "LATE", "COEFFICIENTS", "SWINGS", "ROUGH", "STUCK_BIT",
]  # fmt: skip
BIT = {name: 1 << i for i, name in enumerate(FLAGS)}


def changed(device: Device, **safety: float) -> Device:
    """The device with other safety numbers."""
    text = device.toml()
    for key, value in safety.items():
        old = getattr(device.file.safety, key).value
        assert f"\n{key} = {{ value = {old!r}," in text.split("[safety]")[1]
        head, tail = text.split("[safety]")
        tail = tail.replace(f"\n{key} = {{ value = {old!r},", f"\n{key} = {{ value = {value!r},")
        text = head + "[safety]" + tail
    return parse_device(text, "changed.toml")


def compiled(device: Device, real: str) -> CRunner:
    return compile_block(limits(device), real)


# -- the semantics a second time: a plain state machine --------------------------------------------


WHOLE = {"stop", "mode", "rearm", "doubt", "control_beat", "late_level"}
WHOLE |= {"request_ok", "sensing_ok", "clock_ok", "coeffs_ok"}


class PlainLimits:
    """The checks of docs/limit-checks.md, in plain floats; ``unsure`` collects near ties."""

    def __init__(self, numbers: Numbers, tie: float) -> None:
        self.n, self.tie = numbers, tie
        self.fault, self.u, self.rearm = Fault.NOT_ARMED, 0.0, None
        self.beat, self.delivered_at, self.tick = 0.0, None, -1
        self.given: list[float] = []

    def step(self, **x: float) -> dict:
        n = self.n
        self.tick += 1
        # A flag, a count or a choice that is not a whole number is none.
        x |= {k: np.nan for k, v in x.items() if k in WHOLE and v % 1 != 0}
        valid = all(lo <= x[k] <= hi for k, (lo, hi) in n.ranges.items() if k != "stop")
        bad_stop = x["stop"] != 0
        stop_invalid = not 0 <= x["stop"] <= 1
        ok = valid and not stop_invalid and x["request_ok"] == 1
        near = []

        beat = x["control_beat"] if 0 <= x["control_beat"] <= 255 else self.beat
        if beat >= 1 and beat != self.beat:
            self.delivered_at = self.tick
        if beat < 1:
            self.delivered_at = None
        self.beat = beat
        stale = self.delivered_at is None or self.tick - self.delivered_at >= 25

        def value(name):
            lo, hi = n.ranges[name]
            return x[name] if lo <= x[name] <= hi else 0.0

        late = value("late_level") if 0 <= x["late_level"] <= 255 else 255
        tau, omega_l, omega_m = map(value, ("tau_Nm", "omega_load_rad_s", "omega_motor_rad_s"))
        theta, theta_l = value("theta_rad"), value("theta_load_rad")
        self.given.append(1e-3 * max(tau * omega_l, 0.0))
        slot = n.window_ticks // 10
        first = max(0, self.tick // slot - 10) * slot
        energy = sum(self.given[first:])
        apart = value("theta_motor_rad") - theta_l
        if valid and not stop_invalid:
            near.append(abs(abs(apart) - n.theta))
        near.append(abs(energy - n.energy))

        measured = valid and not stop_invalid
        causes = [
            (Fault.STOP, bad_stop),
            (Fault.INPUT_INVALID, not ok),
            (Fault.SENSING, x["sensing_ok"] != 1),
            (Fault.CONTROL_STALE, stale),
            (Fault.DEFLECTION, measured and (abs(theta) > n.theta or abs(apart) > n.theta)),
            (Fault.TORQUE, measured and abs(tau) > n.tau),
            (Fault.SPEED, measured and max(abs(omega_l), abs(omega_m)) > n.omega),
            (
                Fault.RANGE_OF_MOTION,
                measured and not n.low - n.margin <= theta_l <= n.high + n.margin,
            ),
            (Fault.ENERGY, energy > n.energy),
            (Fault.CLOCK, x["clock_ok"] != 1),
            (Fault.LATE, late > 128),
            (Fault.COEFFICIENTS, x["coeffs_ok"] != 1),
            (Fault.SWINGS, x["doubt"] == 1),
            (Fault.ROUGH, x["doubt"] == 2),
            (Fault.STUCK_BIT, x["doubt"] == 3),
        ]
        found = [f for f, is_so in causes if is_so]
        edge = self.rearm is not None and x["rearm"] == (self.rearm + 1) % 8
        other = self.rearm is not None and x["rearm"] in REARMS and x["rearm"] != self.rearm
        if x["rearm"] in REARMS:
            self.rearm = int(x["rearm"])
        was = self.fault
        if self.fault is Fault.NONE:
            if found:
                self.fault = found[0]
        elif not found and edge and x["mode"] == 0 and x["u_command_Nm"] == 0:
            self.fault = Fault.NONE

        bits = dict.fromkeys(FLAGS, False)
        for fault, flag in (
            (Fault.STOP, "STOPPED"), (Fault.INPUT_INVALID, "INPUT_INVALID"),
            (Fault.SENSING, "SENSING_LOST"), (Fault.CONTROL_STALE, "CONTROL_STALE"),
            (Fault.DEFLECTION, "DEFLECTION"), (Fault.TORQUE, "INTERACTION_TORQUE"),
            (Fault.SPEED, "SPEED"), (Fault.RANGE_OF_MOTION, "RANGE_OF_MOTION"),
            (Fault.ENERGY, "ENERGY"), (Fault.CLOCK, "CLOCK"), (Fault.LATE, "LATE"),
            (Fault.COEFFICIENTS, "COEFFICIENTS"),
            *((f, f.name) for f in Fault if Fault.COEFFICIENTS < f < Fault.MOTOR_HOT),
        ):  # fmt: skip
            bits[flag] = fault in found
        bits["REARM_REFUSED"] = other and was is not Fault.NONE and self.fault is not Fault.NONE
        bits["FAULT_LATCHED"] = self.fault is not Fault.NONE
        cut = lag = 0.0
        if self.fault is Fault.NONE:
            wanted = x["u_command_Nm"] if x["mode"] else 0.0
            clipped = min(max(wanted, -n.u), n.u)
            per_speed = n.u / (0.1 * n.omega)
            rom_up = max(0.0, n.u / n.margin * (n.high - theta_l))
            rom_down = max(0.0, n.u / n.margin * (theta_l - n.low))
            speed_up = max(0.0, per_speed * (0.9 * n.omega - max(omega_l, omega_m)))
            speed_down = max(0.0, per_speed * (0.9 * n.omega + min(omega_l, omega_m)))
            shaped = max(-min(rom_down, speed_down), min(clipped, rom_up, speed_up))
            move = n.step
            u = min(max(shaped, self.u - move), self.u + move)
            bits["TORQUE_CLIPPED"] = abs(wanted) > n.u
            bits["ROM_LOW"], bits["ROM_HIGH"] = clipped < -rom_down, clipped > rom_up
            bits["SPEED_LIMITED"] = clipped < -speed_down or clipped > speed_up
            bits["RATE_LIMITED"] = u != shaped
            near += [abs(clipped + rom_down), abs(clipped - rom_up)] if wanted else []
            near += [abs(clipped + speed_down), abs(clipped - speed_up)] if wanted else []
            near.append(abs(abs(shaped - self.u) - move))
            cut, lag, self.u = clipped - shaped, shaped - u, u
        else:
            self.u = 0.0
        return {
            "u_Nm": self.u, "u_cut_Nm": cut, "u_lag_Nm": lag, "energy_J": energy,
            "fault": int(self.fault), "status": sum(BIT[k] for k, v in bits.items() if v),
            "unsure": min(near) < self.tie,
        }  # fmt: skip


# -- streams ---------------------------------------------------------------------------------------

STEPS = 260
DELIVER = 5  # control periods of 5 ms


def calm(steps: int = STEPS) -> dict[str, np.ndarray]:
    """Everything in order: armed at tick 3, mode 1 from tick 6, a command that wanders."""
    t = np.arange(steps)
    x = {k: np.zeros(steps) for k in SHIPPED.ranges}
    x["control_beat"] = 1.0 + (t // DELIVER) % 255
    x["rearm"][3:] = 1
    x["mode"][6:] = 1
    x["request_ok"][:] = 1
    x["sensing_ok"][:] = 1
    x["clock_ok"][:] = 1
    x["coeffs_ok"][:] = 1
    x["theta_load_rad"][:] = 1.0
    x["theta_motor_rad"][:] = 1.05
    x["theta_rad"][:] = 0.05
    x["tau_Nm"][:] = 1.0
    x["u_command_Nm"] = np.where(t >= 6, 0.1 * np.sin(0.9 * (t // DELIVER)), 0.0)
    return {k: single(v) for k, v in x.items()}


def recover(x: dict[str, np.ndarray], at: int) -> None:
    """A proper release: off, one more request, then on again."""
    for name in ("mode", "stop", "u_command_Nm"):
        x[name][at : at + 4] = 0
    x["rearm"][at + 2 :] = (x["rearm"][at] + 1) % 8


def marks(name: str) -> list[float]:
    """Values worth trying on a port: limits and their float32 neighbours, ends, nonsense."""
    n, (lo, hi) = SHIPPED, SHIPPED.ranges[name]
    own = {
        "u_command_Nm": [n.u, -n.u, 0.05],
        "theta_rad": [n.theta, -n.theta],
        "theta_motor_rad": [1.3, 0.7],
        "theta_load_rad": [n.low, n.high, n.low - n.margin, n.high + n.margin, 2.4, -0.05],
        "omega_load_rad_s": [n.omega, -n.omega, 8.0, 9.0, -8.5, 9.5],
        "omega_motor_rad_s": [n.omega, -n.omega, 8.5, -9.0],
        "tau_Nm": [n.tau, -n.tau, 7.9, -7.9],
    }.get(name, [0, 1, 2, 7, 0.5, -1])
    near = np.array([*own, lo, hi], dtype=np.float32)
    return [
        *near, *np.nextafter(near, np.float32(np.inf)), *np.nextafter(near, np.float32(-np.inf)),
        *SPECIAL, 1e30, -1e30, 0.0, -0.0, 1e-45,
    ]  # fmt: skip


EVENT = st.one_of(
    st.sampled_from(list(SHIPPED.ranges)).flatmap(
        lambda name: st.tuples(
            st.just("set"),
            st.just(name),
            st.one_of(
                st.sampled_from(marks(name)),
                st.floats(*(float(np.float32(v)) for v in SHIPPED.ranges[name]), width=32),
                st.floats(width=32),
            ),
            st.integers(0, STEPS - 1),
            st.sampled_from([1, 1, 2, 7, 40, 150]),
        )
    ),
    st.tuples(st.just("recover"), st.integers(8, STEPS - 8)),
    st.tuples(st.just("rearm"), st.integers(0, STEPS - 1), st.integers(1, 7)),
    st.tuples(st.just("freeze"), st.integers(0, STEPS - 1), st.integers(1, 30)),
    st.tuples(st.just("drive"), st.integers(0, STEPS - 1), st.sampled_from([3, 12, 30, 90])),
    st.tuples(st.just("command"), st.integers(0, 99)),
)


def stream_of(events) -> dict[str, np.ndarray]:
    x = calm()
    for kind, *args in events:
        if kind == "set":
            name, v, at, length = args
            x[name][at : at + length] = v
        elif kind == "recover":
            recover(x, args[0])
        elif kind == "rearm":
            at, jump = args
            x["rearm"][at:] = (x["rearm"][at] + jump) % 8
        elif kind == "freeze":
            at, length = args
            x["control_beat"][at : at + length] = x["control_beat"][at]
        elif kind == "drive":  # the limb moves with the torque: energy
            at, length = args
            x["tau_Nm"][at : at + length] = 7.5
            x["omega_load_rad_s"][at : at + length] = 7.0
        else:
            wild = np.random.default_rng(args[0]).uniform(-0.5, 0.5, STEPS)
            x["u_command_Nm"] = np.where(x["mode"] != 0, wild, x["u_command_Nm"])
    return {k: single(v) for k, v in x.items()}


def rows(x: dict[str, np.ndarray]):
    return (dict(zip(x, map(float, v), strict=True)) for v in zip(*x.values(), strict=True))


def invariants(y: dict[str, np.ndarray], x: dict[str, np.ndarray], n: Numbers) -> None:
    """What must hold whatever comes in, read off the outputs alone."""
    u, status = y["u_Nm"].astype(float), y["status"].astype(int)
    assert all(np.all(np.isfinite(v.astype(float))) for v in y.values())
    assert np.all(np.abs(u) <= n.u)
    latched = y["fault"] != 0
    assert np.all(u[latched] == 0)
    assert np.array_equal(latched, (status & BIT["FAULT_LATCHED"]) != 0)
    before = np.concatenate([[0.0], u[:-1]])
    one_ulp = float(np.spacing(np.float32(n.u)))
    assert np.all((np.abs(u - before) <= n.step + one_ulp) | latched)
    assert np.all(latched[x["stop"] != 0])
    assert np.all(latched[np.any([~np.isfinite(v) for v in x.values()], axis=0)])
    for k in np.flatnonzero(~latched & np.concatenate([[True], latched[:-1]])):
        assert x["mode"][k] == 0
        assert x["u_command_Nm"][k] == 0
        assert x["stop"][k] == 0
        before = [r for r in x["rearm"][:k] if r in REARMS]
        assert x["rearm"][k] == (before[-1] + 1) % 8
        assert u[k] == 0
    # Between two openings the reason does not change.
    same = latched[1:] & latched[:-1]
    assert np.all(y["fault"][1:][same] == y["fault"][:-1][same])


def against_plain_limits(runner: CRunner, x, numbers: Numbers, tie: float, u_error: float) -> None:
    """The C against the plain model, tick by tick up to the first near tie of computed values."""
    runner.reset()
    y, _ = runner.run(x)
    invariants(y, x, numbers)
    model = PlainLimits(numbers, tie)
    for k, row in enumerate(rows(x)):
        expected = model.step(**row)
        if expected.pop("unsure"):
            break
        got = {name: float(v[k]) for name, v in y.items()}
        assert (k, got["fault"]) == (k, expected["fault"])
        assert (k, got["status"]) == (k, expected["status"])
        for name in ("u_Nm", "u_cut_Nm", "u_lag_Nm"):
            assert got[name] == pytest.approx(expected[name], abs=u_error), (k, name)
        assert got["energy_J"] == pytest.approx(expected["energy_J"], rel=3e-5, abs=1e-12)


TIES = {"f64": 1e-12, "f32": 3e-5}
ERRORS = {"f64": 1e-12, "f32": 1e-6}


def ran(runner: CRunner, x) -> dict[str, np.ndarray]:
    runner.reset()
    return runner.run(x)[0]


AT = 100


def with_value(name: str, v: float, length: int = 1) -> dict[str, np.ndarray]:
    x = calm()
    x[name][AT : AT + length] = v
    return {k: single(a) for k, a in x.items()}


def above(v: float) -> float:
    return float(np.nextafter(np.float32(v), np.float32(np.copysign(np.inf, v))))
