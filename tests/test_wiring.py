"""Who reads what, in which order and how late: both shipped drives against a table typed by hand.

The table is what chapter 5, docs/control.md and docs/predictive.md ask for.  Where two signals
would both fit a port, the reason for the one that is meant stands beside it.
"""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.control.laws.predictive import device_horizon, predictive_delay_s
from esea_gen.device import load_device, parse_device
from esea_gen.twin.controllers import controller_device
from esea_gen.twin.run import previews
from esea_gen.twin.trajectories import Trajectory

# -- what all laws stand on ------------------------------------------------------------------------

SENSING = """
    joint.theta_motor_rad         encoder_motor.theta_rad
    joint.theta_load_rad          encoder_load.theta_rad
    joint.motor_usable            encoder_motor.usable
    joint.load_usable             encoder_load.usable
    velocity.theta_rad            joint.theta_rad
    sensor.theta_rad              joint.theta_rad
    # Viscosity at the middle of the step, from past samples: the sensor's inverse stays unique.
    sensor.omega_rad_s            velocity.omega_mid_rad_s
    motor_rate.theta_rad          encoder_motor.theta_rad
    load_rate.theta_rad           encoder_load.theta_rad
    reference.theta_load_rad      encoder_load.theta_rad
    reference.omega_load_rad_s    load_rate.omega_rad_s
    reference.tau_Nm              sensor.tau_Nm
"""
LIMITS = """
    # Nothing but the stamped command, as far as the drive may give it, and its stamp, through the
    # same latch.
    limits.u_command_Nm           passivity.u_command_Nm
    limits.control_beat           stamp.control_beat
    limits.request_ok             passivity.request_ok
    limits.sensing_ok             joint.sensing_ok
    limits.theta_rad              joint.theta_rad
    limits.theta_motor_rad        encoder_motor.theta_rad
    limits.omega_motor_rad_s      motor_rate.omega_rad_s
    limits.theta_load_rad         encoder_load.theta_rad
    limits.omega_load_rad_s       load_rate.omega_rad_s
    limits.tau_Nm                 sensor.tau_Nm
    limits.clock_ok               watch.clock_ok
    limits.late_level             watch.late_level
    limits.coeffs_ok              watch.coeffs_ok
"""
OBSERVERS = """
    # What the motor holds from this tick on: what the limits let through, not what was asked for.
    drive.u_Nm                    limits.u_Nm
    drive.omega_motor_rad_s       motor_rate.omega_rad_s
    drive.tau_Nm                  sensor.tau_Nm
    human.theta_load_rad          encoder_load.theta_rad
    human.tau_Nm                  sensor.tau_Nm
"""

PASSIVE = """
    # Between what is wanted and every law, and between the command and the limits.
    passivity.mode                reference.mode
    passivity.sensing_ok          joint.sensing_ok
    passivity.tau_set_Nm          reference.tau_set_Nm
    passivity.request_ok          reference.request_ok
    passivity.Kp_Nm_rad           reference.stiffness_Nm_rad
    passivity.Kd_Nms_rad          reference.damping_Nms_rad
    passivity.tau_Nm              sensor.tau_Nm
    passivity.theta_load_rad      encoder_load.theta_rad
    passivity.omega_load_rad_s    load_rate.omega_rad_s
    passivity.theta_motor_rad     encoder_motor.theta_rad
    passivity.omega_motor_rad_s   motor_rate.omega_rad_s
    passivity.u_command_Nm        stamp.u_command_Nm
"""

ADAPTED = """
    # Beside the loops: a gain and a shift of the wish, from what a known mass shows.
    reference.wish_gain           adaptation.wish_gain
    reference.wish_shift_Nm       adaptation.wish_shift_Nm
    adaptation.tau_Nm             sensor.tau_Nm
    adaptation.theta_load_rad     encoder_load.theta_rad
    adaptation.omega_load_rad_s   load_rate.omega_rad_s
    adaptation.sensing_ok         joint.sensing_ok
"""

COMPARED = """
    # All three encoders and the motor's torque against each other; the answer stops the drive by
    # way of the deflection, which is not to be trusted then.
    joint.agree                   redundancy.agree
    redundancy.theta_motor_rad    encoder_motor.theta_rad
    redundancy.motor_usable       encoder_motor.usable
    redundancy.theta_gear_rad     encoder_gear.theta_gear_rad
    redundancy.gear_usable        encoder_gear.gear_usable
    redundancy.d_gear_rad_s2      gear.d_gear_rad_s2
    redundancy.moves_rad_s2       gear.moves_rad_s2
    redundancy.tau_Nm             sensor.tau_Nm
    # The motor's own encoder, so that a coupling encoder that fails does not move what it is held
    # against; the command that was let through.
    gear.omega_gear_rad_s         encoder_gear.omega_gear_rad_s
    gear.u_Nm                     limits.u_Nm
    gear.tau_Nm                   sensor.tau_Nm
"""

# -- the laws --------------------------------------------------------------------------------------

SLIDING_MODE = """
    # Where the set torque goes, from its past; the inverse has it ahead, and the set-point is
    # smoothed over the same time.
    # Damping that a law lacks is in it.
    set_trend.tau_wanted_Nm       passivity.tau_set_Nm
    lead.tau_set_Nm               passivity.tau_set_Nm
    # Not while the limb moves: what is added against its motion is not to come late.
    lead.mode                     passivity.mode_ahead
    lead.tau_rate_Nm_s            set_trend.tau_rate_Nm_s
    lead.tau_curve_Nm_s2          set_trend.tau_curve_Nm_s2
    lead.trust                    set_trend.trust
    lead.settled                  set_trend.settled
    inverse.tau_Nm                lead.tau_led_Nm
    setpoint.theta_set_rad        inverse.theta_rad
    smooth.theta_set_rad          inverse.theta_rad
    smooth.delta_set_rad          setpoint.delta_set_rad
    smooth.delta_rate_rad_s       setpoint.delta_rate_rad_s
    smooth.delta_acc_rad_s2       setpoint.delta_acc_rad_s2
    smooth.governed               lead.governed
    # (5.12) subtracts three rates: all three through one filter, so that delays cancel.
    set_rate.theta_rad            smooth.theta_smooth_rad
    smc.delta_rate_rad_s          set_rate.omega_rad_s
    smc.omega_motor_rad_s         motor_rate.omega_rad_s
    smc.omega_load_rad_s          load_rate.omega_rad_s
    smc.delta_set_rad             smooth.delta_set_rad
    smc.delta_acc_rad_s2          smooth.delta_acc_rad_s2
    smc.theta_rad                 joint.theta_rad
    smc.tau_Nm                    sensor.tau_Nm
    smc.tau_h_Nm                  human.tau_h_Nm
    smc.d4_rad_s2                 drive.d4_rad_s2
    # (5.1): where the motor is behind its lag, and what it was told.
    smc.u_a_Nm                    drive.u_a_Nm
    smc.u_applied_Nm              limits.u_Nm
    smc.mode                      reference.mode
    stamp.u_command_Nm            smc.u_command_Nm
"""
PREDICTIVE = """
    ahead.mode                    reference.mode
    ahead.offset_Nm               reference.offset_Nm
    ahead.keep                    reference.keep
    ahead.tau_range_Nm            reference.tau_range_Nm
    ahead.Kp_Nm_rad               reference.Kp_Nm_rad
    ahead.Kd_Nms_rad              reference.Kd_Nms_rad
    # What is added, as a damping: along the horizon the speed changes.
    ahead.damping_Nms_rad         passivity.damping_Nms_rad
    ahead.theta_load_rad          encoder_load.theta_rad
    # The load side's rate without delay, for the state at the measurement.
    ahead.omega_load_rad_s        human.omega_load_rad_s
    predictive.omega_l_rad_s      human.omega_load_rad_s
    # The gear's rate and the cable behind it, by the motor's own encoder.
    predictive.omega_gear_rad_s   encoder_gear.omega_gear_rad_s
    predictive.wound_rad          cable.wound_rad
    predictive.gap_rad            cable.gap_rad
    predictive.give_rad_Nm        cable.give_rad_Nm
    cable.theta_gear_rad          encoder_gear.theta_gear_rad
    cable.gear_usable             encoder_gear.gear_usable
    cable.theta_motor_rad         encoder_motor.theta_rad
    cable.motor_usable            encoder_motor.usable
    cable.tau_Nm                  sensor.tau_Nm
    cable.mode                    reference.mode
    predictive.delta_rad          joint.theta_rad
    predictive.theta_l_rad        encoder_load.theta_rad
    # The motor's torque behind its lag, and the command that it holds until the new one comes.
    predictive.u_a_Nm             drive.u_a_Nm
    predictive.u_in_force_Nm      limits.u_Nm
    predictive.tau_rate_Nm        sensor.tau_rate_Nm
    predictive.play_rad           sensor.play_rad
    predictive.d4_rad_s2          drive_by_gear.d4_rad_s2
    drive_by_gear.u_Nm            limits.u_Nm
    drive_by_gear.omega_gear_rad_s encoder_gear.omega_gear_rad_s
    drive_by_gear.tau_Nm          sensor.tau_Nm
    predictive.tau_h_Nm           human.tau_h_Nm
    predictive.tau_h_rate_Nm_s    human.tau_h_rate_Nm_s
    # What is wanted comes by way of "ahead" alone: it may turn the mode off.
    ahead.wish_gain               adaptation.wish_gain
    ahead.wish_shift_Nm           adaptation.wish_shift_Nm
    predictive.mode               ahead.mode
    predictive.tau_d_Nm           ahead.tau_d_Nm
    predictive.theta_d_rad        ahead.theta_d_rad
    predictive.omega_d_rad_s      ahead.omega_d_rad_s
    predictive.Kp_Nm_rad          ahead.Kp_Nm_rad
    predictive.Kd_Nms_rad         ahead.Kd_Nms_rad
    stamp.u_command_Nm            predictive.u_Nm
    stamp.request_ok              ahead.request_ok
"""

# As published: the person by (5.10) and a parabola, all rates from filtered differences.
PUBLISHED = """
    predictive.d4_rad_s2          drive.d4_rad_s2
    human.omega_load_rad_s        load_rate.omega_rad_s
    parabola.tau_h_Nm             human.tau_h_Nm
    predictive.omega_m_rad_s      motor_rate.omega_rad_s
    predictive.omega_l_rad_s      load_rate.omega_rad_s
    ahead.omega_load_rad_s        load_rate.omega_rad_s
    predictive.tau_h_Nm           parabola.tau_h_fit_Nm
    predictive.tau_h_rate_Nm_s    parabola.tau_h_rate_Nm_s
    predictive.tau_h_curve_Nm_s2  parabola.tau_h_curve_Nm_s2
"""
# And gear and motor side are one inertia.
NOT_PUBLISHED = (
    *("human.theta_load_rad", "drive_by_gear.u_Nm"),
    *("drive_by_gear.omega_gear_rad_s", "drive_by_gear.tau_Nm"),
    *(f"predictive.{n}" for n in ("omega_gear_rad_s", "wound_rad", "gap_rad", "give_rad_Nm")),
    *("cable.theta_gear_rad", "cable.gear_usable", "cable.theta_motor_rad", "cable.motor_usable"),
    *("cable.tau_Nm", "cable.mode"),
)

# -- from outside and to the outside ---------------------------------------------------------------

INPUTS = """
    encoder_motor.count           count_motor
    encoder_motor.frame_error     frame_error_motor
    encoder_load.count            count_load
    encoder_load.frame_error      frame_error_load
    encoder_gear.count            count_gear
    encoder_gear.frame_error      frame_error_gear
    # The limits see the mode itself: the reference makes an invalid one "off", which is no fault.
    reference.mode                mode
    limits.mode                   mode
    limits.stop                   stop
    limits.rearm                  rearm
    reference.tau_desired_Nm      tau_desired_Nm
    adaptation.tau_desired_Nm     tau_desired_Nm
    reference.theta_desired_rad   theta_desired_rad
    reference.omega_desired_rad_s omega_desired_rad_s
"""
FUTURE = """
    ahead.tau_preview_Nm          tau_preview_Nm
    ahead.theta_preview_rad       theta_preview_rad
    ahead.omega_preview_rad_s     omega_preview_rad_s
"""
OUTPUTS = """
    u_Nm                          limits.u_Nm
    tau_Nm                        sensor.tau_Nm
    tau_set_Nm                    reference.tau_set_Nm
    theta_rad                     joint.theta_rad
    theta_motor_rad               encoder_motor.theta_rad
    theta_load_rad                encoder_load.theta_rad
    omega_motor_rad_s             motor_rate.omega_rad_s
    omega_load_rad_s              load_rate.omega_rad_s
    tau_h_Nm                      human.tau_h_Nm
    d4_rad_s2                     drive.d4_rad_s2
    energy_J                      limits.energy_J
    fault                         limits.fault
    mode_held                     reference.mode
    apart_rad                     redundancy.apart_rad
    apart_Nm                      redundancy.apart_Nm
    room_Nm                       redundancy.room_Nm
    damping_Nms_rad               passivity.damping_Nms_rad
    given_J                       passivity.given_J
    held_J                        passivity.held_J
    adapted_gain                  adaptation.gain
    adapted_loss                  adaptation.loss
    adapted_offset_Nm             adaptation.offset_Nm
"""
OWN_OUTPUTS = {
    "elbow_drive": """
    delta_set_rad                 smooth.delta_set_rad
    u_command_Nm                  smc.u_command_Nm
    surface_rad_s                 smc.s_rad_s
    u_eq_Nm                       smc.u_eq_Nm
    k_smc_Nm                      smc.k_smc_Nm
""",
    "elbow_mpc": """
    u_command_Nm                  predictive.u_Nm
    iterations                    predictive.iterations
""",
}
WIRES = {
    "elbow_drive": SENSING + LIMITS + OBSERVERS + PASSIVE + ADAPTED + COMPARED + SLIDING_MODE,
    "elbow_mpc": SENSING + LIMITS + OBSERVERS + PASSIVE + ADAPTED + COMPARED + PREDICTIVE,
}
FROM_OUTSIDE = {"elbow_drive": INPUTS, "elbow_mpc": INPUTS + FUTURE}
# What is measured comes before what is made of it, the limits before the observers of what they let
# through; the stamp ends the control task.
ORDER = {
    "elbow_drive": {
        "sense": "encoder_motor encoder_load joint velocity sensor motor_rate load_rate "
        "encoder_gear adaptation reference passivity lead inverse setpoint smooth limits drive "
        "gear human set_rate",
        "control": "set_trend smc redundancy stamp",
    },
    "elbow_mpc": {
        "sense": "encoder_motor encoder_load joint velocity sensor motor_rate load_rate "
        "encoder_gear adaptation reference passivity cable limits drive gear human drive_by_gear",
        "control": "ahead predictive redundancy stamp",
    },
}
# Period, first tick and release, in base ticks of 1 ms: 1 kHz and 200 Hz, and a command that takes
# effect one tick after the start of the run that made it; two for predictive control.
RELEASE = {"elbow_drive": 1, "elbow_mpc": 2}
DEVICES = ("elbow_drive", "elbow_mpc")


def table(text: str) -> dict[str, str]:
    rows = [line.split() for line in text.splitlines() if line.strip() and "#" not in line]
    found = {row[0]: row[1] for row in rows}
    assert len(found) == len(rows)
    return found


def name_of(signal) -> str:
    return f"{signal.instance}.{signal.port}"


@pytest.fixture(scope="module")
def systems():
    return {name: load_device(name).system for name in DEVICES}


@pytest.mark.parametrize("name", DEVICES)
def test_every_wire_is_the_one_that_was_meant(systems, name):
    wires = {name_of(a): name_of(b) for a, b in systems[name].wires.items()}
    assert wires == table(WIRES[name])


@pytest.mark.parametrize("controller", ["mpc-published", "mpc-published-no-preview"])
def test_the_published_controller_is_wired_as_published(controller):
    system = controller_device(controller).system
    expected = table(WIRES["elbow_mpc"]) | table(PUBLISHED)
    expected = {k: v for k, v in expected.items() if k not in NOT_PUBLISHED}
    if controller.endswith("no-preview"):  # what is wanted now holds
        now = ("tau_wanted_Nm", "theta_wanted_rad", "omega_wanted_rad_s")
        expected |= {f"ahead.{n}": f"reference.{n}" for n in now}
        # Adapted already, by the reference; a future from outside is not.
        expected = {k: v for k, v in expected.items() if not k.startswith("ahead.wish_")}
    assert {name_of(a): name_of(b) for a, b in system.wires.items()} == expected
    assert system.tasks[1].blocks == ("parabola", "ahead", "predictive", "redundancy", "stamp")
    times = [(t.every, t.phase, t.release_ticks) for t in system.tasks]
    assert times == [(1, 0, 1), (50, 0, 1)]


@pytest.mark.parametrize("name", DEVICES)
def test_every_input_and_output_is_the_one_that_was_meant(systems, name):
    system = systems[name]
    fed = {name_of(s): x.name for x in system.inputs for s in x.signals}
    assert fed == table(FROM_OUTSIDE[name])
    told = {x.name: name_of(s) for x in system.outputs for s in x.signals}
    blocks = " ".join(ORDER[name].values()).split()
    words = {f"{block}_status": f"{block}.status" for block in blocks}
    assert told == table(OUTPUTS) | table(OWN_OUTPUTS[name]) | words


@pytest.mark.parametrize("name", DEVICES)
def test_every_port_is_fed_once_by_the_table(systems, name):
    # The table is whole: wires and inputs together are all the ports there are.
    ports = {f"{i}.{p.name}" for i, b in systems[name].blocks.items() for p in b.inputs}
    assert sorted([*table(WIRES[name]), *table(FROM_OUTSIDE[name])]) == sorted(ports)


@pytest.mark.parametrize("name", DEVICES)
def test_order_period_and_release_of_every_task(systems, name):
    system = systems[name]
    assert system.base_period_s == 1e-3
    assert {t.name: " ".join(t.blocks) for t in system.tasks} == ORDER[name]
    assert {t.name: (t.every, t.phase, t.release_ticks) for t in system.tasks} == {
        "sense": (1, 0, 1),
        "control": (5, 0, RELEASE[name]),
    }
    slow = set(ORDER[name]["control"].split())
    for instance, block in system.blocks.items():
        assert block.period_s == (5e-3 if instance in slow else 1e-3), instance


# -- time ------------------------------------------------------------------------------------------


def run_commands(system, change_at: int | None, ticks: int) -> np.ndarray:
    """The motor's command at every tick, armed and on; one count off at a tick."""
    simulator = system.simulator()
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
    ends = [ticks * 1e-3 + 0.02 * (i + 1) for i in range(10)]
    assert device_horizon(device).ends_s == pytest.approx(ends, abs=1e-12)


@pytest.mark.parametrize(
    ("controller", "first_s", "last_s"),
    [
        ("mpc", 0.023, 0.203),
        ("mpc-no-preview", 0.023, 0.203),
        ("mpc-published", 0.052, 0.502),
        ("mpc-published-no-preview", 0.052, 0.502),
    ],
)
def test_the_horizon_of_every_shipped_controller(controller, first_s, last_s):
    ends = device_horizon(controller_device(controller)).ends_s
    assert len(ends) == 10
    assert (ends[0], ends[-1]) == (pytest.approx(first_s), pytest.approx(last_s))


def test_a_known_future_is_that_of_the_intervals_ends():
    # A run at tick 5 holds the measurement of tick 4 and acts from tick 7: its intervals end at
    # ticks 27, 47 ... 207.  Later than the path is long, the last value holds.
    n = 300
    t = np.arange(n, dtype=float)
    path = Trajectory("count", t, 2 * t, 3 * t, 4 * t, 1000, n, True)
    found = previews(path, device_horizon(load_device("elbow_mpc")))
    ends = np.array([27, 47, 67, 87, 107, 127, 147, 167, 187, 207])
    for tick in (5, 10, 60, 90):
        at = ends + tick - 5
        assert found["tau_preview_Nm"][tick].tolist() == (4 * at).tolist()
        assert found["theta_preview_rad"][tick].tolist() == at.tolist()
        assert found["omega_preview_rad_s"][tick].tolist() == (2 * at).tolist()
    late = found["theta_preview_rad"][150].tolist()
    assert late == [172, 192, 212, 232, 252, 272, 292, 299, 299, 299]
