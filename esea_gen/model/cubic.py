"""Real root of the segment's cubic (4.13), in a form that is accurate near zero."""

from __future__ import annotations

from typing import Any

import casadi as ca
import sympy as sp

from esea_gen.language.block import Labels
from esea_gen.language.ports import Equation
from esea_gen.model.elastomer import K3
from esea_gen.model.symbolic import equations, to_casadi

LINEAR, LOAD = sp.symbols("a d", real=True)
HALF, THIRD, ROOT, RATIO = sp.symbols("b a_3 c q", positive=True)

# Parts of the real root of k3 x^3 + a x = d, without the cancellation of (4.13) near zero.
ROOT_THIRD = LINEAR / (3 * K3)
ROOT_HALF = sp.Abs(LOAD) / (2 * K3)
ROOT_CUBE = HALF + sp.sqrt(THIRD**3 + HALF**2)
ROOT_RATIO = THIRD / ROOT
ROOT_SIZE = 2 * HALF / (ROOT**2 + THIRD + RATIO**2)
ROOT_WHOLE = ROOT_SIZE.subs(RATIO, ROOT_RATIO)


def cubic_root(k3: float, linear: Any, load: Any, label: Labels | None = None) -> ca.SX:
    """Real root of ``k3 x^3 + linear x = load``, accurate near zero (4.13 without cancellation)."""
    if k3 == 0:
        return ca.SX(load / linear)
    third = to_casadi(ROOT_THIRD, {LINEAR: linear, K3: k3})
    half = to_casadi(ROOT_HALF, {LOAD: load, K3: k3})
    if label is not None:
        half = label("root_b_rad3", half, "[root 2] |load| / (2 k3)")
    cube = to_casadi(ROOT_CUBE, {HALF: half, THIRD: third})
    root = ca.power(cube, 1.0 / 3.0)
    ratio = to_casadi(ROOT_RATIO, {THIRD: third, ROOT: root})
    if label is not None:
        if not ca.SX(third).is_constant():
            third = label("root_a_rad2", third, "[root 1] linear / (3 k3)")
        root = label("root_c_rad", root, "[root 3] at least sqrt(a)")
        ratio = label("root_ratio_rad", ratio, "a / c, at most sqrt(a)")
    size = to_casadi(ROOT_SIZE, {HALF: half, THIRD: third, ROOT: root, RATIO: ratio})
    if label is not None:
        size = label("root_size_rad", size, "(4.13), stable form")
    return ca.SX(ca.sign(load) * size)


# With a = linear / (3 k3) > 0 and b = |load| / (2 k3) the radicand of c is b + sqrt(a^3 + b^2) >=
# sqrt(a^3), so c >= sqrt(a) and a / c <= sqrt(a); c rises with both.  The root of the largest load
# at the least stiffness is the largest of all.
def root_facts(
    k3: float, linear: tuple[float, float], load_high: float
) -> dict[str, tuple[float, float]]:
    """Ranges of the labelled parts of :func:`cubic_root`, which intervals cannot see."""
    if k3 == 0:
        return {}
    low, high = (x / (3 * k3) for x in linear)
    half = load_high / (2 * k3)
    most = (half + (high**3 + half**2) ** 0.5) ** (1 / 3)
    least = (half + (low**3 + half**2) ** 0.5) ** (1 / 3)
    largest = 2 * half / (least**2 + low + (low / least) ** 2)
    room = 1e-9  # for the rounding of these very numbers
    known = {"root_a_rad2": (low * (1 - room), high * (1 + room))} if low < high else {}
    return known | {
        "root_c_rad": (low**0.5 * (1 - room), most * (1 + room)),
        "root_ratio_rad": (0.0, high**0.5 * (1 + room)),
        "root_size_rad": (0.0, largest * (1 + room)),
    }


EQUATIONS = """
    [segment] | d | k_3 * x**3 + a * x | \
        the torque between two breakpoints, of the deflection beyond the dead zone
    [breakpoint] | x_i | s * F_i + r_i | where stop i saturates; s is the direction
    [a] | a | k_1 + g + Sum(p_i, (i, 1, N)) | \
        linear stiffness: spring, Maxwell element, stops not saturated
    [root 1] | a_3 | third | real root of the segment's cubic, first part
    [root 2] | b | half | second part
    [root 3] | c | root | third part
    (4.13), stable form | |x| | whole | the root, with the sign of d
"""


def segment_equations() -> tuple[Equation, ...]:
    root = sp.cbrt(ROOT_CUBE)
    return equations(EQUATIONS, third=ROOT_THIRD, half=ROOT_HALF, root=root, whole=ROOT_WHOLE)
