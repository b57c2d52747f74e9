"""Single steps of a Block from any memory, for Blocks that are typed a second time in NumPy."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from hypothesis import strategies as st

from esea_gen.language.block import Block
from esea_gen.language.ports import Port
from esea_gen.language.stream import SPECIAL

COUNT = 1500


def drawn(p: Port, rng: np.random.Generator, scale: np.ndarray) -> np.ndarray:
    """Values inside a port's range, shape (size, COUNT): of a scale, anywhere, at its ends."""
    shape = (p.size, COUNT)
    wide = rng.uniform(p.low, p.high, shape)
    ends = rng.choice([p.low, p.high, 0.0], shape)
    kind = rng.random(shape)
    x = np.where(kind < 0.75, scale * wide, np.where(kind < 0.9, wide, ends))
    if p.unit == "1":  # mostly a mode, a place, or whether something is so
        x = np.where((rng.random(shape) < 0.7) | p.whole, np.rint(wide), x)
    return np.clip(x, p.low, p.high)


class Steps:
    """Steps of a Block: what went in, guarded, and what came out; arrays of shape (COUNT,).

    t, c, s, u: tunables, coefficients, state and inputs, by name; (size, COUNT) where a port has
        several elements.
    ok, whole: whether every input and the memory was in its range.
    found: the next state as ``next_...``, the outputs as ``y_...``.
    """

    def __init__(self, block: Block, seed: int = 1, together=lambda _s, _u, _rng: None) -> None:
        rng = np.random.default_rng(seed)
        self.block = block
        scale = 10.0 ** np.where(rng.random(COUNT) < 0.6, rng.uniform(-4, 0, COUNT), 0)
        tunables = {}
        for p in block.tunables:
            ends = rng.choice([p.low, p.high], COUNT)
            kind, wide = np.arange(COUNT) % 4, rng.uniform(p.low, p.high, COUNT)
            tunables[p.name] = np.select([kind < 2, kind < 3], [p.default, wide], ends)
        prepared = self._mapped(block.prepare, [*tunables.values()])
        c = dict(zip((p.name for p in block.coefficients), prepared, strict=True))
        # As narrow as its range, where rounding has put it beside.
        c = {p.name: np.clip(c[p.name], p.low, p.high) for p in block.coefficients}
        s = {p.name: drawn(p, rng, scale) for p in block.state}
        u = {p.name: drawn(p, rng, scale) for p in block.inputs}
        together({k: v[0] for k, v in s.items()}, {k: v[0] for k, v in u.items()}, rng)
        self._spoil(rng, s, u)
        names = [f"next_{p.name}" for p in block.state] + [f"y_{p.name}" for p in block.outputs]
        results = self._mapped(block.step, [*c.values(), *s.values(), *u.values()])
        self.found = dict(zip(names, results, strict=True))
        self.t, self.c = SimpleNamespace(**tunables), SimpleNamespace(**c)
        self._guard(s, u)

    def _mapped(self, function, columns: list[np.ndarray]) -> list[np.ndarray]:
        if not columns:
            return []
        results = function.map(COUNT).call([np.atleast_2d(x) for x in columns])
        return [
            np.squeeze(np.array(r), axis=0) if r.shape[0] == 1 else np.array(r) for r in results
        ]

    def _spoil(self, rng, s: dict[str, np.ndarray], u: dict[str, np.ndarray]) -> None:
        # Of some steps one input or one state is not a number, or beyond an end of its range.
        for ports, values, share in ((self.block.inputs, u, 0.2), (self.block.state, s, 0.08)):
            for k in np.flatnonzero(rng.random(COUNT) < share) if ports else ():
                p = ports[rng.integers(len(ports))]
                width = max(abs(p.low), abs(p.high)) * p.size
                bad = (np.nan, np.inf, p.low - 2.5 * width, p.high + 2.5 * width)
                values[p.name][rng.integers(p.size), k] = bad[rng.integers(4)]

    def _guard(self, s: dict[str, np.ndarray], u: dict[str, np.ndarray]) -> None:
        """What stands in for what is out of its range, and whether anything was."""

        def fine(p: Port, x: np.ndarray) -> np.ndarray:
            return np.all((x >= p.low) & (x <= p.high), axis=0)

        block, true = self.block, np.ones(COUNT, dtype=bool)
        self.whole = np.logical_and.reduce([true, *(fine(p, s[p.name]) for p in block.state)])
        held = {p.name: np.where(self.whole, s[p.name], p.init) for p in block.state}
        self.ok, used = true, {}
        for p in block.inputs:
            ok = fine(p, u[p.name])
            other = held[p.on_invalid] if isinstance(p.on_invalid, str) else p.on_invalid
            used[p.name] = np.where(ok, u[p.name], other)
            self.ok = self.ok & ok

        def named(values: dict[str, np.ndarray]) -> SimpleNamespace:
            return SimpleNamespace(**{n: v[0] if len(v) == 1 else v for n, v in values.items()})

        self.s, self.u = named(held), named(used)

    def compare(
        self, expected: dict[str, np.ndarray], both: str = "", near: np.ndarray | bool = False
    ) -> None:
        """Every next state and every output, of every step; each flag up and down.

        both: flags that stay up or down here.
        near: steps, at most a tenth, of which rounding settles a decision: they are left out.
        """
        assert set(expected) == set(self.found)
        clear = np.broadcast_to(~np.asarray(near), (COUNT,))
        assert clear.sum() >= 0.9 * COUNT
        for name, value in expected.items():
            typed = np.asarray(value, dtype=float)
            np.testing.assert_allclose(
                self.found[name][..., clear],
                np.broadcast_to(typed, self.found[name].shape)[..., clear],
                rtol=2e-6,
                atol=2e-7 * np.max(np.abs(typed)),
                err_msg=name,
            )
        flags = [(p.name, f.name) for p in self.block.outputs for f in p.flags]
        stays = set()
        for i, (port, flag) in enumerate(flags):
            up = self.found[f"y_{port}"].astype(int) >> i & 1
            if not 0 < up.sum() < COUNT:
                stays.add(flag)
        assert stays == set(both.split())


def word(*flags: np.ndarray) -> np.ndarray:
    """A status word, the first flag in the lowest bit."""
    return sum(np.where(f, 1 << i, 0) for i, f in enumerate(flags))


def stays_in_range(block, runner, draw) -> None:
    """Whatever the inputs and the state: every output is a number in its range."""
    value = st.one_of(st.sampled_from(SPECIAL), st.floats(-50, 50, width=32))
    inputs = {p.name: draw(st.lists(value, min_size=6, max_size=6)) for p in block.inputs}
    runner.put_state({p.name: draw(value) for p in block.state})
    y, _ = runner.run({k: np.array(v) for k, v in inputs.items()})
    for p in block.outputs:
        assert np.all((y[p.name] >= p.low) & (y[p.name] <= p.high)), p.name
