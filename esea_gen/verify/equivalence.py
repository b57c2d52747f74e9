"""The emitted C against the symbolic Block: every output and state, at every step."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import cffi
import numpy as np

from esea_gen.block import Array, Block, Port
from esea_gen.device import Device
from esea_gen.emit.formats import FORMATS
from esea_gen.emit.ranges import Bound, RangeError, block_bound
from esea_gen.emit.render import reference_c
from esea_gen.errors import UserError
from esea_gen.hostlib.library import CRunner, HostLibrary, compile_device, compile_sources
from esea_gen.system import System
from esea_gen.verify.streams import Stream, inside, single, streams

F64_TOLERANCE = 1e-12


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
        Derived worst-case errors: ``{block: {domain: Bound}}`` for f32.
    full_scale : dict of str to float
        Per port name, what counts as 100 %.
    """

    device: str
    content_hash: str
    comparisons: list[Comparison]
    bounds: dict[str, dict[str, Bound]]
    full_scale: dict[str, float]

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
            "comparisons": [
                {
                    "block": c.block,
                    "stream": c.stream,
                    "format": c.real,
                    "steps": c.steps,
                    "passed": c.passed,
                    "errors": c.errors,
                    "limits": c.limits,
                    "status_differences": c.status_differences,
                    "bit_identical_to_casadi_c": c.bit_identical,
                    "problems": c.problems,
                }
                for c in self.comparisons
            ],
            "f32_bounds": {
                block: {
                    domain: {
                        "outputs": b.outputs,
                        "states": b.states,
                        "method": b.method,
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
        path = compile_sources(files, (), ("-lm",))
        self.ffi = cffi.FFI()
        names = [f"{self.stem}_{b.name}_step" for b in system.kinds]
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
            As :meth:`esea_gen.block.Simulator.run`.
        """
        ffi, function = self.ffi, getattr(self.lib, f"{self.stem}_{block.name}_step")
        sizes = [ffi.new("int*") for _ in range(4)]
        getattr(self.lib, f"{self.stem}_{block.name}_step_work")(*sizes)
        u = [np.zeros(p.size) for p in block.inputs]
        s = [a.copy() for a in state]
        after = [np.zeros(p.size) for p in block.state]
        y = [np.zeros(p.size) for p in block.outputs]

        def pointers(arrays: list[Array], count: int, kind: str) -> Any:
            cells = ffi.new(f"{kind} *[{max(count, 1)}]")
            for i, a in enumerate(arrays):
                cells[i] = ffi.cast("double *", a.ctypes.data)
            return cells

        arguments = pointers([*coefficients, *s, *u], sizes[0][0], "const double")
        results = pointers([*after, *y], sizes[1][0], "double")
        iw = ffi.new(f"int[{max(sizes[2][0], 1)}]")
        w = ffi.new(f"double[{max(sizes[3][0], 1)}]")
        columns = [stream.inputs[p.name].reshape(stream.steps, -1) for p in block.inputs]
        outs = [np.empty((stream.steps, p.size)) for p in block.outputs]
        trace = [np.empty((stream.steps, p.size)) for p in block.state]
        for k in range(stream.steps):
            for p, a in zip(block.state, s, strict=True):
                if p.name in stream.injections.get(k, {}):
                    a[:] = stream.injections[k][p.name]
            for a, c in zip(u, columns, strict=True):
                a[:] = c[k]
            function(arguments, results, iw, w, 0)
            for store, a in zip(outs, y, strict=True):
                store[k] = a
            for store, a, b in zip(trace, s, after, strict=True):
                a[:] = b
                store[k] = b
        return (
            {p.name: _flat(p, a) for p, a in zip(block.outputs, outs, strict=True)},
            {p.name: _flat(p, a) for p, a in zip(block.state, trace, strict=True)},
        )


def _flat(p: Port, a: Array) -> Array:
    return a[:, 0] if p.size == 1 else a


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
    parts = []
    for start, stop in _segments(stream):
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
    for start, stop in bounds:
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


def _segments(stream: Stream) -> list[tuple[int, int]]:
    cuts = sorted({0, stream.steps, *stream.injections})
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
        Its torque full scale counts for torques.
    block : Block
        The Block.

    Returns
    -------
    dict of str to float
        Torque full scale for torques, the range's larger end for the rest.
    """
    return {
        p.name: device.tau_full_scale_Nm if p.unit == "Nm" else max(abs(p.low), abs(p.high))
        for p in (*block.outputs, *block.state)
        if not p.flags
    }


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
        ``port ranges`` and ``identified domain``; both hold for any number of steps.
    """
    out = {}
    for name, ranges in (
        ("port ranges", {}),
        ("identified domain", operating_ranges(device, block)),
    ):
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


def compare(
    device: Device,
    block: Block,
    library: HostLibrary,
    stream: Stream,
    bounds: dict[str, Bound],
    reference: CasadiReference | None,
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
        For f32, from :func:`derive_bounds`.
    reference : CasadiReference or None
        For f64: CasADi's own C.

    Returns
    -------
    Comparison
        What was found.
    """
    expected_y, expected_s = run_symbolic(block, stream)
    got_y, got_s = run_c(library.block(block.name), stream)
    scale = full_scales(device, block)
    if library.real == "f64":
        limits = {k: F64_TOLERANCE * v for k, v in scale.items()}
    else:
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
    result = Comparison(block.name, stream.name, library.real, stream.steps, {}, limits)
    for ports, expected, got in (
        (block.outputs, expected_y, got_y),
        (block.state, expected_s, got_s),
    ):
        for p in ports:
            if p.flags:
                result.status_differences += _unexplained(
                    p, expected[p.name], got, expected, limits
                )
                continue
            c = np.asarray(got[p.name], dtype=np.float64)
            if not np.all(np.isfinite(c)):
                result.problems.append(f"{p.name} is not finite")
                continue
            error = float(np.max(np.abs(c - expected[p.name]), initial=0.0))
            # A state and an output may share a name: keep the worse.
            result.errors[p.name] = max(error, result.errors.get(p.name, 0.0))
            if error > limits[p.name]:
                result.problems.append(f"{p.name}: error {error:.3g} above {limits[p.name]:.3g}")
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


def verify(
    device: Device,
    reals: Iterable[str] = ("f64", "f32"),
    recorded: dict[str, Array] | None = None,
    seed: int = 1,
    progress: Callable[[str], None] | None = None,
) -> Verification:
    """Verify every Block of a device in every number format.

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

    Returns
    -------
    Verification
        Every comparison.
    """
    from esea_gen.emit.build import device_hash

    say = progress or (lambda _: None)
    comparisons, bounds = [], {}
    scales: dict[str, float] = {}
    deflections = {"chirp in the domain": domain_chirp(device)} | (recorded or {})
    extra = [recorded_stream(device, theta, name) for name, theta in deflections.items()]
    tried = {
        b.name: streams(b, seed) + [e[b.name] for e in extra if b.name in e]
        for b in device.system.kinds
    }
    for real in reals:
        library = compile_device(device, real)
        reference = CasadiReference(device.system) if real == "f64" else None
        for block in device.system.kinds:
            scales |= full_scales(device, block)
            if real == "f32":
                say(f"deriving the float32 bound of {block.name}")
                try:
                    bounds[block.name] = derive_bounds(device, block)
                except RangeError as error:
                    raise UserError(
                        f"{device.origin}: no finite float32 bound can be derived for "
                        f"{block.name} ({error}).",
                        "Narrow the ranges under [limits], or raise the offsets eps1 and eps2; "
                        "--real f64 verifies the float64 C alone.",
                    ) from error
            for stream in tried[block.name]:
                say(f"{block.name}, {real}: {stream.name}")
                comparisons.append(
                    compare(device, block, library, stream, bounds.get(block.name, {}), reference)
                )
    return Verification(device.name, device_hash(device), comparisons, bounds, scales)


__all__ = ["CasadiReference", "Comparison", "Verification", "compare", "verify"]
