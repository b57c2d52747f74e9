"""Every equation that pages show is read back from its MathML and put against a Block's step."""

from __future__ import annotations

import math
from functools import cache
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from scipy import signal

from esea_gen.control.predictive.drive import drive_model
from esea_gen.control.predictive.horizon import Horizon, Tape
from esea_gen.control.setpoint import setpoint_rates
from esea_gen.device import load_device
from esea_gen.identify.family.identification import family_device
from esea_gen.language.block import Block
from esea_gen.model.elastomer import torque_sensor
from esea_gen.model.family import FittedMember, Member, Rise, Softening, Term
from esea_gen.model.family_sensor import family_sensor
from esea_gen.model.published_inverse import published_inverse
from esea_gen.model.rubber import rubber_sensor
from esea_gen.model.temperature import TemperatureFactor
from esea_gen.observe.extrapolation import parabola
from esea_gen.observe.human import lag_observer
from esea_gen.twin.plant import plant_block
from tests.conftest import ROOT
from tests.shown_equations import names, value

DRAWS = 6
# Of the device files, typed again; what an equation does not show is left out.
KNOWN = {
    "n": 74, "i": 74, "J": 0.663, "f_v": 0.5551, "f_c": 0.4688, "w_c": 0.05, "J_h": 0.22,
    "tau_c": 0.03488, "k_1": 9.39, "k_3": 239, "J_unc": 0.05, "f_v,unc": 0.25 * 0.5551,
    "f_c,unc": 0.25 * 0.4688, "J_max": 0.713, "eta": 0.001, "k_1,unc": 1.5, "k_3,unc": 1.5,
    "k_c": 150, "k_min": 80, "T_f": 1, "tau_0": 0.2, "T_r": 1, "n_0": 0.04**2,
    "h": "h", "l_1": 0.179, "l_2": 17.7, "l_3": 209, "l_4": 3234, "F": 4096,
}  # fmt: skip
LINEAR, ROUGH = Rise("power", 1), 3e-4
FITTED = FittedMember(
    Member(
        "one",
        "one of each",
        (
            Term("spring", LINEAR, softening=Softening("strain", 0.3)),
            Term("maxwell", LINEAR, (0.1,), softening=Softening("path", 40.0)),
            Term("stop", LINEAR, (0.15,)),
            Term("slip", LINEAR, (0.1,)),
        ),
    ),
    0.2,
    (1.0, 1.0, 1.0, 1.0),
    TemperatureFactor(20.0, -0.005, 10.0, 40.0),
)


@cache
def drive(law: str = "sliding_mode"):
    return load_device("elbow_drive", law)


SPECIAL = {
    "parabola": lambda: parabola(drive()),
    "human_lag": lambda: lag_observer(drive()),
    "published": lambda: published_inverse(drive(), "a", tunable=True),
    "sensor": lambda: torque_sensor(load_device("elbow"), tunable=True),
    "dead zone": lambda: rubber_sensor(load_device("knee")),
    "family": lambda: family_sensor(drive(), FITTED),
    "differences": lambda: setpoint_rates(drive(), "differences"),
    "smoothing": lambda: load_device("elbow").system.blocks["smoothing"],
    "rigid plant": lambda: plant_block(drive(), False),
    "plant": lambda: plant_block(drive(), True),
}
LATE = 2 * (math.cos(math.pi / 8) + math.cos(3 * math.pi / 8)) / (2 * math.pi * 30) + 0.0005
EXTRA = LATE * (1 - math.exp(-1e-3 / 0.03488)) / 1e-3
SPACE = {
    **{n: getattr(np, n) for n in ("exp", "expm1", "tan", "cos", "sin")},
    **{n: getattr(np, n) for n in ("where", "clip", "dot", "arange", "polyval")},
    **{"pi": math.pi, "Rise": Rise, "ca": ca, "LATE": LATE, "EXTRA": EXTRA},
    "B": signal.butter(4, 1, analog=True),
}
# No single step has their value: a breakpoint, a table, a transfer function, sums over terms, a
# comparison.
ELSEWHERE = {"[breakpoint]", "[table]", "[DOB 3]", "[smooth]", "[family]", "[mon 3]", "[mon 4]"}


def pairs(text: str) -> list[tuple[str, str]]:
    return [tuple(x.strip().split("=", 1)) for x in text.split(";") if x.strip()]


def step_of(block: Block, share: float, put: dict[str, str], rng) -> dict[str, SimpleNamespace]:
    """A step from drawn tunables, state and inputs; every value of it by name."""
    space = SPACE | {"uniform": rng.uniform, "integers": rng.integers, "h": block.period_s}

    def drawn(p, start: float | None = None):
        if p.name in put:
            x = np.broadcast_to(eval(put[p.name], space), getattr(p, "size", 1))
        elif start is not None:
            x = start * rng.uniform(0.8, 1.2) if start else share * rng.uniform(0, 1) * p.high
        elif p.low == 0:
            x = 1.0 if p.high == 1 else np.full(p.size, share * rng.uniform(0.3, 1) * p.high)
        else:
            x = share * p.high * rng.uniform(-1, 1, p.size)
        return np.clip(x, p.low, p.high)

    t = {p.name: drawn(p, p.default) for p in block.tunables}
    c = block.prepare.call([ca.DM(x) for x in t.values()]) if t else []
    arguments = [*c, *map(ca.DM, [drawn(p) for p in (*block.state, *block.inputs)])]
    step = block.labelled_step
    named = dict(zip(step.name_in(), arguments, strict=True))
    named |= dict(zip(step.name_out(), step.call(arguments), strict=True))
    groups: dict[str, dict] = {k: {} for k in ("c", "s", "u", "next", "y", "label")}
    for name, x in named.items():
        kind, _, own = name.partition("_")
        flat = np.array(x).ravel()
        groups[kind][own] = float(flat[0]) if len(flat) == 1 else flat
    constants = {k.name: k.value for k in block.constants}
    groups |= {"t": {k: float(np.ravel(x)[0]) for k, x in t.items()}, "k": constants}
    short = {"next": "n", "label": "l"}
    return space | {short.get(k, k): SimpleNamespace(**v) for k, v in groups.items()}


TEXT = (ROOT / "tests" / "data" / "displayed_equations.txt").read_text(encoding="utf-8")
LINES = [x for x in TEXT.replace("\\\n", " ").splitlines() if not x.startswith("#")]
USUAL = dict(pairs(LINES[0]))


def blocks() -> dict[str, tuple[float, str, list[str]]]:
    found = {}
    for row in LINES[1:]:
        if row.startswith("== "):
            which, share, always = (x.strip() for x in f"{row[3:]} | ".split(" | ")[:3])
            rows = found.setdefault(which, (float(share), always, []))[2]
        else:
            rows.append(row)
    return found


@cache
def made(which: str) -> Block:
    if which in SPECIAL:
        return SPECIAL[which]()
    device, law, instance = which.split()
    law = law if device == "elbow_drive" else None
    return load_device(device, law).system.blocks[instance]


@pytest.mark.parametrize("which", blocks())
def test_what_is_shown_is_what_is_computed(which):
    block, (share, always, rows) = made(which), blocks()[which]
    shown = {e.number: e for e in block.equations}
    for row in rows:
        number, expected, symbols, more = (x.strip() for x in f"{row} |  | ".split(" | ")[:4])
        put, said = dict(pairs(always + ";" + more)), dict(pairs(symbols))
        rng = np.random.default_rng(len(row))
        for _ in range(DRAWS):
            space = step_of(block, share, put, rng)
            given = {
                n: float(eval(str(said.get(n, KNOWN.get(n, USUAL.get(n)))), space))
                for n in names(shown[number])
            }
            found = value(shown[number], given)
            rel = ROUGH if number in ("[rate 5]", "[slip]", "[path]", "(5.2)") else 2e-6
            assert found == pytest.approx(float(eval(expected, space)), rel=rel, abs=1e-9), number


@pytest.mark.parametrize("impedance", [False, True])
def test_the_prediction_moves_as_is_shown(impedance):
    """(5.1) to (5.3) are the rates of change of a vanishing substep; a cost of two squares."""
    model = drive_model(drive(), Horizon(delay_s=0.002), impedance=impedance)
    shown, h = {e.number: e for e in model.equations}, 1e-7
    x = {n: 0.1 * k + 0.05 for k, n in enumerate(model.states)} | {"omega_m": 0.04, "tau_e": 0.7}
    p = {n: 0.3 * k + 0.2 for k, n in enumerate(model.parameters)} | {"load_1_kgm2": 1 / 0.22}
    state, parameters, w = (SimpleNamespace(**v) for v in (x, p, {"tau_h": 0.4}))
    tape = Tape()
    after = dict(model.substep(tape, h, state, 0.15, parameters, w))
    given = {
        "u_c": 0.15, "u_a": x["u_a"], "omega_m": x["omega_m"], "tau_e": x["tau_e"], "tau_h": 0.4,
        "omega_w": 0.05, "d_4": p["d4_rad_s2"], "tau_d": 0.9, "Q": p["root_q"] ** 2, "R": 2.0,
        "theta_l": x.get("theta_l"), "omega_l": x["omega_l"], "theta_d": 0.6, "omega_d": -0.3,
        "sig": 0.8 * 27.64 / 32.76,
        "K_p": p.get("Kp_Nm_rad"), "K_d": p.get("Kd_Nms_rad"),
    }  # fmt: skip

    def check(number: str, expected: float, **more: float) -> float:
        known = KNOWN | given | more
        found = value(shown[number], {n: known[n] for n in names(shown[number])})
        assert found == pytest.approx(expected, rel=1e-4), number
        return found

    # Of the elastomer's memory as much as makes its torque what it was: a motion that has begun.
    moving = {"(5.1)": "u_a", "(5.2)": "omega_m", "(5.3)": "omega_l"}
    rates = [(after[n] - x[n]) / h for n in moving.values()]
    symbols, values = zip(*((e.symbol, e.value) for e in tape.entries), strict=True)
    whole = ca.substitute_inplace(
        [*symbols], [*values], [ca.SX(after["tau_e"]), *map(ca.SX, rates)]
    )
    f = ca.Function("f", [tape.memory_symbol], whole[1])
    for number, rate in zip(moving, f(x["tau_e"] - f(0)[0])[1:], strict=True):
        check(number, float(rate))
    assert check("[sig]", 0.8 * 27.64 / 32.76, z=check("[z]", 0.8)) == pytest.approx(
        np.tanh(0.8), abs=0.024
    )
    ref = SimpleNamespace(tau_d=0.9, theta_d=0.6, omega_d=-0.3)
    (error,), (effort,) = model.error(state, parameters, ref), model.effort(state, 0.15, parameters)
    e = check("(5.24)" if impedance else "[error]", error / p["root_q"])
    root_r = p["root_r"] * KNOWN["tau_c"]
    check("[cost]", error**2 + effort**2, e=e, R=root_r**2, p=0.7, v=0.0)


def test_no_equation_is_left_out():
    """Of every Block of the shipped devices, the family's and the published inverse."""
    seen = set()
    for which, (_, _, rows) in blocks().items():
        numbers = {row.split(" | ")[0].strip() for row in rows}
        seen |= {e.mathml for e in made(which).equations if e.number in numbers}
    systems = [load_device(n).system for n in ("elbow", "knee_board", "wrist_drive")]
    systems += [drive(law).system for law in ("sliding_mode", "predictive", "cascade")]
    systems += [family_device(load_device("elbow"), FITTED, "drawn").system]
    missing = {
        (b.name, e.number)
        for system in systems
        for b in system.blocks.values()
        for e in b.equations
        if e.mathml not in seen and e.number not in ELSEWHERE and b.kind == "block"
    }
    assert missing == set()
