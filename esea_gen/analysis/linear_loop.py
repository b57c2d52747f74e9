"""A linear plant, a sampled controller and a hand, closed: exact between the samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from esea_gen.analysis.passivity import Hand
from esea_gen.analysis.response import Array, checked_period
from esea_gen.errors import UserError

# Rounding of a positive real part that is exactly 0, relative to the largest admittance.
ROUNDING = 1e-9
# An eigenvalue this near to 1 is a constant: a position without stiffness, an observer's bias.
AT_ONE = 1e-7
FREQUENCIES = 400


def _matrix(name: str, value: npt.ArrayLike, rows: int, columns: int) -> Array:
    array = np.atleast_2d(np.asarray(value, dtype=np.float64))
    if array.shape != (rows, columns) or not np.all(np.isfinite(array)):
        raise UserError(
            f"{name}: shape {array.shape}, needs finite values of shape ({rows}, {columns}).",
            "Check the order of the matrices.",
        )
    return array


@dataclass(frozen=True)
class LinearPlant:
    """A linear plant between a sampled controller and a driving point, in continuous time.

    a: states, shape (n, n).
    b_u: controller's inputs, held over a period, shape (n, m).
    b_tau: torque of the hand on the driving point, shape (n,).
    c_y: measurements, sampled once a period, shape (q, n).
    c_theta, c_omega: angle and rate of the driving point, shape (n,).
    """

    a: Array
    b_u: Array
    b_tau: Array
    c_y: Array
    c_theta: Array
    c_omega: Array

    def __post_init__(self) -> None:
        n = len(np.atleast_2d(self.a))
        _matrix("a", self.a, n, n)
        _matrix("b_u", self.b_u, n, np.shape(self.b_u)[-1])
        _matrix("c_y", self.c_y, np.shape(self.c_y)[0], n)
        for name in ("b_tau", "c_theta", "c_omega"):
            _matrix(name, getattr(self, name), 1, n)
        scale = np.max(np.abs(self.a)) + 1
        slip = np.max(np.abs(self.c_theta @ self.a - self.c_omega)) / scale
        if slip > 1e-9 or np.max(np.abs(self.c_theta @ self.b_u)) > 0:
            raise UserError("c_omega is not the rate of c_theta.", "c_theta @ a must be c_omega.")
        if not (self.c_theta @ self.b_tau == 0 and self.c_omega @ self.b_tau > 0):
            raise UserError(
                "The driving point has no inertia: its torque does not accelerate it.",
                "Keep a load inertia between hand and elastomer.",
            )

    def holding(self, hand: Hand) -> LinearPlant:
        """The plant with a hand on its driving point."""
        freed = 1 + hand.inertia_kgm2 * float(self.c_omega @ self.b_tau)
        row = -(
            hand.inertia_kgm2 * self.c_omega @ self.a
            + hand.damping_Nms_rad * self.c_omega
            + hand.stiffness_Nm_rad * self.c_theta
        )
        pushed = -hand.inertia_kgm2 * self.c_omega @ self.b_u
        return LinearPlant(
            self.a + np.outer(self.b_tau, row) / freed,
            self.b_u + np.outer(self.b_tau, pushed) / freed,
            self.b_tau / freed,
            self.c_y,
            self.c_theta,
            self.c_omega,
        )


@dataclass(frozen=True)
class Controller:
    """A linear controller in discrete time, observers and computing delay included.

    a, b, c, d: x(k+1) = a x(k) + b y(k), u(k) = c x(k) + d y(k); shapes (s, s), (s, q), (m, s), (m,
        q).
    """

    a: Array
    b: Array
    c: Array
    d: Array
    period_s: float

    def __post_init__(self) -> None:
        checked_period(self.period_s)
        m, q = np.shape(self.d)
        s = np.shape(self.a)[0]
        for name, rows, columns in (("a", s, s), ("b", s, q), ("c", m, s), ("d", m, q)):
            value = np.asarray(getattr(self, name), dtype=np.float64)
            if value.shape != (rows, columns) or not np.all(np.isfinite(value)):
                raise UserError(
                    f"Controller.{name}: shape {value.shape}, needs finite ({rows}, {columns}).",
                    "Check the order of the matrices; a controller without state has (0, 0).",
                )


def linearise(
    step: Callable[[Array, Array], tuple[Array, Array]],
    state: Array,
    inputs: Array,
    period_s: float,
    *,
    move: Array | float = 1e-6,
) -> Controller:
    """Linear controller from a step function, by central differences.

    step: ``step(state, inputs) -> (state', outputs)``, arrays of shapes (s,), (q,), (m,).
    state, inputs: point to linearise at: a fixed point, or the result is no linear system.
    move: size of the differences; an array gives one for each of (state, inputs).
    """
    x, y = np.asarray(state, dtype=np.float64), np.asarray(inputs, dtype=np.float64)
    at = np.concatenate([x, y])
    moves = np.broadcast_to(np.asarray(move, dtype=np.float64), at.shape)

    def both(point: Array) -> Array:
        after, out = step(point[: len(x)], point[len(x) :])
        return np.concatenate([np.ravel(after), np.ravel(out)]).astype(np.float64)

    base = both(at)
    drift = np.abs(base[: len(x)] - x)
    if len(x) and np.any(drift > 1e-9 * (1 + np.abs(x))):
        k = int(np.argmax(drift))
        raise UserError(
            f"state[{k}] moves from {x[k]:g} to {base[k]:g} in one step.",
            "Step until it rests, and linearise there.",
        )
    columns = []
    for k, size in enumerate(moves):
        shift = np.zeros(len(at))
        shift[k] = size
        up, down = (both(at + shift) - base) / size, (base - both(at - shift)) / size
        if np.any(np.abs(up - down) > 1e-3 * (np.abs(up) + np.abs(down)) + 1e-6):
            raise UserError(
                f"The step has a kink within {size:g} of {'state' if k < len(x) else 'input'} "
                f"{k if k < len(x) else k - len(x)}.",
                "Linearise elsewhere or move less.",
            )
        columns.append(0.5 * (up + down))
    j = np.stack(columns, axis=1)
    s = len(x)
    return Controller(j[:s, :s], j[:s, s:], j[s:, :s], j[s:, s:], period_s)


@dataclass(frozen=True)
class Loop:
    """Closed loop over one period: torque and mean rate of the driving point in equal parts.

    a, b, c, d: x(k+1) = a x(k) + b w(k), v(k) = c x(k) + d w(k): w the hand's torque, held in each
        of the parts, shape (parts,); v the driving point's mean rate in each, shape (parts,).
    """

    a: Array
    b: Array
    c: Array
    d: Array
    period_s: float

    @property
    def radius(self) -> float:
        """Largest eigenvalue's magnitude, constants (eigenvalues at 1 with a full space) apart."""
        found = np.linalg.eigvals(self.a)
        constant = np.abs(found - 1) < AT_ONE
        if np.any(constant):
            values = np.linalg.svd(self.a - np.eye(len(self.a)), compute_uv=False)
            space = int(np.count_nonzero(values < AT_ONE * max(1.0, float(values[0]))))
            if space < np.count_nonzero(constant):
                return max(1.0, float(np.max(np.abs(found)))) * (1 + AT_ONE)  # a drift
            found = found[~constant]
        return float(np.max(np.abs(found), initial=0.0))

    @property
    def stable(self) -> bool:
        """Whether every motion dies or stays constant."""
        return self.radius < 1

    def admittance(self, frequency_Hz: npt.ArrayLike) -> npt.NDArray[np.complex128]:
        """Mean rates over torques of the driving point.

        frequency_Hz: up to half the controller's rate (the parts hold what is above), shape (f,).
        """
        f = np.atleast_1d(np.asarray(frequency_Hz, dtype=np.float64))
        z = np.exp(2j * np.pi * f * self.period_s)
        shifted = z[:, None, None] * np.eye(len(self.a)) - self.a
        inner = np.linalg.solve(shifted, self.b.astype(np.complex128)[None])
        return np.asarray(self.d + self.c @ inner)

    def resistance(self, frequency_Hz: npt.ArrayLike) -> Array:
        """Least real part of the admittance: whether the driving point takes power or gives it.

        frequency_Hz: where, shape (f,).
        return: least eigenvalue of the admittance's Hermitian part over its Frobenius norm, shape
            (f,): between -1 and 1, below 0 where some torque draws power.
        """
        y = self.admittance(frequency_Hz)
        least = np.linalg.eigvalsh(0.5 * (y + np.conj(np.swapaxes(y, 1, 2))))[:, 0]
        return np.asarray(least / np.maximum(np.linalg.norm(y, axis=(1, 2)), 1e-300))

    def passivity(self) -> tuple[bool, float, float]:
        """Positive-realness of the driving-point admittance.

        return: whether it is passive (stable by itself, and no frequency at which the point gives
            out power), the least `resistance`, and its frequency in Hz.
        """
        half = 0.5 / self.period_s
        grid = np.unique(
            np.concatenate(
                [
                    np.geomspace(1e-4 * half, 0.1 * half, FREQUENCIES // 2),
                    np.linspace(0.1 * half, half, FREQUENCIES // 2),
                ]
            )
        )
        for _ in range(3):  # a finer grid round the least value, twice
            values = self.resistance(grid)
            k = int(np.argmin(values))
            least, at = float(values[k]), float(grid[k])
            grid = np.linspace(grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)], 21)
        return self.stable and least >= -ROUNDING, least, at


def close_loop(plant: LinearPlant, controller: Controller, *, parts: int = 8) -> Loop:
    """Sampled controller on a continuous plant, exact between the samples.

    parts: into how many equal parts of a period the driving point's torque is divided.

    In a part of length h the hand's torque w is held, so the work it does is exactly
    w (theta(end) - theta(start)) = h w v.  Positive-realness of the lifted w -> v therefore says
    exactly that no hand torque of that form draws energy; with more parts every torque is
    approached, motion between the samples and above half the rate included.  The damping that a
    virtual spring and damper needs comes out too low by 0.58 / parts of it (of `required_damping`):
    7 % at 8 parts, 2 % at 32, nothing for a spring alone.
    """
    from scipy.linalg import expm

    n, m = len(plant.a), np.shape(plant.b_u)[1]
    q = np.shape(plant.c_y)[0]
    if np.shape(controller.d) != (m, q) or parts < 1:
        raise UserError(
            f"Controller of shape {np.shape(controller.d)} on a plant with {m} inputs and {q} "
            f"measurements, {parts} parts.",
            "Use the same inputs and measurements, and at least one part.",
        )
    h = controller.period_s / parts
    joint = np.zeros((n + m + 1, n + m + 1))
    joint[:n, :n], joint[:n, n : n + m], joint[:n, -1] = plant.a, plant.b_u, plant.b_tau
    moved = expm(joint * h)
    f, g_u, g_tau = moved[:n, :n], moved[:n, n : n + m], moved[:n, -1]
    s = len(controller.a)
    width = n + s + parts
    # Every quantity as a row over (plant state, controller state, torques of the parts).
    x = np.eye(n, width)
    u = np.concatenate([controller.d @ plant.c_y, controller.c, np.zeros((m, parts))], axis=1)
    memory = np.concatenate([controller.b @ plant.c_y, controller.a, np.zeros((s, parts))], axis=1)
    rates = np.zeros((parts, width))
    for k in range(parts):
        torque = np.zeros(width)
        torque[n + s + k] = 1.0
        after = f @ x + g_u @ u + np.outer(g_tau, torque)
        rates[k] = plant.c_theta @ (after - x) / h
        x = after
    whole = np.concatenate([x, memory], axis=0)
    cut = n + s
    return Loop(whole[:, :cut], whole[:, cut:], rates[:, :cut], rates[:, cut:], controller.period_s)
