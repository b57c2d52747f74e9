"""The emitted C against the symbolic Block: every output and state, at every step.

In float64 the C must equal the symbolic Block to rounding, and CasADi's own C bit for bit.  In
float32 it must stay within a derived bound.  Three rules, in this order:

``residual``
    Of the exact inverse, whose comparisons and root give intervals no meaning: the model's torque
    at its set-point, less the request, by the Block's own output and by the symbolic sensor
    (:func:`~esea_gen.verify.bounds.forward_residual`), within the limit of its NOT_CONVERGED.
``any number of steps``
    The bound of a Block that forgets its errors.  Where a run breaks what a linear Block's assumes
    (``verify.bounds.steps_beyond``), it fails, or, if its stream is declared rough, is judged by:
``one step, from the same memory``
    What each step adds (:mod:`esea_gen.verify.one_step`).  The deviation of a free run is
    reported, not bounded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from esea_gen.device import Device
from esea_gen.emit.build import device_hash
from esea_gen.emit.step_errors import Bound
from esea_gen.errors import UserError, nearest
from esea_gen.hostlib.library import compile_device
from esea_gen.language.ports import Array
from esea_gen.language.stream import Stream
from esea_gen.verify.bounds import UNTRIED, bounds_or_rule, full_scales
from esea_gen.verify.compare import compare, compare_program, program_streams
from esea_gen.verify.executor import held_stream
from esea_gen.verify.runs import CasadiOracle, Run, run_executor, run_symbolic
from esea_gen.verify.streams import domain_chirp, recorded_stream, streams
from esea_gen.verify.verdict import Comparison, Verification


def chosen_blocks(device: Device, names: Sequence[str] | None) -> list[Any]:
    """Blocks of a device by name, in the System's order; a name that none has is refused.

    Parameters
    ----------
    device : Device
        Whose.
    names : sequence of str or None
        All without any.
    """
    known = {b.name: b for b in device.system.kinds}
    for name in names or ():
        if name not in known:
            raise UserError(
                f"{device.origin}: there is no Block '{name}'.",
                f"{nearest(name, known)}Choose from {', '.join(known)}.",
            )
    return [b for n, b in known.items() if not names or n in names]


def _tried(
    device: Device, blocks: Sequence[Any], recorded: dict[str, Array] | None, seed: int
) -> dict[str, list[Stream]]:
    # Every stream by Block.
    deflections = {"chirp in the domain": domain_chirp(device)} | (recorded or {})
    extra = [recorded_stream(device, theta, name) for name, theta in deflections.items()]
    found = {}
    for block in blocks:
        if block.kind == "program":
            found[block.name] = program_streams(block, seed)
        else:
            found[block.name] = streams(block, seed)
            found[block.name] += [e[block.name] for e in extra if block.name in e]
            found[block.name] = [held_stream(block, s) for s in found[block.name]]
    return found


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
    chosen = chosen_blocks(device, blocks)
    say = progress or (lambda _: None)
    comparisons: list[Comparison] = []
    bounds: dict[str, dict[str, Bound]] = {}
    tried = _tried(device, chosen, recorded, seed)
    known: dict[tuple[str, int], Run] = {}
    for real in reals:
        library = compile_device(device, real)
        oracle = CasadiOracle(device.system) if real == "f64" else None
        for block in sorted(chosen, key=lambda b: b.kind != "program"):
            program, rule = block.kind == "program", None
            if real == "f32" and not program:
                say(f"deriving the float32 bound of {block.name}")
                derived, rule = bounds_or_rule(device, block)
                if derived:
                    bounds[block.name] = derived
            held, own = bounds.get(block.name, {}), list[Comparison]()
            for k, stream in enumerate(tried[block.name]):
                say(f"{block.name}, {real}: {stream.name}")
                if (block.name, k) not in known:
                    run = run_executor if program else run_symbolic
                    known[block.name, k] = run(block, stream)
                expected = known[block.name, k]
                own.append(
                    compare_program(device, block, library, stream, expected)
                    if program
                    else compare(device, block, library, stream, held, oracle, rule, expected)
                )
            if all(c.beyond for c in own):
                own[0].problems.append(UNTRIED)
            comparisons += own
    scales = {b.name: full_scales(device, b) for b in chosen}
    smallest: dict[str, float] = {}
    for each in scales.values():
        for name, value in each.items():
            smallest[name] = min(value, smallest.get(name, value))
    return Verification(device.name, device_hash(device), comparisons, bounds, smallest, scales)
