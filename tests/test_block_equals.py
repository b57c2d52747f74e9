"""What Blocks decide where both sides of a comparison are equal, and a hair beyond it."""

from __future__ import annotations

from math import exp, inf, nextafter
from types import SimpleNamespace

import casadi as ca
import pytest

from esea_gen.control.adaptation import adaptation
from esea_gen.control.law_switch import law_switch
from esea_gen.control.limits import command_stamp
from esea_gen.control.passivity import passivity
from esea_gen.control.rubber_ahead import FamilyAhead
from esea_gen.device import load_device
from esea_gen.errors import UserError
from esea_gen.observe.disturbance import bandwidth_limit_1_s, bandwidth_tunable
from esea_gen.observe.rates import cutoff_range

from .test_block_ends import Step, above, made


def below(x):
    return nextafter(x, -inf)


def test_a_limb_moves_above_a_hundredth_of_a_radian_per_second():
    # The speed's square is the mean square, so that the mean stays.
    assert 0.01 * 0.01 == 1e-4
    given = {"mode": 1.0, "sensing_ok": 1.0, "omega_load_rad_s": 0.01}
    for square, shown in ((1e-4, 1.0), (above(1e-4), 2.0)):
        step = Step(made(passivity), {"square_rad2_s2": square, "seen": 1.0}, **given)
        assert (step.s["square_rad2_s2"], step.y["mode_ahead"]) == (square, shown)


def test_what_is_asked_is_sound_by_a_whole_one():
    block = made(passivity)
    switch = law_switch(load_device("elbow_drive"), ("one", "other", "third"), ("other",))
    stamp = command_stamp(load_device("elbow_drive"), checked=True)
    for ok, sound in ((1.0, 1), (below(1.0), 0), (0.0, 0)):
        assert Step(block, request_ok=ok).y["request_ok"] == sound
        assert Step(switch, law=1.0, ok_other=ok).y["request_ok"] == sound
        y = Step(stamp, {"beats": 6.0}, request_ok=ok, u_command_Nm=0.1).y
        assert (y["control_beat"], y["u_command_Nm"]) == (7 * sound, 0.1 * sound)
    # Tunables may stand at the ends of their ranges.
    for t in block.tunables:
        for end in (t.low, t.high):
            assert Step(block, {}, {t.name: end}, request_ok=1.0).y["request_ok"] == 1
    for law in (0.0, 2.0):
        assert Step(switch, law=law, ok_other=0.0).y["request_ok"] == 1


def test_the_stamp_goes_from_255_to_1():
    block = command_stamp(load_device("elbow_drive"))
    for last, beat in ((0.0, 1), (253.0, 254), (254.0, 255), (255.0, 1)):
        assert Step(block, {"beats": last}).y["control_beat"] == beat


def test_of_three_laws_the_one_whose_place_is_given_is_in_force():
    block = made(law_switch, ("one", "other", "third"))
    commands = {"u_one_Nm": 0.01, "u_other_Nm": 0.02, "u_third_Nm": 0.03}
    for law, held, unknown in (
        *((0.0, 0, False), (1.0, 1, False), (2.0, 2, False)),
        *((above(1.0), 1, True), (below(1.0), 1, True), (0.5, 1, True), (1.5, 1, True)),
    ):
        # In force already, without an offset: the command is that law's own.
        step = Step(block, {"law_held": float(held)}, law=law, **commands)
        assert (step.y["law_held"], step.y["u_command_Nm"]) == (held, 0.01 * (held + 1))
        assert step.flags == ({"LAW_UNKNOWN"} if unknown else set())


FRESH = ("weighed", "weight_lag_Nm", "tau_lag_Nm", "stop_known_Nm", "square_Nm2")


def learning(state, **inputs):
    usual = dict.fromkeys(FRESH, 1.0) | {"mean_Nm": 1.0}
    given = {"sensing_ok": 1.0, "tau_Nm": 1.0} | inputs
    return Step(made(adaptation), usual | state, {"mass_Nm": 1.0}, **given)


@pytest.mark.parametrize("side", [1, -1])
def test_a_mass_teaches_while_what_is_missed_is_half_a_newton_metre_and_half_its_torque(side):
    # At rest at 0: the mass has no torque, and what the sensor shows is missed.
    rest = {"weight_lag_Nm": 0.0, "stop_known_Nm": 0.0, "mean_Nm": 0.0}
    for tau, flags in ((0.5, {"LEARNS"}), (above(0.5), {"IMPLAUSIBLE"})):
        step = learning(rest | {"tau_lag_Nm": side * tau}, tau_Nm=side * tau)
        assert step.y["missed_Nm"] == side * tau
        assert step.flags == flags


def test_a_mass_teaches_once_its_torque_has_changed_enough():
    # About a mean of none nothing is added, and a little of the square fades.
    rest = dict.fromkeys((*FRESH[1:4], "mean_Nm"), 0.0)
    keep = exp(-0.001 / 5)
    square, found = 0.05 / keep - 4e-17, {}
    while square < 0.05 / keep + 4e-17:
        square = above(square)
        step = learning(rest | {"square_Nm2": square}, tau_Nm=0.0)
        found[step.s["square_Nm2"]] = "LEARNS" in step.flags
    assert {square > 0.05: learns for square, learns in found.items()} == {True: True, False: False}
    assert found[0.05] is False


def test_a_path_is_held_within_the_sensors_reach():
    kept = []

    class Tape:
        def keep(self, name, value, slopes):
            kept.append((name, value, slopes))
            return value

    d = ca.SX.sym("d")
    FamilyAhead._within(SimpleNamespace(reach=0.375), Tape(), "within", d)
    ((name, value, slopes),) = kept
    assert name == "within"
    shown = ca.Function("f", [d], [value, slopes[d](value)])
    for at, held, slope in (
        *((0.0, 0.0, 1), (0.3, 0.3, 1), (below(0.375), below(0.375), 1)),
        *((0.375, 0.375, 0), (0.5, 0.375, 0), (-0.375, -0.375, 0), (-0.4, -0.375, 0)),
    ):
        assert tuple(float(x) for x in shown(at)) == (held, slope)


def test_a_velocity_filter_up_to_two_fifths_of_the_rate():
    device = SimpleNamespace(period_s=0.001, origin="mine")
    for cutoff, ends in ((400.0, (200.0, 400.0)), (200.0, (100.0, 400.0)), (50.0, (25.0, 100.0))):
        assert cutoff_range(device, SimpleNamespace(value=cutoff)) == ends
    with pytest.raises(UserError, match="above 400 Hz"):
        cutoff_range(device, SimpleNamespace(value=above(400.0)))


def test_an_observer_up_to_what_its_filter_allows():
    device = load_device("elbow_drive")
    cutoff = device.file.joint.motor_velocity_Hz
    limit = bandwidth_limit_1_s(device, cutoff)
    quantity = SimpleNamespace(value=limit, source="here", status="assumed")
    assert bandwidth_tunable(device, quantity, cutoff, "a.b", "c.d").name == "bandwidth_1_s"
    quantity.value = above(limit)
    with pytest.raises(UserError, match=r"a\.b = "):
        bandwidth_tunable(device, quantity, cutoff, "a.b", "c.d")
