"""From one control law to another at run time, without a bump of the command."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from functools import cache
from typing import Any

import casadi as ca

from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Flag, Port, Tunable, clip, status_port
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of

FADE_S = 0.1  # three times the motor's lag: the torque follows, the person feels no edge


@cache
def _places(laws: tuple[str, ...]) -> type[IntEnum]:
    numbers = {name.upper(): k for k, name in enumerate(laws)}
    law = IntEnum("Law", numbers)  # type: ignore[misc]
    law.__doc__ = "Control law that commands the motor."
    return law


def law_switch(device: DeviceData, laws: Sequence[str], checked: Sequence[str] = ()) -> Block:
    """The command of the law asked for, joined to the one before by an offset that fades."""
    drive = drive_of(device)
    period, reach = drive.control_period_s, drive.u_Nm
    places = _places(tuple(laws))
    clipped = "the joined command was clipped at the motor's limit"

    def step(c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        held = u.law

        def of_held(values: Sequence[Any]) -> Any:
            chosen = values[0]
            for k, value in enumerate(values[1:], 1):
                chosen = ca.if_else(held == k, value, chosen)
            return chosen

        command = label("command_Nm", of_held([getattr(u, f"u_{n}_Nm") for n in laws]))
        ok = of_held([getattr(u, f"ok_{n}") if n in checked else ca.SX(1) for n in laws])
        changed = label("changed", ca.logic_not(held == s.law_held))
        offset = label(
            "offset_Nm",
            ca.if_else(changed, s.u_last_Nm - command, c.keep * s.offset_Nm),
            "[law] joined at a change, fading after it",
        )
        wanted = command + offset
        joined = label("u_joined_Nm", clip(wanted, -reach, reach), "[law]")
        return (
            {"law_held": held, "offset_Nm": clip(offset, -2 * reach, 2 * reach)}
            | {"u_last_Nm": joined},
            {
                "u_command_Nm": joined,
                "request_ok": ca.logic_and(guard.inputs_ok, ok == 1),
                "law_held": held,
                "status": guard.status(ca.fabs(wanted) > reach),
            },
        )

    return Block.define(
        "law",
        "Switch between control laws, without a bump",
        period_s=period,
        tunables=(
            Tunable("fade_s", FADE_S, 0.01, 2.0, "how long a change of the law is smoothed"),
        ),
        coefficients=(Port("keep", 0.0, 1.0, "share of the offset kept in a period"),),
        prepare=lambda c: {"keep": ca.exp(-period / c.fade_s)},
        state=(
            Port.choice("law_held", places, "active law"),
            Port("offset_Nm", -2 * reach, 2 * reach, "offset to the last law's command"),
            Port("u_last_Nm", -reach, reach, "last command"),
        ),
        inputs=(
            Port.choice("law", places, "desired law", on_invalid="law_held"),
            *(Port(f"u_{n}_Nm", -reach, reach, f"command of {n}") for n in laws),
            *(Port.flag(f"ok_{n}", f"1 while what {n} is asked for is sound") for n in checked),
        ),
        outputs=(
            Port("u_command_Nm", -reach, reach, "command of the active law, with the offset"),
            Port.flag("request_ok", "1 while the request to the active law is valid"),
            Port.choice("law_held", places, "active law"),
            status_port(
                "status of the choice",
                "a command was invalid, 0 is used; or the law is unknown, the last one stays",
                "the state was corrupt; the first law is active",
                Flag("CLIPPED", clipped, True, ("u_command_Nm",), reach),
            ),
        ),
        equations=equations(EQUATIONS),
        step=step,
    )


EQUATIONS = """
    [law] | u_k | v_k + o_k | the law in force, joined
    [law 1] | o_k | u{k-1} - v_k | at a change
    [law 2] | o_k | o{k-1} * exp(-T / tau) | after it
"""
