"""The virtual exoskeleton's numbers, typed a second time: tunables, ranges, draws, coefficients.

Defaults are those of the published trials and of the standard plants' description; ranges are as
wide as a plant can be meant, with the ends that its equations need (no width, time or inertia 0).
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from esea_gen.device import Device, load_device
from esea_gen.errors import UserError
from esea_gen.twin.encoders import encoder_block
from esea_gen.twin.parameters import (
    checked_file,
    passed_on,
    plant_coefficients,
    plant_tunables,
    prepare_plant,
)
from esea_gen.twin.passive import passive_block, passive_system
from esea_gen.twin.people import PEOPLE, STEP_S, person_tunables
from esea_gen.twin.plant import bodies_of, plant_block, plant_system, start_state, true_sensor
from esea_gen.twin.weighing import found_by, weighing_case

# Default, lowest and highest, in the order in which C has them.
DRIVE = {
    "J_kgm2": (0.663, 1e-4, 100),
    "fv_Nms_rad": (0.5551, 0, 100),
    "fc_Nm": (0.4688, 0, 100),
    "coulomb_width_rad_s": (0.02, 1e-3, 10),
    "tau_c_s": (0.03488, 1e-4, 1),
    "u_max_Nm": (0.221, 1e-3, 100),
}
CABLE = {
    "cable_stiffness_Nm_rad": (150, 0, 1e4),
    "cable_damping_Nms_rad": (1, 0, 100),
    "cable_backlash_rad": (0.01, 0, 1),
    "cable_loss": (0.1, 0, 0.9),
    "cable_loss_width_rad_s": (0.03, 1e-3, 10),
    "motor_side_inertia_kgm2": (0.003, 1e-4, 10),
    "motor_side_damping_Nms_rad": (0.02, 0, 10),
}
# The middles of the bands 8 to 12, 17 to 21, 26 to 30 and three times 30 to 70.
WAVES = {f"wave_{i}_1_rad": (k, 0, 1000) for i, k in enumerate((10, 19, 28, 50, 50, 50), 1)}
PHASES = {f"phase_{i}_rad": (0, -7, 7) for i in range(1, 7)}
ENDS = {
    "gear_disturbance_rms_rad_s2": (0, 0, 100),
    "elastomer_scale": (1, 0.1, 10),
    "hysteresis_scale": (1, 0, 10),
    "relaxation_Nm_rad": (0, 0, 1000),
    "relaxation_s": (5, 1e-2, 1e4),
    "coupling_stop_rad": (0.34, 0.01, 1.4),
    "coupling_stop_Nm_rad": (20000, 0, 1e5),
    "coupling_stop_Nms_rad": (5, 0, 100),
    "joint_min_rad": (-0.6, -10, 10),
    "joint_max_rad": (3, -10, 10),
    "joint_stop_Nm_rad": (5000, 0, 1e5),
    "joint_stop_Nms_rad": (20, 0, 1000),
    "trip_speed_rad_s": (12, 0, 400),
    "trip_torque_Nm": (0.15, 0, 100),
    "trip_window_s": (1, 1e-2, 100),
}
PERSON = {
    "Jh_kgm2": (0.22, 1e-3, 100),
    "spring_Nm_rad": (15, 0, 1e4),
    "damping_Nms_rad": (1.5, 0, 1e3),
    "feedforward": (1, 0, 1),
    "own_damping_Nms_rad": (0.1, 0, 100),
    "gravity_Nm": (0, 0, 100),
    "torque_noise_Nm": (0, 0, 100),
    "torque_noise_Hz": (2, 0.01, 100),
    "clamped": (0, 0, 1),
}
MEASURED = {"J_kgm2", "fv_Nms_rad", "fc_Nm", "tau_c_s", "u_max_Nm"}
JOINT = {"joint_min_rad", "joint_max_rad"}
TURN = 2 * math.pi


@pytest.fixture(scope="module")
def device() -> Device:
    return load_device("elbow_drive")


@pytest.fixture(scope="module")
def block(device):
    return plant_block(device)


def ranges(ports) -> dict[str, tuple[float, float, int]]:
    return {p.name: (p.low, p.high, p.size) for p in ports}


# -- tunables and coefficients --------------------------------------------------------------------


@pytest.mark.parametrize("cable", [True, False])
def test_tunables_of_the_plant(device, cable):
    tunables = plant_tunables(device, cable)
    expected = DRIVE | (CABLE if cable else {}) | WAVES | PHASES | ENDS | PERSON
    found = {t.name: (t.default, t.low, t.high) for t in tunables}
    assert list(found) == list(expected)
    for name, numbers in expected.items():
        assert found[name] == pytest.approx(numbers, rel=1e-7), name
    for t in tunables:
        given = t.name in MEASURED | JOINT
        assert (t.status == "assumed" and "plants.toml" in t.source) != given or t.name in JOINT
    low, high = device.file.joint.theta_min_rad, device.file.joint.theta_max_rad
    by_name = {t.name: t for t in tunables}
    for t, q in ((by_name["joint_min_rad"], low), (by_name["joint_max_rad"], high)):
        assert (t.source, t.status) == (q.source, q.status)


def test_a_person_is_tunables_and_nothing_of_the_controller():
    found = {t.name: t.default for t in person_tunables(PEOPLE["uncertain"])}
    assert found == {
        "Jh_kgm2": 0.15,
        "spring_Nm_rad": 12.0,
        "damping_Nms_rad": 1.0,
        "feedforward": 1.0,
        "own_damping_Nms_rad": 0.1,
        "gravity_Nm": 1.5,
        "torque_noise_Nm": 0.3,
        "torque_noise_Hz": 2.0,
        "clamped": 0.0,
    }


def test_coefficients_of_the_plant(device):
    tunables = plant_tunables(device, True)
    derived = {
        name: (-200, 200, 6) if name.endswith("_turns") else (0, 200, 1)
        for name in (
            "lag_decay",
            "heat_share",
            "d4_amplitude_rad_s2",
            "wave_turns",
            "phase_turns",
            "relaxation_decay",
            "relaxation_gain_Nms_rad",
            "noise_decay",
            "noise_gain_Nm",
            "free",
        )
    }
    gone = {"tau_c_s", "trip_window_s", "gear_disturbance_rms_rad_s2", "relaxation_Nm_rad"}
    gone |= {"relaxation_s", "torque_noise_Nm", "torque_noise_Hz", "clamped", *WAVES, *PHASES}
    direct = {t.name: (t.low, t.high, 1) for t in tunables if t.name not in gone}
    assert passed_on(tunables) == list(direct)
    assert ranges(plant_coefficients(tunables)) == direct | derived


def prepared(device, h=2e-4, tick=1e-3, **values):
    tunables = plant_tunables(device, True)
    numbers = SimpleNamespace(**({t.name: t.default for t in tunables} | values))
    out = prepare_plant(numbers, passed_on(tunables), h, tick)
    return {k: v if isinstance(v, list) else float(v) for k, v in out.items()}


def test_what_is_prepared_of_the_tunables(device):
    waves = {f"wave_{i}_1_rad": 10.0 * i for i in range(1, 7)}
    phases = {f"phase_{i}_rad": 0.3 * i for i in range(1, 7)}
    out = prepared(device, gear_disturbance_rms_rad_s2=0.6, fc_Nm=0.7, **waves, **phases)
    assert out["fc_Nm"] == 0.7
    assert out["lag_decay"] == pytest.approx(math.exp(-2e-4 / 0.03488), rel=1e-14)
    assert out["heat_share"] == pytest.approx(-math.expm1(-2e-4 / 1.0), rel=1e-10)
    assert out["wave_turns"] == pytest.approx([10.0 * i / TURN for i in range(1, 7)])
    assert out["phase_turns"] == pytest.approx([0.3 * i / TURN for i in range(1, 7)])
    # Six sines of one amplitude a have the mean square 6 a^2 / 2.
    assert math.sqrt(6 * out["d4_amplitude_rad_s2"] ** 2 / 2) == pytest.approx(0.6)
    assert out["free"] == 1
    assert prepared(device, clamped=1.0)["free"] == 0


@pytest.mark.parametrize(("stiff", "constant_s"), [(3.0, 5.0), (40.0, 0.02)])
def test_a_relaxing_branch_at_a_steady_rate(device, stiff, constant_s):
    out = prepared(device, relaxation_Nm_rad=stiff, relaxation_s=constant_s)
    torque = 0.0
    for _ in range(300):
        torque = out["relaxation_decay"] * torque + out["relaxation_gain_Nms_rad"] * 0.5
    exact = 0.5 * stiff * constant_s * -math.expm1(-300 * 2e-4 / constant_s)
    assert torque == pytest.approx(exact, rel=1e-10)


@pytest.mark.parametrize(("h", "tick", "hertz"), [(2e-4, 1e-3, 2.0), (1e-4, 5e-4, 30.0)])
def test_the_person_s_noise_at_the_ticks(device, h, tick, hertz):
    out = prepared(device, h, tick, torque_noise_Nm=0.3, torque_noise_Hz=hertz)
    decay, gain = out["noise_decay"], out["noise_gain_Nm"]
    assert decay == pytest.approx(math.exp(-TURN * hertz * h), rel=1e-12)
    # From tick to tick: a pole decay^5, a white number taken up five times.
    steps = round(tick / h)
    taken = gain * sum(decay**k for k in range(steps))
    assert taken / math.sqrt(1 - decay ** (2 * steps)) == pytest.approx(0.3, rel=1e-10)


def test_a_section_that_is_missing_is_named(device):
    assert checked_file(device) is device.file
    for key in ("actuator", "joint"):
        less = Device(device.file.model_copy(update={key: None}), "x.toml")
        with pytest.raises(UserError, match=rf"x.toml: section \[{key}\] is missing"):
            checked_file(less)


# -- Blocks ---------------------------------------------------------------------------------------


def test_ports_of_the_plant(device, block):
    rigid = plant_block(device, cable=False)
    for made, n in ((block, 3), (rigid, 2)):
        state = ranges(made.state)
        sensor = {p.name for p in true_sensor(device, STEP_S).state}
        assert {k: v for k, v in state.items() if k not in sensor} == {
            "u_a_Nm": (-100, 100, 1),
            "theta_rad": (-20, 20, n),
            "omega_rad_s": (-500, 500, n),
            "alpha_rad_s2": (-1e7, 1e7, n),
            "relaxation_Nm": (-1000, 1000, 1),
            "noise_Nm": (-1000, 1000, 1),
            "heat": (0, 1e4, 1),
            "tripped": (0, 2, 1),
            "sums_J": (-1e9, 1e9, 5),
        }
        assert sensor <= set(state)
        assert ranges(made.inputs) == {
            "u_Nm": (-100, 100, 1),
            "theta_p_rad": (-20, 20, 1),
            "omega_p_rad_s": (-500, 500, 1),
            "alpha_p_rad_s2": (-1e5, 1e5, 1),
            "noise": (-100, 100, 1),
        }
        angles = {f"theta_{k}_rad": (-20, 20, 1) for k in "gml"}
        speeds = {f"omega_{k}_rad_s": (-500, 500, 1) for k in "gml"}
        works = ("motor", "loss", "elastomer", "person", "disturbance")
        assert ranges(made.outputs) == angles | speeds | {
            "tau_e_Nm": (-1e5, 1e5, 1),
            "u_a_Nm": (-100, 100, 1),
            "tau_h_Nm": (-1e5, 1e5, 1),
            "d4_rad_s2": (-1e3, 1e3, 1),
            "stored_J": (0, 1e9, 1),
            **{f"work_{k}_J": (-1e9, 1e9, 1) for k in works},
            "tripped": (0, 2, 1),
            "plant_status": (0, 3, 1),
        }
        status = next(p for p in made.outputs if p.name == "plant_status")
        assert [(f.name, f.counted) for f in status.flags] == [
            ("INPUT_INVALID", True),
            ("STATE_REPAIRED", True),
        ]
        assert made.period_s == 2e-4
    assert (bodies_of(True), bodies_of(False)) == (("g", "m", "l"), ("m", "l"))


def test_the_rubber_of_the_plant_is_the_sensor_s_in_wider_ranges(device):
    wide = true_sensor(device, 1e-4)
    assert wide.period_s == pytest.approx(1e-4)
    assert [(p.low, p.high) for p in wide.inputs[:2]] == [
        pytest.approx((-1.5, 1.5), rel=1e-6),
        pytest.approx((-1000, 1000), rel=1e-6),
    ]
    (torque,) = (p for p in wide.outputs if p.name == "tau_Nm")
    assert (torque.low, torque.high) == pytest.approx((-1000, 1000), rel=1e-6)


def test_the_plant_s_tasks_and_wires(device):
    system = plant_system(device, True, 2.5e-4, 1e-3)
    assert [(t.name, t.every) for t in system.tasks] == [("move", 1), ("encode", 4)]
    assert system.base_period_s == 2.5e-4
    assert system.blocks["encoders"].period_s == 1e-3
    assert plant_system(device, True, 1e-3, 1e-3).tasks[1].every == 1
    for wrong in (3e-4, 2e-3, 1.01e-3):
        with pytest.raises(UserError, match="does not divide"):
            plant_system(device, True, wrong, 1e-3)


def test_ports_and_tunables_of_the_encoders(device):
    made = encoder_block(device)
    found = {t.name: (t.default, t.low, t.high) for t in made.tunables}
    errors = ("offset", "wave_1", "phase_1", "wave_2", "phase_2")
    assert found == {
        "joint_encoder_bits": (12, 4, 12),
        "motor_encoder_bits": (17, 4, 17),
        **{f"{side}_{e}_rad": (0, -7, 7) for side in ("motor", "load") for e in errors},
        "gear_offset_rad": (0, -500, 500),
    }
    assert ranges(made.outputs) == {
        "count_motor": (0, 4095, 1),
        "count_load": (0, 4095, 1),
        "count_gear": (0, 131071, 1),
    }
    assert ranges(made.inputs) == {f"theta_{k}_rad": (-20, 20, 1) for k in "mlg"}
    whole = {"joint_steps": (0, 4096, 1), "motor_steps": (0, 131072, 1)}
    direct = {k: (*v[1:], 1) for k, v in found.items() if not k.endswith("_bits")}
    assert ranges(made.coefficients) == direct | whole
    knee = encoder_block(load_device("knee"))
    assert knee.tunables[0].name == "joint_encoder_bits"
    assert not [t.name for t in knee.tunables if t.name.startswith(("motor_encoder", "gear"))]
    assert [p.name for p in knee.outputs] == ["count_motor", "count_load"]


def test_ports_and_tunables_of_the_passive_sensor():
    knee = load_device("knee")
    made = passive_block(knee)
    assert [t.name for t in made.tunables] == ["cuff_inertia_kgm2", "hand_damping_Nms_rad"]
    numbers = [(0.003, 1e-4, 1), (0.5, 0, 100)]
    for t, port, expected in zip(made.tunables, made.coefficients, numbers, strict=True):
        assert (t.default, t.low, t.high) == pytest.approx(expected, rel=1e-7)
        assert (port.name, port.low, port.high) == (t.name, t.low, t.high)
    cuff = {
        "theta_m_rad": (-20, 20, 1),
        "omega_m_rad_s": (-500, 500, 1),
        "alpha_m_rad_s2": (-1e7, 1e7, 1),
    }
    assert {k: v for k, v in ranges(made.state).items() if k in cuff} == cuff
    assert ranges(made.inputs) == {
        "tau_hand_Nm": (-1000, 1000, 1),
        "theta_l_rad": (-20, 20, 1),
        "omega_l_rad_s": (-500, 500, 1),
    }
    assert ranges(made.outputs) == {
        "tau_e_Nm": (-1e5, 1e5, 1),
        "theta_m_rad": (-20, 20, 1),
        "theta_l_rad": (-20, 20, 1),
        "plant_status": (0, 3, 1),
    }
    system = passive_system(knee, 1e-4, 2e-3)
    assert [(t.name, t.every) for t in system.tasks] == [("move", 1), ("encode", 20)]


def test_where_a_run_starts(device, block):
    spring = {c.name: c.value for c in block.constants}
    initial = {"theta_m_rad": 0.3, "theta_l_rad": 0.1, "omega_g_rad_s": 2.0, "omega_l_rad_s": -1.0}
    state, shown = start_state(block, 0.25, initial, 1.5)
    assert state == {"theta_rad": [0.25, 0.3, 0.1], "omega_rad_s": [2.0, 0.0, -1.0]}
    # (3.2): 9.39 Nm/rad and 239 Nm/rad3, over 0.2 rad.
    assert (spring["k1_Nm_rad"], spring["k3_Nm_rad3"]) == pytest.approx((9.39, 239))
    assert shown.pop("tau_e_Nm") == pytest.approx(1.5 * (9.39 * 0.2 + 239 * 0.2**3))
    assert shown == {
        "theta_g_rad": 0.25,
        "theta_m_rad": 0.3,
        "theta_l_rad": 0.1,
        "omega_g_rad_s": 2.0,
        "omega_m_rad_s": 0.0,
        "omega_l_rad_s": -1.0,
    }
    # A rigid cable: the gear is where the motor side is.
    state, shown = start_state(plant_block(device, False), 0.25, {"theta_m_rad": 0.3})
    assert state == {"theta_rad": [0.3, 0.25], "omega_rad_s": [0.0, 0.0]}
    assert (shown["theta_g_rad"], shown["omega_g_rad_s"]) == (0.3, 0.0)
    assert shown["tau_e_Nm"] == pytest.approx(9.39 * 0.05 + 239 * 0.05**3)
    for key, value in (("theta_m_rad", 20.0), ("omega_m_rad_s", -500.0)):
        start_state(block, 0.0, {key: value, "theta_l_rad": value if "theta" in key else 0.0})
        with pytest.raises(UserError, match=f"Initial {key}"):
            start_state(block, 0.0, {key: value * 1.01})


def test_the_mass_that_is_swung_to_adapt():
    case = weighing_case()
    path, t = case.trajectory, np.arange(40_000) / 1000
    for still in (path.theta_p_rad, path.omega_p_rad_s, path.alpha_p_rad_s2):
        assert still.tolist() == [0.0] * 40_000
    # 1.7 Nm at 0.3 Hz, faded in over 5 s; what is judged begins there.
    wanted = 1.7 * np.where(t < 5, t / 5, 1) * np.sin(0.6 * np.pi * t)
    assert path.tau_desired_Nm == pytest.approx(wanted, abs=1e-12)
    assert (path.start, path.end, path.clamped) == (5000, 40_000, False)
    assert case.mode == 1
    assert case.tunables == {
        "adaptation": {"mass_Nm": 3.5, "mass_kgm2": 0.2, "mass_angle_rad": 1.2}
    }
    assert case.plant == {
        "spring_Nm_rad": 0,
        "damping_Nms_rad": 0,
        "feedforward": 0,
        "torque_noise_Nm": 0,
        "gravity_Nm": 3.5,
        "Jh_kgm2": 0.2,
        "own_damping_Nms_rad": 0.02,
        "motor_offset_rad": 1.2,
        "load_offset_rad": 1.2,
        "joint_min_rad": -2,
        "joint_max_rad": 2,
    }


def test_what_was_adapted_is_what_the_run_ends_with_put_in_force():
    ends = {"adapted_gain": 0.9, "adapted_loss": 0.1, "adapted_offset_Nm": -0.05}
    told = {name: np.array([7.0, end]) for name, end in ends.items()}
    run = SimpleNamespace(controller={**told, "fault": np.array([0.0, 0.0])})
    assert found_by(run) == {"share": 1, "gain": 0.9, "loss": 0.1, "offset_Nm": -0.05}
    # Latched at the end; a latch that was there before and released is none.
    run.controller["fault"] = np.array([1.0, 0.0])
    assert found_by(run)["gain"] == 0.9
    run.controller["fault"] = np.array([0.0, 1.0])
    with pytest.raises(UserError, match=r"latched \(fault 1\) while the mass was swung"):
        found_by(run)
