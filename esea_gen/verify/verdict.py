"""Results of a verification: one comparison per Block, stream and format; a device's verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from esea_gen.emit.step_errors import Bound

EXACT, RESIDUAL, LASTING, ONE_STEP, EXACT_STEP, EXACT_PROGRAM, STATED = RULES = (
    "CasADi's C, bit for bit",
    "residual",
    "any number of steps",
    "one step, from the same memory",
    "one step of the executor in float32, exactly",
    "a program's executor, bit for bit",
    "a program's executor, a stated share of full scale",
)

NOTHING_TOLD_PERCENT = 100.0  # of full scale: any value of the output would be within such a bound


@dataclass
class Comparison:
    """One stream through one Block in one number format.

    Parameters
    ----------
    block, stream, real : str
        Names.
    steps : int
        Length of the stream.
    errors : dict of str to float
        Largest |C - symbolic| per output and state.
    limits : dict of str to float
        What each must not exceed.
    status_differences : int
        Steps in which a status word differs beyond what its own threshold explains.
    bit_identical : bool or None
        f64: whether every bit equals CasADi's own generated C.
    problems : list of str
        Non-finite values, broken stop and restore, errors above their limit.
    residual : tuple of float, optional
        Blocks judged by their residual: the largest |request less the model's torque| and its
        limit, Nm.
    rule : str
        One of ``RULES``: what ``errors`` are, and what ``limits`` hold for.
    drift : dict of str to float
        Rule "one step": how far a free run comes apart, per output and state, without a limit; of a
        status word, the share of steps that differ.
    turned : int
        Rule "one step": steps in which rounding turned a decision, within the derived errors of its
        operands.
    beyond : int
        Steps that break what a bound for any number of steps assumes.  A rough stream may hold
        some: it is then judged by the rule "one step".
    """

    block: str
    stream: str
    real: str
    steps: int
    errors: dict[str, float]
    limits: dict[str, float]
    status_differences: int = 0
    bit_identical: bool | None = None
    problems: list[str] = field(default_factory=list)
    residual: tuple[float, float] | None = None
    rule: str = EXACT
    drift: dict[str, float] = field(default_factory=dict)
    turned: int = 0
    beyond: int = 0

    @property
    def passed(self) -> bool:
        """Whether everything holds."""
        return not self.problems and not self.status_differences and self.bit_identical is not False


@dataclass
class Verification:
    """All comparisons of a device.

    Parameters
    ----------
    device, content_hash : str
        What was verified.
    comparisons : list of Comparison
        One per Block, stream and format.
    bounds : dict
        Derived worst-case errors: ``{block: {domain: Bound}}`` for f32; no entry for a Block that
        is judged by its residual.
    full_scale : dict of str to float
        Per port name, what counts as 100 %; of several Blocks with a port of that name, the
        smallest.
    full_scales : dict of str to dict
        The same per Block.
    """

    device: str
    content_hash: str
    comparisons: list[Comparison]
    bounds: dict[str, dict[str, Bound]]
    full_scale: dict[str, float]
    full_scales: dict[str, dict[str, float]] = field(default_factory=dict)

    @property
    def passed(self) -> bool:
        """Whether every comparison holds."""
        return all(c.passed for c in self.comparisons)

    def telling_nothing(self, block: str) -> dict[str, float]:
        """Outputs whose narrowest derived bound, in per cent of full scale, is 100 or more.

        Parameters
        ----------
        block : str
            Name of the Block.
        """
        scale, domains = self.full_scales[block], self.bounds.get(block, {}).values()
        names = {k for b in domains for k in b.outputs if scale.get(k)}
        least = {k: min(100 * b.outputs[k] / scale[k] for b in domains) for k in sorted(names)}
        return {k: v for k, v in least.items() if v >= NOTHING_TOLD_PERCENT}

    def verdict(self) -> str:
        """One line: PASS, PASS with outputs whose bound proves nothing, or FAIL with the Blocks."""
        blocks = list(dict.fromkeys(c.block for c in self.comparisons))
        of = ", ".join(blocks) if len(blocks) < 3 else f"{len(blocks)} Blocks"
        failed = dict.fromkeys(f"{c.block} {c.real}" for c in self.comparisons if not c.passed)
        if failed:
            return f"verdict: FAIL. The C differs from the symbolic model in {', '.join(failed)}."
        program = any(c.rule == EXACT_PROGRAM for c in self.comparisons)
        said = []
        for real in dict.fromkeys(c.real for c in self.comparisons):
            worst = {
                f"{b}.{port}": 100 * e / self.full_scales[b][port]
                for b in blocks
                for port, e in self.worst(real, b).items()
            }
            port = max(worst, key=lambda k: worst[k])
            said.append(
                f"f64 equals CasADi's C{' or the executor of its Program' * program} bit for bit"
                if real == "f64"
                else f"{real} is within every limit, at most {worst[port]:.2g} % of full scale "
                f"from the model ({port})"
            )
        wide = {
            f"{b}.{port}": f"{percent:.0f} % of full scale"
            for b in self.bounds
            for port, percent in self.telling_nothing(b).items()
        }
        wide |= {c.block: "none is finite" for c in self.comparisons if c.rule == EXACT_STEP}
        if not wide:
            return f"verdict: PASS. {of}: {'; '.join(said)}."
        return (
            f"verdict: PASS, {len(wide)} output{'s' * (len(wide) > 1)} tested but not proven. "
            f"{of}: {'; '.join(said)}. Not proven, because no derived bound is narrower than "
            "the output's range: "
            + ", ".join(f"{port} ({bound})" for port, bound in wide.items())
            + "."
        )

    def worst(self, real: str, block: str) -> dict[str, float]:
        """Largest error per port of a Block in a format, over all streams.

        Parameters
        ----------
        real : str
            Number format.
        block : str
            Name of the Block.
        """
        out: dict[str, float] = {}
        for c in self.comparisons:
            if c.real == real and c.block == block:
                for k, e in c.errors.items():
                    out[k] = max(out.get(k, 0.0), e)
        return out

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content."""
        return {
            "device": self.device,
            "content_hash": self.content_hash,
            "passed": self.passed,
            "full_scale": self.full_scale,
            "full_scales": self.full_scales,
            "bounds_that_tell_nothing_percent": {
                k: wide for k in self.bounds if (wide := self.telling_nothing(k))
            },
            "comparisons": [
                {
                    "block": c.block,
                    "stream": c.stream,
                    "format": c.real,
                    "rule": c.rule,
                    "steps": c.steps,
                    "passed": c.passed,
                    "errors": c.errors,
                    "limits": c.limits,
                    "status_differences": c.status_differences,
                    "bit_identical_to_casadi_c": c.bit_identical,
                    "problems": c.problems,
                    "residual_Nm": None if c.residual is None else c.residual[0],
                    "residual_limit_Nm": None if c.residual is None else c.residual[1],
                    "drift_not_bounded": c.drift,
                    "steps_with_a_turned_decision": c.turned,
                    "steps_beyond_the_bounds_assumptions": c.beyond,
                }
                for c in self.comparisons
            ],
            "f32_bounds": {
                block: {
                    domain: {
                        "outputs": b.outputs,
                        "states": b.states,
                        "method": b.method,
                        "holds_for": LASTING if math.isinf(b.steps) else ONE_STEP,
                        "assumptions": list(b.assumptions),
                    }
                    for domain, b in domains.items()
                }
                for block, domains in self.bounds.items()
            },
        }
