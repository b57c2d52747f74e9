"""Sliding mode control of the torque (spec section 5): inverse, set-point and law."""

from __future__ import annotations

from esea_gen.control.law import Base, Law, Parts
from esea_gen.control.linear_loop import sliding_mode_numbers
from esea_gen.control.setpoint import setpoint_rates
from esea_gen.control.sliding_mode import sliding_mode
from esea_gen.language.component import Component
from esea_gen.observe.human import lag_observer
from esea_gen.observe.rates import butterworth_rate


def _parts(base: Base) -> Parts:
    device = base.device
    asked = sliding_mode_numbers(device)
    # As published: differences of the set-point, and the person's torque through a lag.
    published = asked.setpoint_acceleration == "zero"
    rate: dict[str, Component] = {}
    # A derivative is of a filtered signal, as published, where the device file names its cut-off.
    if asked.setpoint_filter_Hz is not None:
        rate["set_rate"] = butterworth_rate(device, "set_rate", asked.setpoint_filter_Hz)
    return Parts(
        sense={
            "inverse": base.inverse(),
            "setpoint": setpoint_rates(device, "differences" if published else "observer"),
        },
        after_limits=rate,
        control={"smc": sliding_mode(device)},
        command="smc.u_command_Nm",
        replaced={"human": lag_observer(device)} if published else {},
        wires={"inverse.tau_Nm": "reference.tau_set_Nm"}
        | ({"set_rate.theta_rad": "inverse.theta_rad"} if rate else {}),
        signals={
            "theta_set_rad": "inverse.theta_rad",
            "delta_set_rad": "setpoint.delta_set_rad",
            "delta_rate_rad_s": "set_rate.omega_rad_s" if rate else "setpoint.delta_rate_rad_s",
            "delta_acc_rad_s2": "setpoint.delta_acc_rad_s2",
        },
        setpoints={"delta_set_rad": "setpoint.delta_set_rad"},
        outputs={
            "surface_rad_s": "smc.s_rad_s",
            "u_eq_Nm": "smc.u_eq_Nm",
            "k_smc_Nm": "smc.k_smc_Nm",
        },
    )


LAW = Law("sliding_mode", "Sliding mode control of the torque", _parts, "sliding_mode")
