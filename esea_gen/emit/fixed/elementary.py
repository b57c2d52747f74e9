"""Lowering rules of the elementary functions."""

from __future__ import annotations

import math
from fractions import Fraction

from esea_gen.emit.elementary import EXPONENT_FRACTION_BITS, exponent_q27
from esea_gen.emit.fixed import expression as ex
from esea_gen.emit.fixed import functions
from esea_gen.emit.fixed.arithmetic import Arithmetic
from esea_gen.emit.fixed.expression import OverflowProofError
from esea_gen.emit.fixed.values import Value, best_fraction, two
from esea_gen.emit.walker import Node

_FINEST = 62  # fraction bits of an argument: what the C shifts by
EXPONENT_ERROR = 2.0 ** -(EXPONENT_FRACTION_BITS + 1)


class Elementary(Arithmetic):
    """Rules of powers, exponentials, logarithms, roots and the hyperbolic tangent."""

    def function(self, i: int, n: Node) -> Value:
        low, high = self._ends(n.args[0])
        v = self._value(n.args[0])
        rule = {
            "pow": self._power,
            "exp": self._exponential,
            "log": self._logarithm,
            "sqrt": self._root,
            "tanh": self._tangent,
        }[n.op]
        return rule(i, n, v, float(low), float(high))

    def _power(self, i: int, n: Node, v: Value, low: float, high: float) -> Value:
        y = self._constant(n.args[1])
        if y is None:
            raise self._fail(i, "the exponent varies", "Use a constant exponent, or exp and log.")
        c = float(y)
        if v.expr.low < 0:
            raise self._fail(
                i, f"the base reaches {low:.6g}, below zero", "Take the magnitude of the base."
            )
        if c <= 0 and v.expr.low <= 0:
            raise self._fail(
                i,
                f"the base can be zero and the exponent is {c:g}",
                "Add a positive offset to the base.",
            )
        try:
            q27 = exponent_q27(c)
        except ValueError as error:
            raise self._fail(i, str(error), "Scale the base.") from None
        least, most = (high**c, low**c) if c < 0 else (max(low, 0.0) ** c, high**c)
        slack = 1 + 2.0**-24

        def build(f: int) -> Value:
            top = math.ceil(Fraction(most * slack) * two(f)) + 1
            e = ex.call("pow", (v.expr,), self._bits(i), 0, top, v.fraction, q27, f, top)
            if e.bits == 32 and v.expr.bits == 64:
                wide = ex.call("pow", (v.expr,), 64, 0, top, v.fraction, q27, f, top)
                e = ex.cast(wide, 32)
            e = ex.clamp(e, self._bottom(least / slack, f), e.high)
            base = 2.0**-31 if v.expr.bits == 64 else 0.0
            core = math.log(2) * abs(c) * (functions.LOG2_ERROR + 2.0**-56) + abs(c) * base
            relative = math.expm1(core) + functions.EXP2_ERROR
            return Value(e, f, 0.5 * 2.0**-f, relative)

        return self._settle(
            i, best_fraction(Fraction(0), Fraction(most * slack), self._limit(i)), build
        )

    def _bottom(self, least: float, f: int) -> int:
        # Smallest result of a function that cannot be negative.
        return max(0, math.floor(Fraction(least) * two(f)) - 1)

    def _narrowed(self, i: int, v: Value) -> tuple[Value, float]:
        # A 64-bit argument of a function that takes 32 bits.
        if v.expr.bits == 32:
            return v, 0.0
        f = best_fraction(v.low, v.high)
        e = ex.round_shift(v.expr, v.fraction - f, 32) if v.fraction > f else ex.cast(v.expr, 32)
        return Value(e, min(f, v.fraction)), 0.5 * 2.0**-f

    def _not_tiny(self, i: int, v: Value, low: float, high: float, instead: str) -> None:
        """Refuse an argument whose format has a finer step than the function takes."""
        if v.fraction > _FINEST:
            raise self._fail(
                i,
                f"its argument never exceeds {max(-low, high):.3g} in magnitude, and must be able "
                f"to reach {2.0 ** (31 - _FINEST - 1):.3g} for a step of 2^-{_FINEST} in 32 bits",
                f"So near zero {self.kernel.nodes[i].op}(x) is {instead}: write that, or check the "
                "gain before it.",
            )

    def _exponential(self, i: int, n: Node, v: Value, low: float, high: float) -> Value:
        v, error = self._narrowed(i, v)
        if v.fraction < 1 or high > 40:
            raise self._fail(
                i,
                f"its argument's range [{low:.6g}, {high:.6g}] is too wide",
                "Clip the argument to at most 40.",
            )
        self._not_tiny(i, v, low, high, "1 + x")
        most = math.exp(high) * (1 + 2.0**-24)

        def build(f: int) -> Value:
            top = math.ceil(Fraction(most) * two(f)) + 1
            e = ex.call("exp", (v.expr,), 64, 0, top, v.fraction, f, top)
            e = ex.clamp(e, self._bottom(math.exp(low) * (1 - 2.0**-24), f), top)
            local = 0.5 * 2.0**-f + math.expm1(error) * most
            return Value(ex.cast(e, self._bits(i)), f, local, functions.EXP2_ERROR + 2.0**-33)

        return self._settle(i, best_fraction(Fraction(0), Fraction(most), self._limit(i)), build)

    def _logarithm(self, i: int, n: Node, v: Value, low: float, high: float) -> Value:
        if v.expr.low <= 0:
            raise self._fail(
                i, f"its argument reaches {low:.6g}", "Add a positive offset to the argument."
            )
        least, most = Fraction(math.log(low)), Fraction(math.log(high))

        def build(f: int) -> Value:
            bottom, top = math.floor(least * two(f)) - 2, math.ceil(most * two(f)) + 2
            e = ex.call("log", (v.expr,), 64, -(2**62), 2**62, v.fraction, f)
            log2 = max(abs(math.log2(low)), abs(math.log2(high)))
            base = 2.0**-31 if v.expr.bits == 64 else 0.0
            local = math.log(2) * functions.LOG2_ERROR + log2 * 2.0**-32 + 2.0**-33 + base
            cut = ex.cast(ex.clamp(e, bottom, top), self._bits(i))
            return Value(cut, f, local + 0.5 * 2.0**-f)

        best = best_fraction(least, max(most, Fraction(1, 8)), self._limit(i))
        return self._settle(i, min(best, 52), build)

    def _root(self, i: int, n: Node, v: Value, low: float, high: float) -> Value:
        most = math.sqrt(max(high, 0.0)) * (1 + 2.0**-40)

        def build(f: int) -> Value:
            k = 2 * f - v.fraction
            if (v.expr.high << k if k >= 0 else v.expr.high >> -k) >= 2**62 or not -62 <= k <= 62:
                raise OverflowProofError("root of more than 62 bits")
            top = math.ceil(Fraction(most) * two(f)) + 1
            e = ex.call("sqrt", (v.expr,), 32, 0, ex.INT32[1], k)
            # A base below zero by rounding counts as zero; bits shifted out below cost a unit.
            least = math.sqrt(max(low, 0.0)) * (1 - 2.0**-40)
            bottom = max(0, math.floor(Fraction(least) * two(f)) - 2)
            return Value(ex.clamp(e, bottom, min(top, ex.INT32[1])), f, 2 * 2.0**-f)

        if v.expr.low < 0 and low < -1e-6 * max(high, 1e-300):
            raise self._fail(i, f"its argument reaches {low:.6g}", "Clip the argument at zero.")
        best = best_fraction(Fraction(0), Fraction(most))
        return self._settle(i, min(best, 61), build)

    def _tangent(self, i: int, n: Node, v: Value, low: float, high: float) -> Value:
        v, error = self._narrowed(i, v)
        if v.fraction < 2:
            raise self._fail(
                i, f"its argument's range [{low:.6g}, {high:.6g}] is too wide", "Clip the argument."
            )
        self._not_tiny(i, v, low, high, "x")
        e = ex.call("tanh", (v.expr,), 32, -(2**30), 2**30, v.fraction)
        return Value(e, 30, 2.0**-28 + error)
