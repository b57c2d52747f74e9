"""Blocks that also give out what they read or make anyway, for a law that needs to know it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca

from esea_gen.language.block import Block
from esea_gen.language.ports import Port


def with_outputs(block: Block, more: Sequence[tuple[Port, str]]) -> Block:
    """A Block that also gives ``next_...``, ``c_...`` or ``label_...`` values of its step."""
    labelled = block.labelled_step
    arguments = labelled.sx_in()
    results = labelled.call(arguments)
    known = dict(zip(labelled.name_in(), arguments, strict=True))
    known |= dict(zip(labelled.name_out(), results, strict=True))
    taken = [p.name for p in block.outputs]
    for port, source in more:
        if source not in known or known[source].numel() != port.size or port.name in taken:
            raise ValueError(
                f"block {block.name}: no {source} of size {port.size}, or an output has the name "
                f"{port.name}"
            )
        taken.append(port.name)
    at = len(block.state) + len(block.outputs)
    values = results[:at] + [known[source] for _, source in more]
    names = labelled.name_out()[:at] + [f"y_{port.name}" for port, _ in more]

    def function(name: str, results: list[ca.SX], names: list[str]) -> ca.Function:
        return ca.Function(name, arguments, results, labelled.name_in(), names)

    return replace(
        block,
        outputs=(*block.outputs, *(port for port, _ in more)),
        step=function(block.step.name(), values, names),
        labelled_step=function(
            labelled.name(), values + results[at:], names + labelled.name_out()[at:]
        ),
    )


def with_state_as_output(block: Block, name: str, meaning: str) -> Block:
    """A Block that also gives one of its new states as an output."""
    port = next((p for p in block.state if p.name == name), None)
    if port is None:
        raise ValueError(f"block {block.name}: no state {name}")
    shown = Port(name, port.low, port.high, meaning, port.size, port.equation)
    return with_outputs(block, [(shown, f"next_{name}")])


def gains_reference(block: Block) -> Block:
    """The reference with the gains of its impedance law, for the Block that keeps it passive."""
    more = []
    for name, shown in (("Kp_Nm_rad", "stiffness_Nm_rad"), ("Kd_Nms_rad", "damping_Nms_rad")):
        p = next(p for p in block.coefficients if p.name == name)
        more.append((Port(shown, p.low, p.high, p.meaning, p.size, p.equation), f"c_{name}"))
    return with_outputs(block, more)


def shown_reference(block: Block) -> Block:
    """The reference with what it makes of a change of mode, and its tunables, for a horizon."""

    def port(source: Sequence[Port], name: str, as_name: str = "") -> Port:
        p = next(p for p in source if p.name == name)
        return Port(as_name or name, p.low, p.high, p.meaning, p.size, p.equation)

    more = [(port(block.state, "offset_Nm"), "next_offset_Nm")]
    more += [
        (port(block.coefficients, n), f"c_{n}")
        for n in ("keep", "tau_range_Nm", "Kp_Nm_rad", "Kd_Nms_rad")
    ]
    adapted = "label_tau_adapted_Nm" in block.labelled_step.name_out()
    more += [
        (
            port(block.inputs, n, n.replace("desired", "wanted")),
            "label_tau_adapted_Nm" if adapted and n.startswith("tau") else f"label_{n}_used",
        )
        for n in ("tau_desired_Nm", "theta_desired_rad", "omega_desired_rad_s")
    ]
    return with_outputs(block, more)
