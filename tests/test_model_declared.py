"""Flags, ports and constants of the Blocks that no shipped drive has, typed a second time."""

from __future__ import annotations

import math

import pytest

from esea_gen.device import load_device
from esea_gen.model.elastomer import torque_sensor
from esea_gen.model.family_inverse import family_inverse
from esea_gen.model.family_sensor import family_sensor, unit_terms
from esea_gen.model.filters import tracking_observer
from esea_gen.model.published_inverse import published_inverse
from esea_gen.model.sensing import of_axis, sensing_system
from esea_gen.model.smoothing import smoothed_deflection
from esea_gen.twin.encoders import encoder_block
from esea_gen.twin.passive import passive_block, passive_system
from esea_gen.twin.plant import plant_block, plant_system

from .test_family_steps import FITTED

BOTH = "INPUT_INVALID+ STATE_REPAIRED+"
# A plus: how often it came is counted.  Behind a slash: what it compares with a threshold.
FLAGS = {
    "smoothed": BOTH,
    "plays": f"{BOTH} TORQUE_OUTSIDE REQUEST_CLAMPED+/u_Nm,theta_rad",
    "filter": f"{BOTH} TORQUE_OUTSIDE REQUEST_CLAMPED+/u_Nm,theta_rad STEP_CLIPPED+",
    "family": f"{BOTH} THETA_OUTSIDE RATE_OUTSIDE TORQUE_OUTSIDE/tau_Nm",
    "family inverse": f"{BOTH} THETA_OUTSIDE/theta_rad RATE_OUTSIDE/omega_mid_rad_s TORQUE_OUTSIDE"
    " REQUEST_CLAMPED+/theta_rad NOT_CONVERGED+/residual_Nm",
    "plant": BOTH,
    "passive": BOTH,
}
MOST_NM = 1.01 * FITTED.most_Nm(0.35)
THRESHOLDS = {
    "plays REQUEST_CLAMPED": 0.35,
    "filter REQUEST_CLAMPED": 0.35,
    "family TORQUE_OUTSIDE": 4.47,
    "family inverse THETA_OUTSIDE": math.radians(11.5),
    "family inverse RATE_OUTSIDE": math.radians(61.6),
    "family inverse REQUEST_CLAMPED": 0.35,
    "family inverse NOT_CONVERGED": 5e-6 * MOST_NM,
}
SUBSTITUTES = {"family theta_rad": "theta_prev_rad"}


@pytest.fixture(scope="module")
def blocks():
    elbow, drive, knee = (load_device(n) for n in ("elbow", "elbow_drive", "knee"))
    return {
        "smoothed": smoothed_deflection(elbow),
        "plays": published_inverse(elbow),
        "filter": published_inverse(elbow, "a"),
        "family": family_sensor(elbow, FITTED),
        "family inverse": family_inverse(elbow, FITTED),
        "plant": plant_block(drive),
        "passive": passive_block(knee),
    }


def test_flags_in_their_order_and_their_thresholds(blocks):
    thresholds = {}
    for name, block in blocks.items():
        (flags,) = (p.flags for p in block.outputs if p.flags)
        words = [
            f"{f.name}{'+' * f.counted}{'/' * bool(f.compares)}{','.join(f.compares)}"
            for f in flags
        ]
        assert " ".join(words) == FLAGS[name]
        thresholds |= {f"{name} {f.name}": f.threshold for f in flags if f.threshold}
        (status,) = (p for p in block.outputs if p.flags)
        assert (status.low, status.high) == (0, 2 ** len(flags) - 1)
    assert thresholds == pytest.approx(THRESHOLDS, rel=1e-6)


def test_names_periods_and_what_stands_in_for_an_invalid_input(blocks):
    names = ["smoothing", "inverse_plays", "inverse_a", "sensor", "inverse", "plant", "plant"]
    assert [b.name for b in blocks.values()] == names
    assert [b.period_s for b in blocks.values()] == [1e-3] * 5 + [2e-4] * 2
    found = {f"{n} {p.name}": p.on_invalid for n, b in blocks.items() for p in b.inputs}
    assert {k: v for k, v in found.items() if v != 0} == SUBSTITUTES


def test_constants_are_the_numbers_that_a_block_is_made_of(blocks):
    def given(name):
        return {c.name: c.value for c in blocks[name].constants}

    weights = {f"w{i}_Nm": w for i, (w, _) in enumerate(FITTED.used, 1)}
    assert given("family") == {"scale_rad": 0.2} | weights
    texts = [c.source for c in blocks["family"].constants]
    assert texts[0] == "largest trained deflection"
    assert texts[1:] == [t.text for _, t in FITTED.used]
    table = {"kappa_rad": 0.106, "phi_1_rad": 4.84, "chi_rad": 0.00233}
    for name in ("plays", "filter"):
        assert given(name).items() >= table.items()
        assert given(name)["k1_Nm_rad"] == 9.39
    assert given("plant")["gear_ratio"] == 74
    tunable = published_inverse(load_device("elbow"), tunable=True)
    assert not {c.name for c in tunable.constants} & set(table)
    found = {t.name: (t.default, t.low, t.high) for t in tunable.tunables}
    assert {k: v[0] for k, v in found.items()} == table
    r, p = tunable.coefficients
    assert (r.size, r.low, r.high) == (10, 0, pytest.approx(10 * found["chi_rad"][2]))
    assert (p.size, p.low, p.high) == (10, 0, pytest.approx(found["kappa_rad"][2]))


def test_ranges_of_what_is_measured_and_of_unit_terms():
    terms = unit_terms(FITTED.member, 0.01)
    (x,), (out,) = terms.inputs, terms.outputs
    assert (x.low, x.high, x.on_invalid) == (-16, 16, "theta_prev_rad")
    # Fourfold room: of 16 operators, as two Maxwell terms have two times, each a fifth power.
    assert (out.size, out.high) == (14, pytest.approx(4 * 16 * 16.0**5, rel=1e-6))
    assert terms.period_s == 0.01


def wires(system):
    return {x.name: tuple(f"{s.instance}.{s.port}" for s in x.signals) for x in system.inputs}


def test_tasks_and_wires_of_the_virtual_plants():
    drive, knee = load_device("elbow_drive"), load_device("knee")
    inputs = ("u_Nm", "theta_p_rad", "omega_p_rad_s", "alpha_p_rad_s2", "noise")
    made = plant_system(drive)
    sides = "mlg"
    assert (made.name, made.base_period_s) == ("twin", 2e-4)
    assert [(t.name, t.blocks, t.every) for t in made.tasks] == [
        ("move", ("plant",), 1),
        ("encode", ("encoders",), 5),
    ]
    wired = wires(made)
    assert wired == {n: (f"plant.{n}",) for n in inputs} | {
        f"theta_{k}_rad": (f"encoders.theta_{k}_rad",) for k in sides
    }
    passive = passive_system(knee)
    assert passive.name == "passive_twin"
    wired = wires(passive)
    hands = ("tau_hand_Nm", "theta_l_rad", "omega_l_rad_s")
    assert wired == {n: (f"plant.{n}",) for n in hands} | {
        f"read_{k}_rad": (f"encoders.theta_{k}_rad",) for k in "ml"
    }
    assert encoder_block(knee, 2e-3).period_s == 2e-3
    assert plant_block(drive, cable=False).title != plant_block(drive).title


@pytest.mark.parametrize(
    ("name", "axis", "expected"),
    [
        ("tau_Nm", "flexion", "tau_flexion_Nm"),
        ("theta_rad", "", "theta_rad"),
        ("omega_rad_s", "flexion", "omega_flexion_rad_s"),
        ("alpha_rad_s2", "x", "alpha_x_rad_s2"),
        ("mode", "x", "mode_x"),
    ],
)
def test_a_name_with_its_axis_ends_in_its_unit(name, axis, expected):
    assert of_axis(name, axis) == expected


def test_what_measures_an_axis():
    """Counts of a device that only measures are smoothed before the torque, not so in a loop."""

    def made(name, **how):
        device = load_device(name)
        return sensing_system(device, tracking_observer(device), torque_sensor(device), **how)

    def shown(system):
        into = {x.name: {f"{s.instance}.{s.port}" for s in x.signals} for x in system.inputs}
        out = {x.name: f"{s.instance}.{s.port}" for x in system.outputs for s in x.signals}
        between = {
            f"{a.instance}.{a.port}": f"{b.instance}.{b.port}" for a, b in system.wires.items()
        }
        return into, out, between

    def axis(a):
        dash, tail = (f"_{a}", f"_{a}") if a else ("", "")
        rate, smooth, torque = (f"{b}{tail}" for b in ("velocity", "smoothing", "sensor"))
        names = [f"tau{k}" for k in ("", "_spring", "_rate", "_hysteresis")]
        out = {f"{n}{dash}_Nm": f"{torque}.{n}_Nm" for n in names}
        out |= {f"omega{dash}_rad_s": f"{rate}.omega_rad_s"}
        plain = {f"{torque}.omega_rad_s": f"{rate}.omega_mid_rad_s"}
        out |= {f"{b}_status": f"{b}.status" for b in (rate, torque)}
        smoothed = {
            f"{smooth}.omega_rad_s": f"{rate}.omega_mid_rad_s",
            f"{torque}.theta_rad": f"{smooth}.theta_smooth_rad",
        }
        return rate, smooth, torque, f"theta{dash}_rad", out, plain, smoothed

    for name, axes in (("elbow", [""]), ("wrist", ["flexion", "deviation"])):
        into, out, between = shown(made(name))
        order = []
        for a in axes:
            rate, smooth, torque, theta, own, plain, smoothed = axis(a)
            order += [rate, smooth, torque]
            assert into.pop(theta) == {f"{rate}.theta_rad", f"{smooth}.theta_rad"}
            for given, wanted in (
                (out, own | {f"{smooth}_status": f"{smooth}.status"}),
                (between, plain | smoothed),
            ):
                assert {k: given.pop(k) for k in wanted} == wanted
        assert not into | out | between
        system = made(name)
        assert list(system.blocks) == order
        assert [(t.name, t.blocks) for t in system.tasks] == [("sense", tuple(order))]
        assert (system.name, system.base_period_s) == (name, 1e-3)
    rate, _, torque, theta, own, plain, _ = axis("")
    for system in (made("elbow_drive"), made("elbow", counts=False)):
        assert shown(system) == ({theta: {f"{rate}.theta_rad", f"{torque}.theta_rad"}}, own, plain)
