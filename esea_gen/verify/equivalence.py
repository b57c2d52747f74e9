"""The emitted C against the symbolic Block: every output and state, at every step.

In float64 the C must be the symbolic Block to rounding, and CasADi's own C bit for bit.  In float32
it must stay within a derived bound.  Three rules, in this order:

``residual``
    The exact inverse picks a segment by comparisons and takes a root, so that intervals of its
    values mean nothing.  It is judged by what it is for: the torque that the model gives at its
    set-point, less the request.  The Block itself says what it allows there, in the flag
    NOT_CONVERGED on its output ``residual_Nm``; verification holds both formats to that limit, once
    by the Block's own residual and once by the symbolic sensor in float64, run on the Block's
    set-points (:func:`forward_residual`).
``any number of steps``
    The derived bound of a Block that forgets its errors (:func:`derive_bounds`).
``one step, from the same memory``
    For a Block that does not forget them: what each step adds is held to the bound of one step
    (:mod:`esea_gen.verify.one_step`).  How far C and symbolic Block come apart in a free run is
    told beside it, and not bounded.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import cffi
import numpy as np

from esea_gen.device import Device
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.formats.f64 import reference_c
from esea_gen.emit.ranges import Bound, RangeError, block_bound
from esea_gen.emit.render import template_folder
from esea_gen.errors import UserError
from esea_gen.hostlib.library import CRunner, HostLibrary, compile_device, compile_sources
from esea_gen.language.block import Array, Block, Flag, Port
from esea_gen.language.system import System
from esea_gen.verify.streams import Stream, inside, single, streams

if TYPE_CHECKING:
    from esea_gen.verify.one_step import StepRule

F64_TOLERANCE = 1e-12
EXACT, RESIDUAL, LASTING, ONE_STEP, EXACT_PROGRAM, STATED = RULES = (
    "CasADi's C, bit for bit",
    "residual",
    "any number of steps",
    "one step, from the same memory",
    "a program's executor, bit for bit",
    "a program's executor, a stated share of full scale",
)
# C leaves open which zero fmin(0, -0) is, and a compiler that swaps the operands changes it.  Where
# single bits are compared at such a tie, both sides call the library's function as written.
AS_WRITTEN = ("-fno-builtin-fmin", "-fno-builtin-fmax")
# Share of full scale to which a float32 Block that is judged by its residual must stay with the
# symbolic one.  Stated, not derived: over the streams the elbow's inverse stays within 3e-4.
RESIDUAL_CLOSENESS = 1e-3


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

    def worst(self, real: str, block: str) -> dict[str, float]:
        """Largest error per port of a Block in a format, over all streams.

        Parameters
        ----------
        real : str
            Number format.
        block : str
            Name of the Block.

        Returns
        -------
        dict of str to float
            Error by output port.
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


class CasadiReference:
    """CasADi's own generated C of a System's Blocks, compiled for the host.

    Parameters
    ----------
    system : System
        Whose Blocks.
    """

    def __init__(self, system: System) -> None:
        self.stem = f"esea_{system.name}_casadi"
        files = {n.removeprefix("reference/"): t for n, t in reference_c(system).items()}
        loop = template_folder() / "verify" / "reference_loop.c"
        files[loop.name] = loop.read_text(encoding="utf-8")
        path = compile_sources(files, AS_WRITTEN, ("-lm",))
        self.ffi = cffi.FFI()
        names = [f"{self.stem}_{b.name}_step" for b in system.kinds if not is_program(b)]
        self.ffi.cdef(
            "void esea_reference_run(int (*)(const double**, double**, int*, double*, int), "
            "const double**, double**, int*, double*, double*, const double*, size_t, double*, "
            "size_t, const double*, size_t, const double*, double*, double*, size_t);"
        )
        self.ffi.cdef(
            "".join(
                f"int {n}(const double**, double**, int*, double*, int);\n"
                f"int {n}_work(int*, int*, int*, int*);\n"
                for n in names
            )
        )
        self.lib: Any = self.ffi.dlopen(str(path))

    def run(
        self, block: Block, coefficients: list[Array], state: list[Array], stream: Stream
    ) -> tuple[dict[str, Array], dict[str, Array]]:
        """Run a Block's step over a stream.

        Parameters
        ----------
        block : Block
            The Block.
        coefficients, state : list of ndarray
            Prepared coefficients and initial state, per port.
        stream : Stream
            Inputs and injections.

        Returns
        -------
        outputs, states : dict of str to ndarray
            As :meth:`esea_gen.language.block.Simulator.run`.
        """
        ffi, function = self.ffi, getattr(self.lib, f"{self.stem}_{block.name}_step")
        sizes = [ffi.new("int*") for _ in range(4)]
        getattr(self.lib, f"{self.stem}_{block.name}_step_work")(*sizes)
        c, (s, u, after, y) = (
            _Cells(block.coefficients),
            map(_Cells, (block.state, block.inputs, block.state, block.outputs)),
        )

        def pointers(cells: Sequence[_Cells], count: int, kind: str) -> Any:
            found = ffi.new(f"{kind} *[{max(count, 1)}]")
            for i, part in enumerate(p for group in cells for p in group.parts):
                found[i] = ffi.cast("double *", part.ctypes.data)
            return found

        def at(values: Array) -> Any:
            return ffi.cast("double *", values.ctypes.data)

        arguments = pointers((c, s, u), sizes[0][0], "const double")
        results = pointers((after, y), sizes[1][0], "double")
        iw = ffi.new(f"int[{max(sizes[2][0], 1)}]")
        w = ffi.new(f"double[{max(sizes[3][0], 1)}]")
        given = np.concatenate(
            [
                np.asarray(stream.inputs[p.name], np.float64).reshape(stream.steps, p.size)
                for p in block.inputs
            ],
            axis=1,
        )
        out = np.empty((stream.steps, len(y.values)))
        trace = np.empty((stream.steps, len(s.values)))
        prepared = [np.array(v, dtype=np.float64) for v in coefficients]
        c.put(dict(zip(c.names, prepared, strict=True)))
        s.put(dict(zip(s.names, state, strict=True)))
        for start, stop in _segments(stream):
            if start in stream.coefficients:
                values = changed(block, prepared, stream.coefficients[start])
                c.put(dict(zip(c.names, values, strict=True)))
            s.put(stream.injections.get(start, {}))
            self.lib.esea_reference_run(
                *(function, arguments, results, iw, w),
                *(at(s.values), at(after.values), len(s.values), at(u.values), len(u.values)),
                *(at(y.values), len(y.values)),
                *(at(given[start:]), at(out[start:]), at(trace[start:]), stop - start),
            )
        return y.split(out), s.split(trace)


class _Cells:
    # The numbers of some ports, one after the other in one array.

    def __init__(self, ports: Sequence[Port]) -> None:
        self.ports, self.names = ports, [p.name for p in ports]
        ends = np.cumsum([0, *(p.size for p in ports)]).tolist()
        self.slices = [slice(a, b) for a, b in pairwise(ends)]
        self.values = np.zeros(ends[-1])
        self.parts = [self.values[x] for x in self.slices]

    def put(self, values: Mapping[str, Array]) -> None:
        for name, part in zip(self.names, self.parts, strict=True):
            if name in values:
                part[:] = values[name]

    def split(self, rows: Array) -> dict[str, Array]:
        # Columns by port.
        return {
            p.name: _flat(p, np.ascontiguousarray(rows[:, x]))
            for p, x in zip(self.ports, self.slices, strict=True)
        }


def is_program(block: object) -> bool:
    """Whether a Block of a System is a Program: kernels in loops, no step in one piece.

    Parameters
    ----------
    block : Block or Program
        What a System holds.

    Returns
    -------
    bool
        True for a Program.
    """
    return bool(getattr(block, "kernels", None))


def _flat(p: Port, a: Array) -> Array:
    return a[:, 0] if p.size == 1 else a


def changed(block: Block, prepared: list[Array], values: Mapping[str, Array]) -> list[Array]:
    """Coefficients of a Block with some put in from outside.

    Parameters
    ----------
    block : Block
        The Block.
    prepared : list of ndarray
        As prepared from its tunables, per port.
    values : mapping of str to ndarray
        What stands in the memory of some instead.

    Returns
    -------
    list of ndarray
        Per port.
    """
    return [
        np.asarray(values.get(p.name, c), dtype=c.dtype).reshape(c.shape)
        for p, c in zip(block.coefficients, prepared, strict=True)
    ]


def run_symbolic(block: Block, stream: Stream) -> tuple[dict[str, Array], dict[str, Array]]:
    """A stream through the symbolic Block.

    Parameters
    ----------
    block : Block
        The Block, at its default tunables.
    stream : Stream
        Inputs and injections.

    Returns
    -------
    outputs, states : dict of str to ndarray
        Per port.
    """
    simulator = block.simulator()
    prepared = [c.copy() for c in simulator._c]
    parts = []
    for start, stop in _segments(stream):
        if start in stream.coefficients:
            values = changed(block, prepared, stream.coefficients[start])
            for held, c in zip(simulator._c, values, strict=True):
                held[:] = c
        if start in stream.injections:
            simulator.state = stream.injections[start]
        parts.append(simulator.run({k: v[start:stop] for k, v in stream.inputs.items()}))
    return _join(parts)


def run_c(
    runner: CRunner, stream: Stream, restore: bool = False
) -> tuple[dict[str, Array], dict[str, Array]]:
    """A stream through the compiled Block.

    Parameters
    ----------
    runner : CRunner
        Freshly initialised.
    stream : Stream
        Inputs and injections.
    restore : bool
        Stop in the middle, disturb and reset the instance, put the saved state back, and go on.

    Returns
    -------
    outputs, states : dict of str to ndarray
        Per port (states without the counters' meaning, as they are).
    """
    parts = []
    bounds = _segments(stream)
    if restore:
        middle = stream.steps // 2
        bounds = [
            piece
            for a, b in bounds
            for piece in ([(a, middle), (middle, b)] if a < middle < b else [(a, b)])
        ]
    prepared = [bytes(runner.library.ffi.buffer(c)) for c in runner._coeffs]
    for start, stop in bounds:
        if start in stream.coefficients:
            _put_coefficients(runner, prepared, stream.coefficients[start])
        if start in stream.injections:
            state = runner.state
            for name, value in stream.injections[start].items():
                state[name] = value
            runner.state = state
        elif restore and start:
            saved = runner.state
            runner.run({k: v[:7] for k, v in stream.inputs.items()}, trace=False)
            runner.reset()
            runner.state = saved
        parts.append(runner.run({k: v[start:stop] for k, v in stream.inputs.items()}))
    return _join(parts)


def _put_coefficients(runner: CRunner, prepared: list[bytes], values: Mapping[str, Array]) -> None:
    for held, before in zip(runner._coeffs, prepared, strict=True):
        runner.library.ffi.buffer(held)[:] = before
        for name, value in values.items():
            elements = np.ravel(value).tolist()
            setattr(held, name, elements if len(elements) > 1 else elements[0])


def _segments(stream: Stream) -> list[tuple[int, int]]:
    cuts = sorted({0, stream.steps, *stream.injections, *stream.coefficients})
    return list(pairwise(cuts))


def _join(
    parts: list[tuple[dict[str, Array], dict[str, Array]]],
) -> tuple[dict[str, Array], dict[str, Array]]:
    def cat(k: int) -> dict[str, Array]:
        return {name: np.concatenate([p[k][name] for p in parts]) for name in parts[0][k]}

    return cat(0), cat(1)


def full_scales(device: Device, block: Block) -> dict[str, float]:
    """What counts as 100 % for each output and state of a Block.

    Parameters
    ----------
    device : Device
        Its torque full scale counts for torques at the joint, its largest motor torque for those at
        the motor shaft.
    block : Block
        The Block.

    Returns
    -------
    dict of str to float
        For a torque the smallest of that and its range's larger end; the latter for the rest.
    """
    actuator = device.file.actuator
    out = {}
    for p in (*block.outputs, *block.state):
        if p.flags:
            continue
        scale = max(abs(p.low), abs(p.high))
        if p.unit == "Nm":
            scale = min(scale, device.tau_full_scale_Nm)
            # The thesis's symbols: u_... are torques at the motor shaft, tau_... at the joint.
            if actuator is not None and p.name.startswith("u_"):
                scale = min(scale, actuator.u_max_Nm.value)
        out[p.name] = scale
    return out


def operating_ranges(device: Device, block: Block) -> dict[str, tuple[float, float]]:
    """The identified domain as ranges of a Block's inputs and states, for its tighter bound.

    Parameters
    ----------
    device : Device
        Its domain.
    block : Block
        The Block.

    Returns
    -------
    dict
        For :func:`esea_gen.emit.ranges.block_bound`; empty when the Block has none of these ports.
    """
    d = device.file.domain
    theta, omega = d.theta_max_rad.value, d.omega_max_rad_s.value
    ranges = {
        "u_theta_rad": theta,
        "s_theta_prev_rad": theta,
        "u_omega_rad_s": omega,
        "s_tau_r_Nm": device.tau_full_scale_Nm,
    }
    names = {f"u_{p.name}" for p in block.inputs} | {f"s_{p.name}" for p in block.state}
    return {k: (-v, v) for k, v in ranges.items() if k in names}


def residual_flag(block: Block) -> Flag | None:
    """The flag by which a Block says that its residual is too large.

    Parameters
    ----------
    block : Block
        Any Block.

    Returns
    -------
    Flag or None
        Its ``NOT_CONVERGED``, where that looks at the output ``residual_Nm`` alone and the Block
        turns a torque into a deflection and the rate that goes with it; None for any other Block,
        which then needs a derived bound.
    """
    outputs = {p.name for p in block.outputs}
    if [p.name for p in block.inputs] != ["tau_Nm"] or not outputs >= {
        *("theta_rad", "omega_mid_rad_s", "residual_Nm")
    }:
        return None
    port = block.status_port
    for flag in port.flags if port else ():
        if flag.name == "NOT_CONVERGED" and flag.compares == ("residual_Nm",):
            return flag
    return None


def forward_residual(
    device: Device, block: Block, stream: Stream, outputs: Mapping[str, Array]
) -> tuple[float, float]:
    """How far the torque at an inverse's set-points is from the request, said and computed.

    Parameters
    ----------
    device : Device
        Whose symbolic sensor, in float64, is run on the set-points and their rates.
    block : Block
        The inverse.
    stream : Stream
        Its requests.
    outputs : mapping of str to ndarray
        What its C made of them.

    Returns
    -------
    said, computed : float
        Largest |residual| by the Block's own output, and by the sensor (0 where states were put in
        from outside: the sensor then has another memory).  Left out are steps in which the Block
        says that the request was invalid or cannot be reached.
    """
    port = block.status_port
    assert port is not None
    bits = {f.name: 1 << i for i, f in enumerate(port.flags)}
    status = outputs[port.name].astype(np.int64)
    valid = status & bits["INPUT_INVALID"] == 0
    free = valid & (status & bits["REQUEST_CLAMPED"] == 0)
    said = np.abs(outputs["residual_Nm"].astype(np.float64))[free]
    computed = np.zeros(0)
    if not stream.injections and np.any(valid):
        # Before its first valid request the inverse has no memory; the sensor starts with it.
        start = int(np.argmax(valid))
        y, _ = device.sensor.simulator().run(
            {
                "theta_rad": outputs["theta_rad"][start:],
                "omega_rad_s": outputs["omega_mid_rad_s"][start:],
            }
        )
        missed = np.abs(y["tau_Nm"] - stream.inputs["tau_Nm"][start:])
        computed = missed[free[start:]]
    return float(np.max(said, initial=0.0)), float(np.max(computed, initial=0.0))


def derive_bounds(device: Device, block: Block) -> dict[str, Bound]:
    """A Block's float32 bounds against float64: over its ports' ranges, and over the domain.

    Parameters
    ----------
    device : Device
        The device.
    block : Block
        Its Block.

    Returns
    -------
    dict of str to Bound
        ``port ranges`` and ``identified domain``; both hold for any number of steps.  Empty for a
        Block that is judged by its residual.

    Raises
    ------
    RangeError
        For a Block whose errors may grow without limit: :func:`step_rule`.
    """
    if residual_flag(block) is not None:
        return {}
    out: dict[str, Bound] = {}
    for name, ranges in (
        ("port ranges", {}),
        ("identified domain", operating_ranges(device, block)),
    ):
        if out and not ranges:  # nothing that the domain narrows
            out[name] = out["port ranges"]
            continue
        single = block_bound(block, FORMATS["f32"], ranges)
        double = block_bound(block, FORMATS["f64"], ranges)
        out[name] = Bound(
            "f32",
            single.steps,
            {k: v + double.outputs[k] for k, v in single.outputs.items()},
            {k: v + double.states[k] for k, v in single.states.items()},
            single.method,
            single.assumptions,
        )
    return out


def step_rule(block: Block) -> StepRule:
    """The rule "one step, from the same memory" of a Block.

    Parameters
    ----------
    block : Block
        A Block that :func:`derive_bounds` refuses.

    Returns
    -------
    StepRule
        For :func:`compare`.

    Raises
    ------
    RangeError
        When not even one step has a finite bound.
    """
    from esea_gen.verify.one_step import StepRule

    return StepRule(block)


def compare(
    device: Device,
    block: Block,
    library: HostLibrary,
    stream: Stream,
    bounds: dict[str, Bound],
    reference: CasadiReference | None,
    rule: StepRule | None = None,
    expected: tuple[dict[str, Array], dict[str, Array]] | None = None,
) -> Comparison:
    """Compare one Block on one stream.

    Parameters
    ----------
    device : Device
        For full scales.
    block : Block
        The Block.
    library : HostLibrary
        Its C.
    stream : Stream
        What to run.
    bounds : dict of str to Bound
        For f32, from :func:`derive_bounds`; empty for a Block that is judged by its residual.
    reference : CasadiReference or None
        For f64: CasADi's own C.
    rule : StepRule, optional
        For f32: compare one step at a time, from the same memory, instead of by ``bounds``.
    expected : tuple of dict, optional
        What :func:`run_symbolic` gives, where it is known already.

    Returns
    -------
    Comparison
        What was found.
    """
    expected_y, expected_s = expected or run_symbolic(block, stream)
    got_y, got_s = run_c(library.block(block.name), stream)
    scale = full_scales(device, block)
    judge = residual_flag(block)
    kind = EXACT
    if library.real == "f64":
        limits = {k: F64_TOLERANCE * v for k, v in scale.items()}
    elif rule is not None:
        kind, limits = ONE_STEP, rule.bound.states | rule.bound.outputs
    elif judge is not None:
        kind, limits = RESIDUAL, {k: RESIDUAL_CLOSENESS * v for k, v in scale.items()}
    else:
        kind = LASTING
        ranges = operating_ranges(device, block)
        within = (
            not stream.injections
            and inside(stream, {k[2:]: v for k, v in ranges.items() if k.startswith("u_")})
            and all(
                bool(np.all(np.abs(expected_s[k[2:]]) <= v[1]))
                for k, v in ranges.items()
                if k.startswith("s_")
            )
        )
        bound = bounds["identified domain" if within else "port ranges"]
        limits = bound.states | bound.outputs
    result = Comparison(block.name, stream.name, library.real, stream.steps, {}, limits, rule=kind)
    if kind == ONE_STEP and rule is not None:
        _compare_steps(rule, stream, (expected_y, expected_s), (got_y, got_s), result)
    for ports, wanted, got in (
        (block.outputs, expected_y, got_y),
        (block.state, expected_s, got_s),
    ):
        for p in ports if kind != ONE_STEP else ():
            if p.flags:
                result.status_differences += _unexplained(p, wanted[p.name], got, wanted, limits)
                continue
            c = np.asarray(got[p.name], dtype=np.float64)
            if not np.all(np.isfinite(c)):
                result.problems.append(f"{p.name} is not finite")
                continue
            error = float(np.max(np.abs(c - wanted[p.name]), initial=0.0))
            # A state and an output may share a name: keep the worse.
            result.errors[p.name] = max(error, result.errors.get(p.name, 0.0))
            if error > limits[p.name]:
                result.problems.append(f"{p.name}: error {error:.3g} above {limits[p.name]:.3g}")
    if judge is not None:
        for way, size in zip(
            ("by its own output", "by the symbolic sensor"),
            forward_residual(device, block, stream, got_y),
            strict=True,
        ):
            result.residual = (max(size, (result.residual or (0.0,))[0]), judge.threshold)
            # A NaN is above every limit.
            if not size <= judge.threshold:
                result.problems.append(
                    f"residual, {way}: {size:.3g} Nm above {judge.threshold:.3g} Nm"
                )
    if not stream.injections and _repaired(block, got_y):
        result.problems.append("the state was judged corrupt although nobody touched it")
    if reference is not None:
        result.bit_identical = _same_bits(block, reference, stream, got_y, got_s)
    again_y, again_s = run_c(library.block(block.name), stream, restore=True)
    for p, a, b in [(p, got_y, again_y) for p in block.outputs] + [
        (p, got_s, again_s) for p in block.state
    ]:
        if a[p.name].tobytes() != b[p.name].tobytes():
            result.problems.append(f"{p.name}: stop and restore changes it")
    return result


def _compare_steps(
    rule: StepRule,
    stream: Stream,
    expected: tuple[dict[str, Array], dict[str, Array]],
    got: tuple[dict[str, Array], dict[str, Array]],
    result: Comparison,
) -> None:
    from esea_gen.verify.one_step import drift

    found = rule.compare(stream, *got)
    result.errors, result.turned = found.errors, found.turned
    result.problems += found.problems
    for a, b in zip(expected, got, strict=True):
        for name, value in drift(rule.block, a, b).items():
            result.drift[name] = max(value, result.drift.get(name, 0.0))
    for p in (*rule.block.outputs, *rule.block.state):
        values = got[0] if p in rule.block.outputs else got[1]
        if not np.all(np.isfinite(np.asarray(values[p.name], dtype=float))):
            result.problems.append(f"{p.name} is not finite")


def _repaired(block: Block, outputs: dict[str, Array]) -> bool:
    # A clip a hair beyond a guard would restart the Block every time it acts.
    port = block.status_port
    names = [f.name for f in port.flags] if port else []
    if port is None or "STATE_REPAIRED" not in names:
        return False
    return bool(np.any(outputs[port.name].astype(np.int64) >> names.index("STATE_REPAIRED") & 1))


def _unexplained(
    port: Port, expected: Array, got: dict[str, Array], values: dict[str, Array], limits: Any
) -> int:
    # A bit decided by a computed value may differ where that value is within its error of the
    # threshold; every other difference counts.
    difference = expected.astype(np.int64) ^ got[port.name].astype(np.int64)
    wrong = np.zeros(len(difference), dtype=bool)
    for i, flag in enumerate(port.flags):
        changed = (difference >> i) & 1 == 1
        near = np.zeros(len(difference), dtype=bool)
        for name in flag.compares:
            near |= np.abs(np.abs(values[name]) - flag.threshold) <= limits[name]
        wrong |= changed & ~near
    return int(wrong.sum())


def _same_bits(
    block: Block,
    reference: CasadiReference,
    stream: Stream,
    y: dict[str, Array],
    s: dict[str, Array],
) -> bool:
    simulator = block.simulator()
    coefficients = list(simulator.coefficients.values())
    ref_y, ref_s = reference.run(block, coefficients, list(simulator.state.values()), stream)
    same = all(
        y[p.name].astype(np.float64).tobytes() == ref_y[p.name].tobytes() for p in block.outputs
    )
    return same and all(s[p.name].tobytes() == ref_s[p.name].tobytes() for p in block.state)


def domain_chirp(device: Device, duration_s: float = 8.0) -> Array:
    """A deflection chirp that stays inside the identified domain.

    Parameters
    ----------
    device : Device
        Its domain and rate.
    duration_s : float
        Length.

    Returns
    -------
    ndarray
        Deflection, shape (steps,), float32 numbers.
    """
    theta = 0.95 * device.file.domain.theta_max_rad.value
    rate = 0.8 * device.file.domain.omega_max_rad_s.value
    t = np.arange(0.0, duration_s, device.period_s)
    top_Hz = rate / (2 * np.pi * theta)
    return single(theta * np.sin(np.pi * top_Hz * t * t / duration_s))


def recorded_stream(device: Device, theta_rad: Array, name: str = "recorded") -> dict[str, Stream]:
    """A recorded deflection as a stream for each Block, wired as in the System.

    Parameters
    ----------
    device : Device
        The device.
    theta_rad : ndarray
        Deflection at the sensing rate, shape (steps,).
    name : str
        Name of the stream.

    Returns
    -------
    dict of str to Stream
        By Block name.
    """
    theta = single(theta_rad)
    rates, _ = device.velocity.simulator().run({"theta_rad": theta})
    return {
        "velocity": Stream(name, {"theta_rad": theta}),
        "sensor": Stream(
            name, {"theta_rad": theta, "omega_rad_s": single(rates["omega_mid_rad_s"])}
        ),
    }


def chosen_blocks(device: Device, names: Sequence[str] | None) -> list[Block]:
    """Blocks of a device by name.

    Parameters
    ----------
    device : Device
        The device.
    names : sequence of str or None
        Their names; all without any.

    Returns
    -------
    list of Block
        In the System's order.

    Raises
    ------
    UserError
        For a name that none of them has.
    """
    known = {b.name: b for b in device.system.kinds}
    for name in names or ():
        if name not in known:
            raise UserError(
                f"{device.origin}: there is no Block '{name}'.", f"Choose from {', '.join(known)}."
            )
    return [b for n, b in known.items() if not names or n in names]


def verify(
    device: Device,
    reals: Iterable[str] = ("f64", "f32"),
    recorded: dict[str, Array] | None = None,
    seed: int = 1,
    progress: Callable[[str], None] | None = None,
    blocks: Sequence[str] | None = None,
) -> Verification:
    """Verify the Blocks of a device in every number format.

    Parameters
    ----------
    device : Device
        The device.
    reals : iterable of str
        Number formats.
    recorded : dict of str to ndarray, optional
        Recorded deflections at the sensing rate, by name.
    seed : int
        Seed of the random streams.
    progress : callable, optional
        Told in words what is being done.
    blocks : sequence of str, optional
        Only these; without it, all.

    Returns
    -------
    Verification
        Every comparison.

    Raises
    ------
    UserError
        For a Block that the device has not.
    """
    from esea_gen.emit.build import device_hash

    # Late: it takes Comparison from here.
    from esea_gen.verify.program import compare_program, program_streams, run_executor

    every = chosen_blocks(device, blocks)
    chosen = [b for b in every if not is_program(b)]
    say = progress or (lambda _: None)
    comparisons: list[Comparison] = []
    programs: dict[str, Any] = {b.name: b for b in every if is_program(b)}
    bounds: dict[str, dict[str, Bound]] = {}
    deflections = {"chirp in the domain": domain_chirp(device)} | (recorded or {})
    extra = [recorded_stream(device, theta, name) for name, theta in deflections.items()]
    tried = {
        b.name: streams(b, seed) + [e[b.name] for e in extra if b.name in e] for b in chosen
    } | {name: program_streams(p, seed) for name, p in programs.items()}
    scales = {b.name: full_scales(device, b) for b in every}
    known: dict[tuple[str, int], tuple[dict[str, Array], dict[str, Array]]] = {}
    for real in reals:
        library = compile_device(device, real)
        reference = CasadiReference(device.system) if real == "f64" else None
        for name, program in programs.items():
            for k, stream in enumerate(tried[name]):
                say(f"{name}, {real}: {stream.name}")
                if (name, k) not in known:
                    known[name, k] = run_executor(program, stream)
                comparisons.append(
                    compare_program(device, program, library, stream, known[name, k])
                )
        for block in chosen:
            rule = None
            if real == "f32":
                say(f"deriving the float32 bound of {block.name}")
                derived, rule = bounds_or_rule(device, block)
                if derived:
                    bounds[block.name] = derived
            for k, stream in enumerate(tried[block.name]):
                say(f"{block.name}, {real}: {stream.name}")
                if (block.name, k) not in known:
                    known[block.name, k] = run_symbolic(block, stream)
                comparisons.append(
                    compare(
                        device,
                        block,
                        library,
                        stream,
                        bounds.get(block.name, {}),
                        reference,
                        rule,
                        known[block.name, k],
                    )
                )
    smallest: dict[str, float] = {}
    for own in scales.values():
        for name, value in own.items():
            smallest[name] = min(value, smallest.get(name, value))
    return Verification(device.name, device_hash(device), comparisons, bounds, smallest, scales)


def bounds_or_rule(device: Device, block: Block) -> tuple[dict[str, Bound], StepRule | None]:
    """How a Block's float32 is judged: a bound for any number of steps, or what one step adds.

    Parameters
    ----------
    device : Device
        The device.
    block : Block
        Its Block.

    Returns
    -------
    bounds : dict of str to Bound
        Of :func:`derive_bounds`, or that of one step; empty for a Block judged by its residual.
    rule : StepRule or None
        None for a Block with a bound for any number of steps.

    Raises
    ------
    UserError
        When not even one step has a finite bound.
    """
    try:
        return derive_bounds(device, block), None
    except RangeError:
        pass
    try:
        rule = step_rule(block)
    except RangeError as error:
        raise UserError(
            f"{device.origin}: no finite float32 bound can be derived for {block.name}, not even "
            f"of one step ({error}).",
            "Narrow the ranges under [limits], or raise the offsets eps1 and eps2; --real f64 "
            "verifies the float64 C alone.",
        ) from error
    return {ONE_STEP: rule.bound}, rule


__all__ = ["CasadiReference", "Comparison", "Verification", "compare", "step_rule", "verify"]
