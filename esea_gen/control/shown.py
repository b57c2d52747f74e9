"""Blocks with additional outputs of internal values, for laws that need them."""

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


def _port(source: Sequence[Port], name: str, as_name: str = "") -> Port:
    p = next(p for p in source if p.name == name)
    return Port(as_name or name, p.low, p.high, p.meaning, p.size, p.equation)


def with_state_as_output(block: Block, name: str, meaning: str) -> Block:
    """A Block that also gives one of its new states as an output."""
    if name not in (p.name for p in block.state):
        raise ValueError(f"block {block.name}: no state {name}")
    return with_outputs(
        block, [(replace(_port(block.state, name), meaning=meaning), f"next_{name}")]
    )


def gains_reference(block: Block) -> Block:
    """The reference with the gains of its impedance law, for the Block that keeps it passive."""
    shown = {"Kp_Nm_rad": "stiffness_Nm_rad", "Kd_Nms_rad": "damping_Nms_rad"}
    more = [(_port(block.coefficients, n, as_name), f"c_{n}") for n, as_name in shown.items()]
    return with_outputs(block, more)


def shown_reference(block: Block) -> Block:
    """Reference with its change of mode and its tunables, for a horizon."""
    more = [(_port(block.state, "offset_Nm"), "next_offset_Nm")]
    tunable = ("keep", "tau_range_Nm", "Kp_Nm_rad", "Kd_Nms_rad")
    more += [(_port(block.coefficients, n), f"c_{n}") for n in tunable]
    adapted = "label_tau_adapted_Nm" in block.labelled_step.name_out()
    for n in ("tau_desired_Nm", "theta_desired_rad", "omega_desired_rad_s"):
        source = "tau_adapted_Nm" if adapted and n.startswith("tau") else f"{n}_used"
        port = _port(block.inputs, n, n.replace("desired", "wanted"))
        more.append((port, f"label_{source}"))
    return with_outputs(block, more)
