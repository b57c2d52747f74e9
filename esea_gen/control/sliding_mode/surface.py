"""Sliding surface and the control law that SymPy derives from it (5.12 to 5.22)."""

from __future__ import annotations

from functools import cache

import sympy as sp

from esea_gen.language.ports import Equation
from esea_gen.model.symbolic import equations
from esea_gen.observe.disturbance import ACCELERATION, FC, FV, TAU_E, U_A, J, N

LAMBDA = sp.Symbol("lambda", positive=True)
ERROR, ERROR_RATE, INTEGRAL, SET_ACC = sp.symbols("e e' I theta_d''", real=True)
SURFACE = ERROR_RATE + 2 * LAMBDA * ERROR + LAMBDA**2 * INTEGRAL
DELTA = sp.Symbol("delta", real=True)
J_UNC, FV_UNC, FC_UNC, TAU_UNC, J_MAX, ETA, K1_UNC, K3_UNC = (
    sp.Symbol(n, nonnegative=True)
    for n in ("J_unc", "f_v,unc", "f_c,unc", "tau_e,unc", "J_max", "eta", "k_1,unc", "k_3,unc")
)
TORQUE_UNCERTAINTY = K1_UNC * sp.Abs(DELTA) + K3_UNC * sp.Abs(DELTA) ** 3
# theta_d'' + 2 lambda e' + lambda^2 e: the acceleration that keeps the surface.
WANTED = sp.Symbol("a_w", real=True)
WANTED_ACCELERATION = SET_ACC + 2 * LAMBDA * ERROR_RATE + LAMBDA**2 * ERROR
SET_BY_WANTED = WANTED - 2 * LAMBDA * ERROR_RATE - LAMBDA**2 * ERROR


@cache
def equivalent_control() -> sp.Expr:
    """Motor torque that keeps the surface (5.16, 5.17): s' = 0 with (5.2), for u_a."""
    t = sp.Symbol("t")
    theta_d, theta_m, integral = (sp.Function(n)(t) for n in ("theta_d", "theta_m", "I"))
    e = theta_d - theta_m
    surface = SURFACE.subs(
        {ERROR_RATE: sp.diff(e, t), ERROR: e, INTEGRAL: integral}, simultaneous=True
    )
    slope = sp.diff(surface, t).subs(sp.diff(integral, t), e)
    slope = slope.subs(sp.diff(theta_m, t, 2), ACCELERATION)
    slope = slope.subs(sp.diff(theta_d, t, 2), SET_ACC)
    slope = slope.subs(sp.diff(theta_d, t), ERROR_RATE + sp.diff(theta_m, t))
    slope = sp.expand(slope.subs(theta_d, ERROR + theta_m))
    ((solution,),) = sp.linsolve([slope], U_A)
    return sp.expand(solution)


# With the equivalent control of the model in the plant with true numbers, J_true s' is linear in
# the numbers' errors: each at its largest against s, and J_max eta on top for the reaching rate.
@cache
def switching_gain() -> sp.Expr:
    """Smallest switching gain that reaches the surface, whatever the true numbers (5.20)."""
    errors = {
        J: (sp.Symbol("dJ"), J_UNC),
        FV: (sp.Symbol("dfv"), FV_UNC),
        FC: (sp.Symbol("dfc"), FC_UNC),
        TAU_E: (sp.Symbol("dtau"), TAU_UNC),
    }
    true = {x: x + d for x, (d, _) in errors.items()}
    model = equivalent_control().subs(SET_ACC, SET_BY_WANTED)
    plant = ACCELERATION.subs(true, simultaneous=True).subs(U_A, model)
    pull = sp.expand(sp.cancel(sp.together(true[J] * (WANTED - plant))))
    bound = J_MAX * ETA
    for d, largest in errors.values():
        for term in sp.Add.make_args(sp.expand(pull.coeff(d))):
            bound += largest * sp.Abs(term)
    return bound / N


EQUATIONS = """
    (5.12) | s | surface | surface of second order with integral
    (5.16, 5.17) | u_eq | equivalent | solution of s' = 0
    (5.20) | k_smc | gain | smallest switching gain
    [a_w] | a_w | wanted | acceleration that keeps the surface
    [tau_unc] | tau_e,unc | uncertain | uncertain coupling torque
    (5.22) | u | u_eq + k_smc * Max(-1, Min(1, s / phi)) | motor torque wanted
    [lead] | u_c | u + (kappa - 1) * (u - u_a) | \
        command that makes the motor follow kappa times faster; 1 as printed
"""


def surface_equations() -> tuple[Equation, ...]:
    return equations(
        EQUATIONS,
        surface=SURFACE,
        equivalent=equivalent_control(),
        gain=switching_gain(),
        wanted=WANTED_ACCELERATION,
        uncertain=TORQUE_UNCERTAINTY,
    )
