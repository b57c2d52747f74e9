"""Products are ordered alike, independent of SymPy's earlier work."""

from __future__ import annotations

import casadi as ca
import pytest
import sympy as sp

from esea_gen.model.symbolic import to_casadi


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
