"""Box-constrained quadratic programs: against first-order conditions and two other solvers."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.control.predictive.box_qp import iteration_cap
from esea_gen.errors import UserError
from esea_gen.hostlib.library import CRunner, HostLibrary
from tests.box_qp_program import FLAGS, box_qp
from tests.rendered_program import render_program

BIT = {f.name: 1 << i for i, f in enumerate(FLAGS)}


def compiled(n: int, real: str, **more) -> CRunner:
    renderer = render_program(box_qp(n, **more), real)
    return HostLibrary(renderer.system, renderer).block("box_qp")


@pytest.fixture(scope="module")
def ten():
    return {real: compiled(10, real) for real in ("f64", "f32")}


KINDS = ("random", "condensed", "spread", "exponential")


def problem(kind: str, n: int, rng) -> tuple[np.ndarray, np.ndarray]:
    """Hessian and gradient.

    random: dense, eigenvalues over some decades; condensed: as predictive control of a vibrating
    plant gives them; spread: eigenvalues over six decades; exponential: triangular products on
    which pivoting methods take long (after Murty and Fathi).
    """
    if kind == "random":
        a = rng.normal(size=(n, n))
        h = a @ a.T + 10 ** rng.uniform(-4, 1) * np.eye(n)
        return h, h @ rng.normal(size=n) * 10 ** rng.uniform(0, 1)
    if kind == "condensed":
        t = np.arange(n)
        s = np.cumsum(np.exp(-t / rng.uniform(0.5, 20)) * np.cos(t * rng.uniform(0, 1)))
        j = np.array([[s[i - k] if i >= k else 0 for k in range(n)] for i in range(n)])
        target = rng.normal(size=n) + np.linspace(1, rng.normal() * 3, n)
        return j.T @ j * 10 ** rng.uniform(0, 3) + np.eye(n), j.T @ target * 10 ** rng.uniform(0, 3)
    if kind == "spread":
        u, _ = np.linalg.qr(rng.normal(size=(n, n)))
        h = u @ np.diag(10 ** rng.uniform(-3, 3, n)) @ u.T
        return (h + h.T) / 2, h @ rng.normal(size=n) * 10 ** rng.uniform(0, 1.5)
    low = np.eye(n) + 2 * np.tril(np.ones((n, n)), -1)
    f = [sum(2.0**k for k in range(n - i, n + 1)) for i in range(n)]
    keep = rng.random(n) < 0.8
    return low @ low.T, -np.where(keep, f, rng.normal(size=n)) * 10 ** rng.uniform(-2, 0)


def stream(kind: str, n: int, count: int, rng) -> dict[str, np.ndarray]:
    pairs = [problem(kind, n, rng) for _ in range(count)]
    start = rng.normal(size=(count, n)) * (rng.random((count, 1)) < 0.5)
    return {
        "H": np.array([h[np.tril_indices(n)] for h, _ in pairs]),
        "f": np.array([f for _, f in pairs]),
        "low": -rng.uniform(0.05, 1, (count, n)),
        "high": rng.uniform(0.05, 1, (count, n)),
        "start": start,
    }


def full(packed: np.ndarray, n: int) -> np.ndarray:
    h = np.zeros((len(packed), n, n))
    i, j = np.tril_indices(n)
    h[:, i, j] = packed
    h[:, j, i] = packed
    return h


def newton_gap(s: dict, x: np.ndarray, n: int) -> np.ndarray:
    """Distance to the minimum, from strict convexity: first-order conditions on the active set of
    x, solved anew by a dense factorisation, shared with nothing in the solver."""
    h, gap = full(s["H"], n), np.zeros(len(x))
    for k in range(len(x)):
        at_low, at_high = x[k] <= s["low"][k], x[k] >= s["high"][k]
        free = ~(at_low | at_high)
        best = np.where(at_low, s["low"][k], s["high"][k])
        if free.any():
            rest = s["f"][k][free] + h[k][np.ix_(free, ~free)] @ best[~free]
            best[free] = np.linalg.solve(h[k][np.ix_(free, free)], -rest)
        g = h[k] @ best + s["f"][k]
        scale = np.abs(h[k]) @ np.abs(best) + np.abs(s["f"][k])
        assert np.all(g[at_low & ~at_high] >= -1e-9 * scale[at_low & ~at_high])
        assert np.all(g[at_high & ~at_low] <= 1e-9 * scale[at_high & ~at_low])
        assert np.all((best >= s["low"][k] - 1e-12) & (best <= s["high"][k] + 1e-12))
        gap[k] = np.max(np.abs(best - x[k]))
    return gap


@pytest.mark.parametrize("kind", KINDS)
def test_the_minimum_and_never_the_cap(ten, kind):
    s = stream(kind, 10, 1500, np.random.default_rng(KINDS.index(kind)))
    y, _ = ten["f64"].run(s, trace=False)
    assert np.all(y["status"] == 0)
    assert np.max(y["iterations"]) < iteration_cap(10)
    assert np.max(newton_gap(s, y["x"], 10)) < 1e-6
    assert np.mean(np.sum((y["x"] <= s["low"]) | (y["x"] >= s["high"]), axis=1)) > 4


def others(s: dict, n: int):
    """Minima by DAQP (dual active set) and qpOASES (parametric active set), in this order."""
    dense = {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity(0, n)}
    quiet = {"error_on_fail": False}
    solvers = [
        ca.conic("daqp", "daqp", dense, quiet),
        ca.conic("qpoases", "qpoases", dense, {"printLevel": "none", "nWSR": 1000} | quiet),
    ]
    h = full(s["H"], n)
    for k in range(len(h)):
        found = []
        for f in solvers:
            x = f(h=h[k], g=s["f"][k], lbx=s["low"][k], ubx=s["high"][k], x0=0)["x"]
            found.append(np.array(x)[:, 0])
        yield found


@pytest.mark.parametrize("kind", KINDS)
def test_two_other_solvers_agree_with_each_other_and_with_it(ten, kind):
    s = stream(kind, 10, 150, np.random.default_rng(9))
    y, _ = ten["f64"].run(s, trace=False)
    for k, (one, two) in enumerate(others(s, 10)):
        assert one == pytest.approx(two, abs=1e-6)
        assert y["x"][k] == pytest.approx(one, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_forty_thousand_problems(ten, kind):
    s = stream(kind, 10, 10_000, np.random.default_rng(100 + KINDS.index(kind)))
    y, _ = ten["f64"].run(s, trace=False)
    assert np.all(y["status"] == 0)
    assert np.max(y["iterations"]) < iteration_cap(10)
    assert np.max(newton_gap(s, y["x"], 10)) < 1e-6
    worst = np.zeros(3)
    for k, (one, two) in enumerate(others(s, 10)):
        gaps = [one - two, y["x"][k] - one, y["x"][k] - two]
        worst = np.maximum(worst, [np.max(np.abs(g)) for g in gaps])
    assert np.all(worst < 1e-6)


@pytest.mark.parametrize("kind", ["random", "condensed", "exponential"])
def test_single_precision(ten, kind):
    s = stream(kind, 10, 1500, np.random.default_rng(20))
    s = {k: v.astype(np.float32).astype(float) for k, v in s.items()}
    a, _ = ten["f64"].run(s, trace=False)
    b, _ = ten["f32"].run(s, trace=False)
    # Ill-conditioned ones may fail the check at the end, and then say so.
    assert np.all((b["status"] == 0) | (b["status"] == BIT["NOT_OPTIMAL"]))
    assert np.mean(b["status"] == 0) > 0.995
    conditions = np.linalg.cond(full(s["H"], 10))
    error = np.max(np.abs(a["x"] - b["x"]), axis=1)
    assert np.all(error < 1e-6 + 2e-7 * conditions)
    assert np.quantile(error, 0.5) < 1e-5


@pytest.mark.ci
@settings(max_examples=40)
@given(st.integers(1, 24), st.sampled_from(KINDS), st.integers(0, 10**6))
def test_the_executor_any_size_any_problem(n, kind, seed):
    rng = np.random.default_rng(seed)
    s = stream(kind, n, 1, rng)
    pinned = rng.integers(n)
    s["high"][0, pinned] = s["low"][0, pinned]  # a box without width in one direction
    out = box_qp(n).simulator().step(**{k: v[0] for k, v in s.items()})
    x = np.atleast_1d(out["x"])[None]
    assert out["status"] == 0
    assert np.max(newton_gap(s, x, n)) < 1e-6


@pytest.mark.ci
def test_at_the_cap_the_best_point_so_far_is_returned_and_told():
    n = 10
    s = stream("exponential", n, 200, np.random.default_rng(4))
    h = full(s["H"], n)

    def cost(x: np.ndarray) -> np.ndarray:
        return 0.5 * np.einsum("ki,kij,kj->k", x, h, x) + np.sum(s["f"] * x, axis=1)

    last = cost(np.clip(s["start"], s["low"], s["high"]))
    slack = 1e-9 * (1 + np.abs(last))
    for cap in (0, 2, 8, 30):
        y, _ = compiled(n, "f64", cap=cap).run(s, trace=False)
        told = (y["status"] & BIT["CAP_REACHED"]) != 0
        assert np.all(y["iterations"] <= cap + 1)
        assert np.all((y["x"] >= s["low"]) & (y["x"] <= s["high"]))
        now = cost(y["x"])
        assert np.all(now <= last + slack)
        assert np.all(told == ((y["status"] & BIT["NOT_OPTIMAL"]) != 0))
        if cap == 0:
            assert np.mean(told) > 0.9
        last = now
    assert not told.any()


@pytest.mark.parametrize("real", ["f64", "f32"])
def test_a_hessian_that_is_not_positive(ten, real):
    rng = np.random.default_rng(6)
    n = 10
    for eigenvalue in (-1.0, -1e-3, 0.0):
        u, _ = np.linalg.qr(rng.normal(size=(n, n)))
        d = rng.uniform(1, 2, n)
        d[rng.integers(n)] = eigenvalue
        h = u @ np.diag(d) @ u.T
        if eigenvalue == 0.0:
            h = np.zeros((n, n))
        s = stream("random", n, 1, rng)
        given = {k: v[0] for k, v in s.items()} | {"H": h[np.tril_indices(n)]}
        out = ten[real].step(**given)
        assert out["status"] & BIT["NOT_CONVEX"]
        assert out["status"] & BIT["NOT_OPTIMAL"]
        assert np.array_equal(out["x"], np.clip(0, given["low"], given["high"]))


@pytest.mark.parametrize("real", ["f64", "f32"])
def test_numbers_that_are_none(ten, real):
    rng = np.random.default_rng(7)
    for name in ("H", "f", "low", "high", "start"):
        for value in (np.nan, np.inf, -np.inf, 1e30):
            given = {k: v[0].copy() for k, v in stream("random", 10, 1, rng).items()}
            given[name][rng.integers(len(given[name]))] = value
            out = ten[real].step(**given)
            assert out["status"] == BIT["INPUT_INVALID"]
            assert not np.any(out["x"])
    given = {k: v[0].copy() for k, v in stream("random", 10, 1, rng).items()}
    given["low"][3] = given["high"][3] + 0.1
    assert ten[real].step(**given)["status"] == BIT["INPUT_INVALID"]


@settings(max_examples=200)
@given(st.integers(0, 2**32 - 1))
def test_garbage_never_leaves_the_box(ten, seed):
    # Any float32 bit pattern.
    rng = np.random.default_rng(seed)
    s = {k: v[0] for k, v in stream("random", 10, 1, rng).items()}
    with np.errstate(invalid="ignore"):
        bad = rng.integers(0, 2**32, 55, dtype=np.uint32).view(np.float32).astype(float)
    s["H"] = np.where(rng.random(55) < 0.1, bad, s["H"])
    for real in ("f64", "f32"):
        out = ten[real].step(**s)
        assert np.all((out["x"] >= s["low"] - 1e-7) & (out["x"] <= s["high"] + 1e-7))
        if out["status"] & (BIT["INPUT_INVALID"] | BIT["NOT_CONVEX"]):
            assert np.max(np.abs(out["x"])) <= 1e-7


def test_sizes_and_caps_are_refused():
    for n in (0, 101):
        with pytest.raises(UserError, match=f"{n} variables"):
            box_qp(n)
    with pytest.raises(UserError, match="cap is -1"):
        box_qp(3, cap=-1)
