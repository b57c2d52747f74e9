"""What pages show as a Block's equations is what the Block computes."""

from __future__ import annotations

import casadi as ca
import pytest
import sympy as sp

from esea_gen.language.block import Block
from esea_gen.language.ports import Equation
from esea_gen.model.symbolic import to_casadi
from tests.shown_equations import value

H = 1e-3
# Of docs/limits.md and the device file, typed again.
N, J, FV, FC, WIDTH, JH = 74.0, 0.663, 0.5551, 0.4688, 0.05, 0.22


def shown(block: Block) -> dict[str, Equation]:
    return {e.number: e for e in block.equations}


def test_a_formula_is_read_as_it_is_printed(elbow):
    # The reader itself, on the cubic spring: 10 * 0.2 + 100 * 0.008.
    (spring,) = [e for e in elbow.sensor.equations if e.number == "(3.2)"]
    assert value(spring, {"k_1": 10.0, "k_3": 100.0, "theta": 0.2}) == pytest.approx(2.8)


def test_names_that_python_has_not_do_not_order_products(monkeypatch):
    # SymPy numbers them by a counter of the process, and sorts by the number's digits: the C of
    # one device would differ by what else had been built before.
    symbols = sp.symbols("lambda e' theta_d'' J w_c", real=True)
    values = {s: ca.SX.sym(f"x{k}") for k, s in enumerate(symbols)}
    rate, error, wanted, inertia, width = symbols
    expression = sp.expand((wanted + 2 * rate * error + rate**2 * error) * inertia / width)
    found = []
    for count in (5, 7, 8, 40, 97, 98, 998):
        monkeypatch.setattr(sp.Dummy, "_count", count)
        found.append(to_casadi(expression, values))
    assert len({str(x) for x in found}) == 1
    f = ca.Function("f", list(values.values()), [found[0]])
    assert float(f(2, 3, 5, 7, 11)) == pytest.approx((5 + 2 * 2 * 3 + 4 * 3) * 7 / 11)
