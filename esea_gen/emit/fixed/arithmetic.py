"""Lowering rules of sums, products, quotients, choices and comparisons."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from fractions import Fraction

from esea_gen.emit.fixed import expression as ex
from esea_gen.emit.fixed import functions
from esea_gen.emit.fixed.expression import Expr, OverflowProofError
from esea_gen.emit.fixed.values import (
    MOST_FRACTION_BITS,
    WIDE_LIMIT,
    ZERO,
    LoweringBase,
    Value,
    best_fraction,
    is_power,
    last_raw,
    stored,
    threshold,
    two,
)
from esea_gen.emit.printed import number_name
from esea_gen.emit.walker import Node, checked_from_zero

SHIFTED_FRACTION_BITS = 60
LEAST_SHIFT = -127  # of a quotient


class Arithmetic(LoweringBase):
    # -- operations ------------------------------------------------------------------------------

    def _narrowest(
        self, i: int, finish: Callable[[int, int, int], Value], natural: int, f: int
    ) -> Value:
        # In 32 bits where it may be and fits; else with all bits that came in, else without.
        narrow = [(f, 32)] if self._bits(i) == 32 else []
        for at, bits in (*narrow, (natural, 64)):
            try:
                return finish(at, f, bits)
            except OverflowProofError:
                pass
        return finish(f, f, 64)

    def sum(self, i: int, n: Node) -> Value:
        join = ex.add if n.op == "add" else ex.sub
        (al, ah), (bl, bh) = (self._ends(a) for a in n.args)
        low, high = (al + bl, ah + bh) if n.op == "add" else (al - bh, ah - bl)
        low, high = self._cut(i, low, high)
        if i in self.whole:
            with suppress(OverflowProofError):
                return Value(join(*(self._unsigned(a, None) for a in n.args), -32), 0)
        natural = max(f for f in map(self._fraction, n.args) if f < MOST_FRACTION_BITS)
        exact = i in self.compared

        def build(f: int) -> Value:
            if exact:
                try:
                    return whole(natural)
                except OverflowProofError:
                    pass
            return self._narrowest(i, finish, natural, f)

        def whole(at: int) -> Value:
            # Nothing is lost: what ends in comparisons alone decides as it should.
            try:
                (a, _, ca), (b, _, cb) = (self.align(k, at, 32) for k in n.args)
                total = join(a, b, 32)
            except OverflowProofError:
                (a, _, ca), (b, _, cb) = (self.align(k, at, 64) for k in n.args)
                total = join(a, b, 64)
                if ex.INT32[0] <= total.low and total.high <= ex.INT32[1]:
                    total = ex.cast(total, 32)
            return Value(total, at, 0.0, 0, stored(ca, cb))

        def finish(at: int, f: int, bits: int) -> Value:
            (a, ea, ca), (b, eb, cb) = (self.align(k, at, bits) for k in n.args)
            total = join(a, b, bits)
            local = ea + eb + (0.5 * 2.0**-f if at > f else 0.0)
            total = self._within(i, ex.round_shift(total, at - f), f)
            return Value(ex.cast(total, self._bits(i)), f, local, 0, stored(ca, cb))

        return self._settle(i, min(best_fraction(low, high, self._limit(i)), natural), build)

    def product(self, i: int, n: Node) -> Value:
        a, b = (*n.args, *n.args) if n.op == "sq" else n.args
        for one, other in ((a, b), (b, a)):
            c = self._constant(one)
            if c is None or self._constant(other) is not None or not is_power(c):
                continue
            # One so small that no sum could take it up is a number like any other.
            if self._value(other).fraction - math.log2(abs(c)) <= SHIFTED_FRACTION_BITS:
                return self.shifted(other, c)
        (al, ah), (bl, bh) = self._ends(a), self._ends(b)
        corners = [p * q for p in (al, ah) for q in (bl, bh)]
        low, high = self._cut(i, min(corners), max(corners))
        bits = self._bits(i)

        def operand(k: int, partner: int) -> tuple[Expr, int, float]:
            c = self._constant(k)
            if c is None:
                v = self._value(k)
                return v.expr, v.fraction, 0.0
            f = best_fraction(c, c)
            # No more fraction bits than the product can use, so that its shift stays in 62 bits.
            f = min(f, MOST_FRACTION_BITS - self._fraction(partner))
            e, _, error = self.align(k, f, 32)
            return e, f, error

        x, fx, cx = operand(a, b)
        y, fy, cy = operand(b, a)
        least = {64: 0, 96: 1, 128: 33}[x.bits + y.bits]
        natural = fx + fy - least

        def build(f: int) -> Value:
            shift = fx + fy - f
            room = 64 if i in self.facts else bits
            product = ex.mul(x, y, shift, room)
            product = ex.cast(self._within(i, product, f), bits)
            local = 0.5 * 2.0**-f if shift else 0.0
            return Value(product, f, local, 0, stored(cx, cy))

        return self._settle(i, min(best_fraction(low, high, self._limit(i)), natural), build)

    def shifted(self, k: int, factor: Fraction) -> Value:
        # Times a power of two: the same raw number in another format.
        v = self._value(k)
        power = abs(factor).numerator.bit_length() - abs(factor).denominator.bit_length()
        expr = v.expr
        if factor < 0:
            expr = ex.neg(expr if expr.low > ex.LIMITS[expr.bits][0] else ex.cast(expr, 64))
        return Value(expr, v.fraction - power)

    def quotient(self, i: int, n: Node) -> Value:
        dividend_node, divisor_node = n.args
        by = self._constant(divisor_node)
        if by is not None:
            return self._by_constant(i, n, by)
        (nl, nh), (dl, dh) = self._ends(dividend_node), self._ends(divisor_node)
        if dl <= 0 <= dh:
            raise self._fail(
                i,
                f"the divisor's range [{float(dl):.6g}, {float(dh):.6g}] holds zero",
                "Add a positive offset to the divisor, or clip it away from zero.",
            )
        corners = [p / q for p in (nl, nh) for q in (dl, dh)]
        low, high = self._cut(i, min(corners), max(corners))
        divisor = self._value(divisor_node)
        constant = self._constant(dividend_node)

        def cut(f: int) -> Value:
            error = 0.0
            if constant is not None:
                fn = best_fraction(constant, constant, WIDE_LIMIT)
                dividend, _, error = self.align(dividend_node, fn, 64)
            else:
                v = self._value(dividend_node)
                dividend, fn = ex.cast(v.expr, 64), v.fraction
            k = f + divisor.fraction - fn
            least, most = math.floor(low * two(f)) - 1, math.ceil(high * two(f)) + 1
            if i in self.facts:
                least, most = (math.floor(low * two(f)), math.ceil(high * two(f)))
            if k < LEAST_SHIFT:
                raise OverflowProofError(f"quotient shifted by {k}")
            args = dividend, ex.cast(divisor.expr, 64)
            q = ex.call("divide", args, 64, least, most, k, least, most)
            bits = self._bits(i)
            return Value(
                ex.cast(q, bits), f, 0.5 * 2.0**-f, functions.DIVIDE_ERROR, stored(error, 0.0)
            )

        return self._settle(i, best_fraction(low, high, self._limit(i)), cut)

    def extreme(self, i: int, n: Node) -> Value:
        pick = ex.minimum if n.op == "fmin" else ex.maximum
        choose = min if n.op == "fmin" else max
        (al, ah), (bl, bh) = (self._ends(a) for a in n.args)
        low, high = choose(al, bl), choose(ah, bh)
        for k, (kl, kh), (ol, oh) in (
            (n.args[0], (al, ah), (bl, bh)),
            (n.args[1], (bl, bh), (al, ah)),
        ):
            wins = kh <= ol if n.op == "fmin" else kl >= oh
            if wins and self._constant(k) is None:
                v = self._value(k)
                return Value(v.expr, v.fraction)
        return self.aligned(i, n.args, low, high, pick)

    def aligned(
        self,
        i: int,
        args: tuple[int, ...],
        low: Fraction,
        high: Fraction,
        join: Callable[[Expr, Expr, int], Expr],
        override: Mapping[int, Value] | None = None,
    ) -> Value:
        low, high = self._cut(i, low, high)
        filled = [f for f in map(self._fraction, args) if f < MOST_FRACTION_BITS]
        best = best_fraction(low, high, self._limit(i))
        natural = max(filled, default=best)
        if self._bits(i) == 32:
            best = min(best, self.caps.get(i, best))

        def operand(k: int, at: int, bits: int) -> tuple[Expr, float]:
            special = (override or {}).get(k)
            if special is None:
                e, _, constant = self.align(k, at, bits, inwards=True)
                return e, constant
            if special.fraction <= at:
                return ex.scale(special.expr, at - special.fraction, bits), 0.0
            return ex.cast(ex.round_shift(special.expr, special.fraction - at), bits), 0.0

        def finish(at: int, f: int, bits: int) -> Value:
            (a, ca), (b, cb) = (operand(k, at, bits) for k in args)
            joined = ex.round_shift(join(a, b, bits), at - f)
            joined = ex.cast(self._within(i, joined, f), self._bits(i))
            # Rounding and choosing commute: only an operand that is finer than the result loses.
            first = int(self.kernel.nodes[i].op not in ("fmin", "fmax"))  # after a condition
            errors = {}
            for position, (k, constant) in enumerate(zip(args, (ca, cb), strict=True)):
                finer = self._constant(k) is None and self._fraction(k) > f
                errors[first + position] = constant + (0.5 * 2.0**-f if finer else 0.0)
            return Value(joined, f, 0.0, 0, errors)

        return self._settle(i, min(best, natural), lambda f: self._narrowest(i, finish, natural, f))

    def select(self, i: int, n: Node) -> Value:
        test, *arms = n.args
        one, other = arms if n.op == "select" else (*arms, ZERO)
        condition = self._condition(test)
        implied = {} if condition.op == "literal" else self._implied(test, {})
        override: dict[int, Value] = {}
        found = None if self._constant(one) is not None else self.values[one]
        if one in implied and found is not None and found.expr.op == "ref":
            e, (low, high) = found.expr, implied[one]
            if low > e.low or high < e.high:
                low, high = max(low, e.low), min(high, e.high)
                override[one] = Value(ex.within(e, low, high), found.fraction)
        ends = [
            (override[k].low, override[k].high) if k in override else self._ends(k)
            for k in (one, other)
        ]
        if condition.op == "literal":
            chosen = one if condition.low else other
            if self._constant(chosen) is None:
                v = self._value(chosen)
                return Value(v.expr, v.fraction)
        if i in self.whole:
            named = self.choices.get(i)
            x, y = (
                override[k].expr if k in override else self._unsigned(k, named)
                for k in (one, other)
            )
            return Value(ex.choose(condition, x, y, -32), 0)
        least, most = min(low for low, _ in ends), max(high for _, high in ends)
        return self.aligned(
            i,
            (one, other),
            least,
            most,
            lambda a, b, bits: ex.choose(condition, a, b, bits),
            override,
        )

    def _implied(self, i: int, found: dict[int, tuple[int, int]]) -> dict[int, tuple[int, int]]:
        # Raw intervals of nodes that follow from a condition being true.
        n = self.kernel.nodes[i]
        if n.op == "and":
            for a in n.args:
                self._implied(a, found)
        elif n.op in ("le", "lt"):
            a, b = n.args
            for k, other, upper in ((a, b, True), (b, a, False)):
                c = self._constant(other)
                if c is None or self._constant(k) is not None:
                    continue
                v = self._held(k)
                low, high = found.get(k, (v.expr.low, v.expr.high))
                edge = last_raw(c, v.fraction, n.op == "lt", upper)
                found[k] = (low, min(high, edge)) if upper else (max(low, edge), high)
        return found

    def _condition(self, i: int) -> Expr:
        v = self.values[i]
        if v is None:
            return ex.literal(int(self.kernel.nodes[i].value != 0), 1)
        return ex.truth(v.expr)

    def logic(self, i: int, n: Node) -> Value:
        checked = checked_from_zero(self.kernel, n)
        if checked in self.choices:
            return self.comparison(n.args[0], self.kernel.nodes[n.args[0]], bound=True)
        return Value(ex.logic(n.op, *(self._condition(a) for a in n.args)), 0)

    def sign(self, i: int, n: Node) -> Value:
        return Value(Expr("sign", (self._value(n.args[0]).expr,), 32, -1, 1), 0)

    def comparison(self, i: int, n: Node, bound: bool = False) -> Value:
        a, b = n.args
        ca, cb = self._constant(a), self._constant(b)
        if ca is not None and cb is not None:
            holds = {"lt": ca < cb, "le": ca <= cb, "eq": ca == cb, "ne": ca != cb}[n.op]
            return Value(ex.literal(int(holds), 1), 0)
        if n.op in ("eq", "ne") and all(self.kernel.nodes[k].boolean for k in n.args):
            return Value(ex.compare(n.op, self._condition(a), self._condition(b)), 0)
        for k, c, upper in ((a, cb, True), (b, ca, False)):
            if c is None:
                continue
            v = self._held(k)
            if n.op in ("eq", "ne"):
                scaled = c * two(v.fraction)
                if scaled.denominator != 1:
                    return Value(ex.literal(int(n.op == "ne"), 1), 0)
                edge = threshold(int(scaled), v.expr)
                edge = ex.called(edge, number_name(c, self.choices.get(k)))
                return Value(ex.compare(n.op, v.expr, edge), 0)
            edge = threshold(last_raw(c, v.fraction, n.op == "lt", upper), v.expr)
            if bound:  # a choice's, checked against its last number
                edge = ex.called(edge, number_name(c, self.choices.get(k)))
            e = ex.compare("le", v.expr, edge) if upper else ex.compare("le", edge, v.expr)
            return Value(e, 0)
        at = max(self._value(a).fraction, self._value(b).fraction)
        while True:
            try:
                (x, ea, _), (y, eb, _) = (self.align(k, at, 64) for k in (a, b))
                break
            except OverflowProofError:
                at -= 1
        v, w = self._held(a), self._held(b)
        if v.fraction == w.fraction:
            x, y = v.expr, w.expr
        return Value(ex.compare(n.op, x, y), 0, ea + eb)

    def _by_constant(self, i: int, n: Node, c: Fraction) -> Value:
        # Dividing by a number is multiplying by its inverse, with the inverse's own rounding.
        if c == 0:
            raise self._fail(i, "the divisor is zero", "Divide by another number.")
        inverse = 1 / c
        if is_power(inverse):
            return self.shifted(n.args[0], inverse)
        v = self._value(n.args[0])
        f_c = min(best_fraction(inverse, inverse), MOST_FRACTION_BITS - v.fraction)
        raw = math.floor(inverse * two(f_c) + Fraction(1, 2))
        corners = v.low * inverse, v.high * inverse
        low, high = self._cut(i, min(corners), max(corners))
        y = ex.literal(raw)
        least = 0 if v.expr.bits == 32 else 1
        relative = float(abs(Fraction(raw) * two(-f_c) - inverse) / abs(inverse))

        def build(f: int) -> Value:
            shift = v.fraction + f_c - f
            room = 64 if i in self.facts else self._bits(i)
            product = ex.cast(self._within(i, ex.mul(v.expr, y, shift, room), f), self._bits(i))
            return Value(product, f, 0.5 * 2.0**-f if shift else 0.0, relative)

        natural = v.fraction + f_c - least
        return self._settle(i, min(best_fraction(low, high, self._limit(i)), natural), build)

    def magnitude(self, i: int, n: Node) -> Value:
        v = self._value(n.args[0])
        if v.expr.low > ex.LIMITS[v.expr.bits][0]:
            return Value(ex.absolute(v.expr), v.fraction)
        if v.expr.bits == 64:
            raise self._fail(i, "its argument fills 64 bits", "Narrow the ranges of the ports.")
        whole = ex.absolute(ex.cast(v.expr, 64))
        if i in self.compared or i in self.wide:
            return Value(whole, v.fraction)
        return Value(ex.round_shift(whole, 1, 32), v.fraction - 1, 0.5 * 2.0 ** (1 - v.fraction))
