"""Sliding mode control of the torque (spec section 5): inverse, set-point and law."""

from __future__ import annotations

from esea_gen.control.law import Base, Law, Parts
from esea_gen.control.setpoint import setpoint_rates
from esea_gen.control.sliding_mode.controller import sliding_mode
from esea_gen.control.sliding_mode.governor import governed_wires, smoothed_setpoint, torque_lead
from esea_gen.control.sliding_mode.linear_loop import sliding_mode_numbers
from esea_gen.control.trend import trend
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
    sense: dict[str, Component] = {
        "inverse": base.inverse(),
        "setpoint": setpoint_rates(device, "differences" if published else "observer"),
    }
    control: dict[str, Component] = {"smc": sliding_mode(device)}
    wires = {"inverse.tau_Nm": "reference.tau_set_Nm"}
    followed, smoothed = "setpoint", "inverse.theta_rad"
    if not published:
        # Where the set torque goes is seen in the control task: at 1 kHz a set-point that comes
        # 200 times a second would look like steps.
        sense = {"lead": torque_lead(device), **sense, "smooth": smoothed_setpoint(device)}
        control = {"set_trend": trend(device, name="set_trend"), **control}
        wires = governed_wires(device)
        followed, smoothed = "smooth", "smooth.theta_smooth_rad"
    if rate:
        wires["set_rate.theta_rad"] = smoothed
    return Parts(
        sense=sense,
        after_limits=rate,
        control=control,
        command="smc.u_command_Nm",
        replaced={"human": lag_observer(device)} if published else {},
        wires=wires,
        signals={
            "theta_set_rad": "inverse.theta_rad",
            "delta_set_rad": f"{followed}.delta_set_rad",
            "delta_rate_rad_s": "set_rate.omega_rad_s" if rate else f"{followed}.delta_rate_rad_s",
            "delta_acc_rad_s2": f"{followed}.delta_acc_rad_s2",
        },
        setpoints={"delta_set_rad": f"{followed}.delta_set_rad"},
        outputs={
            "surface_rad_s": "smc.s_rad_s",
            "u_eq_Nm": "smc.u_eq_Nm",
            "k_smc_Nm": "smc.k_smc_Nm",
        },
    )


LAW = Law("sliding_mode", "Sliding mode control of the torque", _parts, "sliding_mode")
