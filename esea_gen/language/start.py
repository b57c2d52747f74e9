"""How a Block and a Program start: the checks of their ports, ``prepare`` and ``init``."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.language.names import check_name
from esea_gen.language.ports import Port, Tunable, symbols_of

PrepareFn = Callable[[SimpleNamespace], Mapping[str, Any]]


def check_ports(name: str, period_s: float, *groups: tuple[Port | Tunable, ...]) -> None:
    """Reject a name that C has taken, a non-positive period, and duplicate port names."""
    check_name("block", name)
    if not (math.isfinite(period_s) and period_s > 0):
        raise ValueError(f"block {name}: period_s must be positive, got {period_s}")
    for group in groups:
        names = [p.name for p in group]
        if len(names) != len(set(names)):
            raise ValueError(f"block {name}: a port name occurs twice in {names}")


def collect(
    block: str, kind: str, ports: tuple[Port, ...], values: Mapping[str, Any]
) -> list[ca.SX]:
    """The expressions of ports, in their order; refused when one is missing or of another size."""
    missing = sorted({p.name for p in ports} - set(values))
    extra = sorted(set(values) - {p.name for p in ports})
    if missing or extra:
        raise ValueError(f"block {block}: {kind}s missing {missing}, unknown {extra}")
    out = []
    for p in ports:
        v = values[p.name]
        v = ca.vertcat(*v) if isinstance(v, (list, tuple)) else ca.SX(v)
        if v.shape != (p.size, 1):
            raise ValueError(f"block {block}: {kind} {p.name} has shape {v.shape}, not {p.size}")
        out.append(ca.densify(v))
    return out


def start_functions(
    name: str,
    tunables: tuple[Tunable, ...],
    coefficients: tuple[Port, ...],
    state: tuple[Port, ...],
    prepare: PrepareFn | None,
) -> tuple[ca.Function, ca.Function]:
    if bool(tunables) != bool(coefficients) or bool(tunables) != (prepare is not None):
        raise ValueError(f"block {name}: tunables, coefficients and prepare go together")
    tun, coef = symbols_of(tunables), symbols_of(coefficients)
    values = dict(prepare(SimpleNamespace(**tun))) if prepare else {}
    return (
        ca.Function(
            f"{name}_prepare",
            list(tun.values()),
            collect(name, "coefficient", coefficients, values),
            [t.name for t in tunables],
            # A tunable that passes through as a coefficient keeps its name; CasADi wants two.
            [f"c_{c.name}" for c in coefficients],
        ),
        ca.Function(
            f"{name}_init",
            list(coef.values()),
            [ca.DM.ones(p.size) * p.init for p in state],
            list(coef),
            [f"{p.name}_0" for p in state],
        ),
    )
