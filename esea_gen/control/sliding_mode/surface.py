"""The sliding surface, and what SymPy derives from it and the plant: (5.12 to 5.22).

The equivalent control is solved for; the switching gain is the same line with every number
uncertain.
"""

from __future__ import annotations

from functools import cache

import sympy as sp

from esea_gen.language.ports import Equation
from esea_gen.model.symbolic import equation
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


@cache
def equivalent_control() -> sp.Expr:
    """Equivalent control: the motor torque that keeps the surface (5.16, 5.17).

    return: solution of s' = 0 for u_a, with the plant (5.2) put in for the motor side's
        acceleration.
    """
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


@cache
def switching_gain() -> sp.Expr:
    """Smallest switching gain that reaches the surface whatever the uncertain numbers are (5.20).

    With the equivalent control of the model put into the plant with true numbers, ``J_true s'`` is
    linear in the numbers' errors.  Each error at its largest, against ``s``, and J_max eta on top
    for the reaching rate, gives the sum of magnitudes.  J_max is J + J_unc.
    """
    errors = {
        J: (sp.Symbol("dJ"), J_UNC),
        FV: (sp.Symbol("dfv"), FV_UNC),
        FC: (sp.Symbol("dfc"), FC_UNC),
        TAU_E: (sp.Symbol("dtau"), TAU_UNC),
    }
    true = {x: x + d for x, (d, _) in errors.items()}
    model = equivalent_control().subs(SET_ACC, WANTED - 2 * LAMBDA * ERROR_RATE - LAMBDA**2 * ERROR)
    plant = ACCELERATION.subs(true, simultaneous=True).subs(U_A, model)
    pull = sp.expand(sp.cancel(sp.together(true[J] * (WANTED - plant))))
    bound = J_MAX * ETA
    for d, largest in errors.values():
        for term in sp.Add.make_args(sp.expand(pull.coeff(d))):
            bound += largest * sp.Abs(term)
    return bound / N


def surface_equations() -> tuple[Equation, ...]:
    """What the law implements, for documents.

    return: surface, equivalent control, switching gain, law, and our lead.
    """
    return (
        equation("(5.12)", "s", SURFACE, "surface of second order with integral"),
        equation("(5.16, 5.17)", "u_eq", equivalent_control(), "solution of s' = 0"),
        equation("(5.20)", "k_smc", switching_gain(), "smallest switching gain"),
        equation("[a_w]", WANTED, WANTED_ACCELERATION, "acceleration that keeps the surface"),
        equation("[tau_unc]", TAU_UNC, TORQUE_UNCERTAINTY, "uncertain coupling torque"),
        equation(
            "(5.22)",
            "u",
            sp.Symbol("u_eq")
            + sp.Symbol("k_smc") * sp.Max(-1, sp.Min(1, sp.Symbol("s") / sp.Symbol("phi"))),
            "motor torque wanted",
        ),
        equation(
            "[lead]",
            "u_c",
            sp.Symbol("u") + (sp.Symbol("kappa") - 1) * (sp.Symbol("u") - U_A),
            "command that makes the motor follow kappa times faster; 1 as printed",
        ),
    )
