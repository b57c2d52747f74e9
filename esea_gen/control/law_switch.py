"""From one control law to another at run time, without a bump of the command."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from esea_gen.devices.file import DeviceData
from esea_gen.language.block import Block, Guard, Labels, StepResult
from esea_gen.language.ports import Flag, Port, Tunable, clip, status_port
from esea_gen.model.symbolic import equations
from esea_gen.observe import drive_of

FADE_S = 0.1  # three times the motor's lag: the torque follows, the person feels no edge
MOST_LAWS = 8


def law_switch(device: DeviceData, laws: Sequence[str], checked: Sequence[str] = ()) -> Block:
    """The command of the law asked for, joined to the one before by an offset that fades."""
    if not 2 <= len(laws) <= MOST_LAWS:
        raise ValueError(f"{len(laws)} laws to switch between; 2 to {MOST_LAWS} can be")
    drive = drive_of(device)
    period, reach, last = drive.control_period_s, drive.u_Nm, len(laws) - 1
    places = [f"{k} {n}" for k, n in enumerate(laws)]
    clipped = "the joined command was clipped at the motor's limit"

    def step(c: Any, s: Any, u: Any, guard: Guard, label: Labels) -> StepResult:
        known = [u.law == k for k in range(len(laws))]
        unknown = label("unknown", ca.logic_not(sum(known[1:], known[0])), "no law's place")
        held = label("law_in_force", ca.if_else(unknown, s.law_held, u.law))

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
                "status": guard.status(unknown, ca.fabs(wanted) > reach),
            },
        )

    return Block.define(
        "law",
        "Switch between control laws, without a bump",
        period_s=period,
        tunables=(
            Tunable("fade_s", FADE_S, 0.01, 2.0, "how long a change of the law is smoothed"),
        ),
        coefficients=(Port("keep", 0.0, 1.0, "share of the offset that a period leaves"),),
        prepare=lambda c: {"keep": ca.exp(-period / c.fade_s)},
        state=(
            Port("law_held", 0, last, "place of the law in force"),
            Port("offset_Nm", -2 * reach, 2 * reach, "what joins the new command to the old one"),
            Port("u_last_Nm", -reach, reach, "last command"),
        ),
        inputs=(
            Port("law", 0, last, f"wanted: {', '.join(places)}", on_invalid="law_held"),
            *(Port(f"u_{n}_Nm", -reach, reach, f"command of {n}") for n in laws),
            *(Port.flag(f"ok_{n}", f"1 while what {n} is asked for is sound") for n in checked),
        ),
        outputs=(
            Port("u_command_Nm", -reach, reach, "command of the law in force, joined"),
            Port.flag("request_ok", "1 while what the law in force is asked for is sound"),
            Port("law_held", 0, last, "place of the law in force"),
            status_port(
                "what is known of the choice",
                "a command was NaN or outside its range; 0 stands for it",
                "the state was corrupt: the first law is in force",
                Flag("LAW_UNKNOWN", "no law has that place; the one in force stays", True),
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
