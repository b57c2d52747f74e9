"""Programs: kernels called in loops of bounded trip count, with static work memory.

A Block's step is one straight-line function.  What needs loops (a rollout over a horizon, a
quadratic program) is a Program: the same ports, tunables, ``prepare`` and ``init``, and a body made
of a few statements::

    call    a kernel (a CasADi function on scalars) on slices of arrays
    loop    a fixed number of times, or at most so many times with an exit
    when    one way or the other
    set     a whole number, which only indexes arrays
    invoke  a part of the body that stands elsewhere

There is no heap, no recursion and no loop without a bound; every array is a port, a table of
constants, or work memory in the caller's state struct.  One description is run in Python
(:class:`ProgramSimulator`, float64, kernels by CasADi's evaluator) and printed as C, so that the
f64 C gives the executor's bits.  Kernels go through the same walker and printer as a Block's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import casadi as ca

from esea_gen.language.block import Block, Constant, Equation, Port, PrepareFn, Tunable
from esea_gen.language.builder import Builder, array_name, declare_ports, guard_inputs
from esea_gen.language.statements import (
    EPSILON,
    WORK_RANGE,
    Call,
    For,
    Invoke,
    Ix,
    Leave,
    Memory,
    Part,
    ProgramError,
    Ref,
    SetIndex,
    Statement,
    When,
    walk_statements,
)

if TYPE_CHECKING:
    from esea_gen.language.program_run import ProgramSimulator


@dataclass(frozen=True)
class Program:
    """What a Block is, with a body of loops in place of one straight-line step.

    Build one with :meth:`define`.

    Parameters
    ----------
    name, title, period_s, constants, tunables, coefficients, inputs, outputs, equations
        As in :class:`esea_gen.language.block.Block`.
    carried : tuple of Port
        What one step leaves to the next.
    prepare, init : casadi.Function
        As in a Block.
    memory : mapping of str to Memory
        Every array by name.
    parts : mapping of str to Part
        The body; ``step`` is the entry.
    """

    name: str
    title: str
    period_s: float
    constants: tuple[Constant, ...]
    tunables: tuple[Tunable, ...]
    coefficients: tuple[Port, ...]
    carried: tuple[Port, ...]
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    equations: tuple[Equation, ...]
    prepare: ca.Function = field(repr=False)
    init: ca.Function = field(repr=False)
    memory: Mapping[str, Memory] = field(repr=False)
    parts: Mapping[str, Part] = field(repr=False)

    @property
    def kind(self) -> str:
        """``program``: a body of loops."""
        return "program"

    @classmethod
    def define(
        cls,
        name: str,
        title: str,
        *,
        period_s: float,
        builder: Builder,
        inputs: tuple[Port, ...],
        outputs: tuple[Port, ...],
        state: tuple[Port, ...] = (),
        constants: tuple[Constant, ...] = (),
        tunables: tuple[Tunable, ...] = (),
        coefficients: tuple[Port, ...] = (),
        prepare: PrepareFn | None = None,
        equations: tuple[Equation, ...] = (),
    ) -> Program:
        """Build a Program.

        The builder must hold one array a port (see :func:`declare_ports`) and the part ``step``.

        Parameters
        ----------
        name, title, period_s, inputs, outputs, state, constants, tunables, coefficients, equations
            As in the class.
        builder : Builder
            Arrays and body.
        prepare : callable, optional
            As in :meth:`esea_gen.language.block.Block.define`.

        Returns
        -------
        Program
            The Program.

        Raises
        ------
        ProgramError
            For a body that writes to an input, coefficient or table, reads an array that is not
            there, or loops without a bound.
        """
        # The checks of names, tunables and prepare are the Block's own.
        symbols = Block.define(
            name,
            title,
            period_s=period_s,
            state=state,
            inputs=(),
            outputs=(Port("unused", 0.0, 1.0, "only so that there is one"),),
            step=lambda c, s, u, guard, label: (vars(s), {"unused": ca.SX(0)}),
            tunables=tunables,
            coefficients=coefficients,
            prepare=prepare,
        )
        program = cls(
            name,
            title,
            period_s,
            constants,
            tunables,
            coefficients,
            state,
            inputs,
            outputs,
            equations,
            symbols.prepare,
            symbols.init,
            dict(builder.memory),
            dict(builder.parts),
        )
        program._check()
        return program

    def _check(self) -> None:
        for region, ports in (
            ("coeffs", self.coefficients),
            ("state", self.carried),
            ("in", self.inputs),
            ("out", self.outputs),
        ):
            for p in ports:
                m = self.memory.get(array_name(region, p.name))
                if m is None or m.region != region or m.size != p.size:
                    raise ProgramError(f"{self.name}: no array for port {p.name}")
        if "step" not in self.parts:
            raise ProgramError(f"{self.name}: no part 'step'")
        for part in self.parts.values():
            for s in walk_statements(part.body):
                if not isinstance(s, Call):
                    continue
                for r in (*s.args, *s.results):
                    if r.array not in self.memory:
                        raise ProgramError(f"{self.name}: no array {r.array}")
                for r in s.results:
                    if self.memory[r.array].region in ("coeffs", "in", "table", "index"):
                        raise ProgramError(f"{self.name}: {s.kernel.name()} writes to {r.array}")

    @property
    def work(self) -> tuple[Memory, ...]:
        """Work arrays, in the order of the state struct."""
        return tuple(m for m in self.memory.values() if m.region == "work")

    @property
    def state(self) -> tuple[Port, ...]:
        """The state struct: what is carried, and the work arrays, which carry nothing."""
        return self.carried + tuple(
            Port(m.name, -WORK_RANGE, WORK_RANGE, f"work: {m.meaning or m.name}", m.size)
            for m in self.work
        )

    @property
    def status_port(self) -> Port | None:
        """The output that is a status word, if there is one."""
        return next((p for p in self.outputs if p.flags), None)

    @cached_property
    def index_tables(self) -> dict[str, tuple[int, ...]]:
        """Index tables by name."""
        return {n: m.values for n, m in self.memory.items() if m.region == "index"}

    @property
    def kernels(self) -> dict[str, ca.Function]:
        """The kernels of the body by a name of their own: ``k1_copy``, ``k2_pivot`` ..."""
        found: dict[int, ca.Function] = {}
        for part in self.parts.values():
            for s in walk_statements(part.body):
                if isinstance(s, Call):
                    found.setdefault(id(s.kernel), s.kernel)
        return {f"k{i}_{f.name()}": f for i, f in enumerate(found.values(), 1)}

    def default_tunables(self) -> dict[str, float]:
        """Default of every tunable."""
        return {t.name: t.default for t in self.tunables}

    def simulator(self, tunables: Mapping[str, float] | None = None) -> ProgramSimulator:
        """The reference executor, float64.

        Parameters
        ----------
        tunables : mapping of str to float, optional
            Values other than the defaults.

        Returns
        -------
        ProgramSimulator
            Freshly initialised.
        """
        from esea_gen.language.program_run import ProgramSimulator

        return ProgramSimulator(self, tunables)


__all__ = [
    "EPSILON",
    "Builder",
    "Call",
    "For",
    "Invoke",
    "Ix",
    "Leave",
    "Memory",
    "Part",
    "Program",
    "ProgramError",
    "Ref",
    "SetIndex",
    "Statement",
    "When",
    "array_name",
    "declare_ports",
    "guard_inputs",
    "walk_statements",
]
