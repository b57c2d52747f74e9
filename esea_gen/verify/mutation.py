"""Mutation of the emitted C, to see whether the comparisons see a wrong operator or constant.

Each mutant is the emitted file of one Block, or of the device, with one place changed.  It is
compiled, loaded, and held against the same expectation as the C that ships: CasADi's own C in f64,
the NumPy executor (:mod:`esea_gen.verify.executor`) in f32, every bit of every output, state and
counter.  A mutant that no stream tells apart survives.  One is set aside as equivalent only with a
proof that names a fact of ranges or logic; the rest of the survivors are listed.
"""

from __future__ import annotations

import copy
import hashlib
import math
import random
import re
import subprocess
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from esea_gen.device import Device
from esea_gen.emit.build import device_hash
from esea_gen.emit.formats import FLOATING_FORMATS, FORMATS, Format
from esea_gen.emit.formats.floating import LOGICAL, SELECTING
from esea_gen.emit.ranges import Bound, whole_nodes
from esea_gen.emit.render import Renderer
from esea_gen.emit.walker import Kernel, fuse_selects
from esea_gen.errors import UserError
from esea_gen.hostlib.compiler import find_compiler
from esea_gen.hostlib.library import HostLibrary, compile_device
from esea_gen.hostlib.runner import CBoard, CRunner
from esea_gen.language.block import Block
from esea_gen.language.ports import Array
from esea_gen.language.stream import Stream, single
from esea_gen.language.system import System
from esea_gen.verify.bounds import bounds_or_rule
from esea_gen.verify.compare import compare, unexplained
from esea_gen.verify.coverage import recorded_arguments
from esea_gen.verify.equivalence import chosen_blocks
from esea_gen.verify.executor import (
    Trajectory,
    coefficients_of,
    emitted_kernel,
    exact_trajectory,
    expected_setup,
    float32_reference,
    initial_state,
    setup_difference,
)
from esea_gen.verify.memories import other_memories
from esea_gen.verify.one_step import StepRule
from esea_gen.verify.runs import AS_WRITTEN, CasadiReference, run_c, run_symbolic
from esea_gen.verify.streams import (
    at_the_limits,
    domain_chirp,
    recorded_stream,
    streams,
    working_inputs,
)
from esea_gen.verify.unreachable import guarded_ranges, imply

# Fast to compile; without optimisation float arithmetic has the same bits.
MUTANT_FLAGS = ("-std=c99", "-O0", "-ffp-contract=off", "-fPIC", "-w")
REQUIRED_SCORE = 0.95

_NUMBER = re.compile(r"(?<![\w.])\d+\.\d*(?:e[-+]?\d+)?f?(?![\w.])")
_OPERATOR = re.compile(r" (\+|-|\*|/|<=|<|>=|>|&&|\|\|) ")
_SIGNED = re.compile(rf"\(?-?{_NUMBER.pattern}\)?")
# A value by name, compared with a constant, on either side.
_COMPARISON = re.compile(
    rf"(?P<low>{_SIGNED.pattern}) <=? (?P<right>[A-Za-z_]\w*)\b(?!\()"
    rf"|(?<![\w>.])(?P<left>[A-Za-z_]\w*) <=? (?P<high>{_SIGNED.pattern})"
)
# A choice with a constant, or a sum with one.
_CHOICE = re.compile(
    r"const \w+ (?P<name>\w+) = (?P<head>.*\? |)(?P<one>[^?:+]*)(?: : | \+ )(?P<other>[^?:+]*);$"
)
_SWAPS = {
    "+": ("-",),
    "-": ("+",),
    "*": ("/",),
    "/": ("*",),
    "<=": ("<", ">="),
    "<": ("<=", ">="),
    ">=": (">", "<="),
    "&&": ("||",),
    "||": ("&&",),
}


@dataclass(frozen=True)
class Mutant:
    """The emitted C with one place changed."""

    file: str
    line: int
    kind: str
    before: str
    after: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.kind}: {self.before}  ->  {self.after}"

    def apply(self, text: str) -> str:
        """The file's text with the mutation."""
        lines = text.split("\n")
        if lines[self.line - 1].strip() != self.before:
            raise ValueError(f"{self.file}:{self.line} is not '{self.before}'")
        lines[self.line - 1] = self.after
        return "\n".join(lines)


@dataclass
class MutationReport:
    """What became of the mutants.

    rejected: mutants that the compiler refused; not counted anywhere else.
    killed: mutants told apart by some stream, bit for bit.
    killed_by_bound: of these, how many the looser criterion sees too: 1e-12 of full scale in f64,
        the derived bound in f32. None in a sample: deriving the bound takes longer than the sample.
    equivalent: survivors proven to compute the same, with the proof.
    kinds: killed and tried per kind.
    contradicted: mutants that were killed although there is a proof that they compute the same: a
        fault of the prover. Left out are proofs that rest on whole numbers, where a stream that
        aims at thresholds has put in others.
    """

    device: str
    real: str
    tried: int = 0
    rejected: int = 0
    killed: int = 0
    killed_by_bound: int | None = None
    equivalent: list[tuple[Mutant, str]] = field(default_factory=list)
    survivors: list[Mutant] = field(default_factory=list)
    kinds: dict[str, tuple[int, int]] = field(default_factory=dict)
    contradicted: list[tuple[Mutant, str]] = field(default_factory=list)

    @property
    def score(self) -> float:
        """Share killed of all mutants not proven equivalent."""
        counted = self.tried - len(self.equivalent)
        return self.killed / counted if counted else 1.0

    @property
    def raw_score(self) -> float:
        """Share killed of all mutants, equivalent ones included."""
        return self.killed / self.tried if self.tried else 1.0

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready content."""
        return {
            "device": self.device,
            "format": self.real,
            "tried": self.tried,
            "rejected_by_compiler": self.rejected,
            "killed": self.killed,
            "killed_by_bound_alone": self.killed_by_bound,
            "score": self.score,
            "raw_score": self.raw_score,
            "required_score": REQUIRED_SCORE,
            "equivalent": [{"mutant": str(m), "proof": p} for m, p in self.equivalent],
            "survivors": [str(m) for m in self.survivors],
            "contradicted": [{"mutant": str(m), "proof": p} for m, p in self.contradicted],
            "kinds": {k: {"killed": a, "tried": b} for k, (a, b) in sorted(self.kinds.items())},
        }


def _value(text: str) -> float:
    # A constant of the C, with its sign.
    return float(text.strip("()").rstrip("f"))


def _calls(text: str, name: str) -> Iterator[tuple[int, int, list[str]]]:
    # Start, end and arguments of every call of a function in an expression.
    for found in re.finditer(rf"\b{name}\(", text):
        depth, start, args = 1, found.end(), []
        for i in range(found.end(), len(text)):
            depth += {"(": 1, ")": -1}.get(text[i], 0)
            if (text[i] == "," and depth == 1) or depth == 0:
                args.append(text[start:i].strip())
                start = i + 1
            if depth == 0:
                yield found.start(), i + 1, args
                break


def _number(text: str, fmt: Format) -> tuple[list[tuple[str, str]], float]:
    kind = fmt.dtype.type
    value = kind(text.rstrip("f"))
    if value == 0:
        changed = [("constant off by one", kind(1))]
    else:
        changed = [
            ("constant off by 1 %", kind(value * kind(1.01))),
            ("constant off by 1 ulp", np.nextafter(value, kind(np.inf))),
        ]
    return [(name, fmt.literal(float(v))) for name, v in changed], float(value)


def _expression_mutants(code: str, fmt: Format) -> Iterator[tuple[str, str]]:
    def put(start: int, end: int, new: str) -> str:
        return code[:start] + new + code[end:]

    begin = code.index("=") + 1 if "=" in code else 0
    begin = code.index("return") if code.startswith("return") else begin
    for found in _OPERATOR.finditer(code, begin):
        for other in _SWAPS.get(found.group(1), ()):
            yield f"{found.group(1)} to {other}", put(found.start(1), found.end(1), other)
    for name, other in (("esea_fmin", "esea_fmax"), ("esea_fmax", "esea_fmin")):
        for start, end, args in _calls(code, name):
            yield f"{name} to {other}", put(start, start + len(name), other)
            yield f"{name} dropped", put(start, end, args[0])
            yield f"{name} always clips", put(start, end, args[1])
    for found in re.finditer(r" << (\d+)\)", code):
        yield "status bit moved", put(found.start(1), found.end(1), str(int(found.group(1)) + 1))
    for found in re.finditer(r" (\|) ", code):
        yield "| to &", put(found.start(1), found.end(1), "&")
    for start, end, args in _calls(code, "esea_fabs"):
        yield "esea_fabs dropped", put(start, end, args[0])
    for found in re.finditer(r"(?<=[(= ])!(?=[\w(])", code):
        yield "! dropped", put(found.start(), found.end(), "")
    for found in re.finditer(r"\(-(?=\d)", code):
        yield "sign of a constant", put(found.start(), found.end(), "(")
    for found in re.finditer(r"INT32_C\((\d+)\)", code):
        for name, v in (
            ("exponent off by 1 %", round(int(found.group(1)) * 1.01)),
            ("exponent off by 2^-27", int(found.group(1)) + 1),
        ):
            yield name, put(found.start(1), found.end(1), str(v))
    select = re.search(r"= (.*?) \? (.*?) : (.*);$", code)
    whole = select is not None and all(_NUMBER.fullmatch(select.group(k)) for k in (2, 3))
    if select:
        a, b, c = select.groups()
        head = code[: select.start()] + "= "
        yield "select arms swapped", f"{head}{a} ? {c} : {b};"
        yield "select always first", f"{head}{b};"
        yield "select always second", f"{head}{c};"
    comments = [c.span() for c in re.finditer(r"/\*.*?\*/", code)]
    for found in _NUMBER.finditer(code, begin):
        if any(a <= found.start() < b for a, b in comments):
            continue
        # A bit of a status word, not the threshold before it: rounding would change nothing.
        if whole and select is not None and found.start() >= select.start(2):
            value = fmt.dtype.type(found.group().rstrip("f"))
            changed = [("status bit moved", fmt.literal(float(value * 2 if value else 1)))]
        else:
            changed, _ = _number(found.group(), fmt)
        for name, literal in changed:
            yield name, put(found.start(), found.end(), literal)
    definition = re.match(rf"const {fmt.c_type} \w+ = (.*);$", code)
    if definition and "->" not in code:
        yield "result negated", put(definition.start(1), definition.end(1), f"-({definition[1]})")


def _access_mutants(code: str, fields: dict[str, list[str]]) -> Iterator[tuple[str, str]]:
    # Reading from, or writing to, the wrong element or field of the same struct; not writing.
    for found in re.finditer(r"\b(state|in|out|params|coeffs|\w+_in|\w+_out)(->|\.)", code):
        struct, place = found.group(1), found.end()
        names = fields.get(struct, [])
        now = max(
            (n for n in names if re.match(re.escape(n) + r"(?![\w\[])", code[place:])),
            key=len,
            default=None,
        )
        if now is None or len(names) < 2:
            continue
        other = names[(names.index(now) + 1) % len(names)]
        verb = "read from" if code.startswith("const") or found.start() else "written to"
        changed = code[:place] + other + code[place + len(now) :]
        yield f"{verb} the wrong field", changed
    if re.match(r"(state|out|coeffs|params|\w+_in)(->|\.)[\w.\[\]]+ \+?= ", code):
        yield "assignment dropped", ";"
    counter = re.match(r"(state->(\w+)) \+= \(uint32_t\)\((.*) != 0u && (.*)\);$", code)
    if counter:
        target, _, mask, limit = counter.groups()
        yield "counter wraps", f"{target} += (uint32_t)({mask} != 0u);"
        yield "counter inverted", f"{target} += (uint32_t)({mask} == 0u && {limit});"
        yield "counter counts always", f"{target} += (uint32_t)({limit});"
        yield "counter sticks", f"{target} += (uint32_t)({mask} != 0u);".replace(" += ", " = ")


def _statements(text: str) -> Iterator[tuple[int, str]]:
    inside = comment = False
    for i, line in enumerate(text.split("\n"), 1):
        code = line.strip()
        inside = (inside or line == "{") and line != "}"
        if comment or code.startswith("/*"):
            comment = "*/" not in code
            continue
        if inside and code not in ("{", "") and not code.startswith("(void)"):
            yield i, code


def _fields(block: Block | None, device: Device) -> dict[str, list[str]]:
    def elements(ports: Sequence[Any]) -> list[str]:
        return [
            p.name if getattr(p, "size", 1) == 1 else f"{p.name}[{k}]"
            for p in ports
            for k in range(getattr(p, "size", 1))
        ]

    if block is not None:
        flags = [f"n_{f.name.lower()}" for p in block.outputs for f in p.flags if f.counted]
        return {
            "state": elements(block.state) + flags,
            "in": elements(block.inputs),
            "out": elements([p for p in block.outputs if not p.flags]),
            "coeffs": elements(block.coefficients),
            "params": elements(block.tunables),
        }
    out = {}
    for b in device.system.kinds:
        out[f"{b.name}_in"] = elements(b.inputs)
        out[f"{b.name}_out"] = elements([p for p in b.outputs if not p.flags])
    return out


def mutants(device: Device, real: str, files: dict[str, str]) -> list[Mutant]:
    """Every mutant of a device's emitted C: its Blocks' files and the file that wires them."""
    fmt = FORMATS[real]
    prefix = f"esea_{device.name}"
    out: dict[tuple[str, int, str], Mutant] = {}
    sources: list[tuple[str, Block | None]] = [
        (f"{prefix}_{b.name}.c", b) for b in device.system.kinds
    ]
    for name, block in [*sources, (f"{prefix}.c", None)]:
        fields = _fields(block, device)
        for line, code in _statements(files[name]):
            found = (
                []
                if code.startswith("state->n_") and " += " in code
                else [*_expression_mutants(code, fmt)]
            )
            for kind, after in [*found, *_access_mutants(code, fields)]:
                if after != code:
                    out.setdefault((name, line, after), Mutant(name, line, kind, code, after))
    return list(out.values())


@dataclass
class _Judged:
    # One stream, with what the C must give: bit for bit, and within the looser limits.
    exact: Trajectory
    symbolic: tuple[dict[str, Array], dict[str, Array]] | None
    limits: dict[str, float]


def _exact(
    block: Block, library: HostLibrary, stream: Stream, reference: CasadiReference | None
) -> Trajectory:
    # As exact_trajectory, with the coefficients that the stream puts in.
    if reference is not None or not stream.coefficients:
        return exact_trajectory(block, library, stream, reference)
    fmt = FORMATS[library.real]
    coefficients = coefficients_of(block, fmt, {})
    _, trace = run_c(library.block(block.name), stream)
    initial = initial_state(block, fmt, coefficients)
    arguments = recorded_arguments(block, stream, trace, initial, coefficients, fmt)
    kernel, _ = emitted_kernel(block, fmt)
    return float32_reference(kernel, block, stream, arguments)


def _within(
    rule: StepRule, stream: Stream, outputs: dict[str, Array], states: dict[str, Array]
) -> bool:
    # A decision of a mutant need not be that of the executor: only numbers and flags are compared.
    return not rule.compare(stream, outputs, states).problems


class _Bench:
    """Compiles mutants and holds them against what the C must give."""

    def __init__(
        self, device: Device, real: str, folder: Path, loose: bool, kinds: Sequence[Block]
    ) -> None:
        self.loose = loose
        self.device, self.folder, self.fmt = device, folder, FORMATS[real]
        self.gcc = find_compiler("gcc", "gcc libc6-dev")
        self.library = compile_device(device, real, AS_WRITTEN)
        renderer = Renderer(device.system, self.fmt, device_hash(device), "-", device.title)
        self.files = {n: t for n, t in self.library.files.items() if "/" not in n}
        texts = self.files | {"driver.c": renderer.render("hostlib/driver.c.j2")}
        self.objects: dict[str, str] = {}
        for name, text in texts.items():
            (folder / name).write_text(text, encoding="utf-8")
        for name in texts:
            if name.endswith(".c") and name != "main.c":
                self.objects[name] = f"{name}.o"
                self._gcc("-c", name, "-o", f"{name}.o", check=True)
        self.rules: dict[str, StepRule | None] = {}
        self.judged = {b.name: self._judge(b) for b in kinds}
        self.setups = {b.name: expected_setup(b, self.fmt) for b in kinds}

    @cached_property
    def wiring(self) -> list[bytes]:
        """What the task that ships does."""
        return _task_signature(self.library)

    def _gcc(self, *arguments: str, check: bool = False) -> bool:
        command = [self.gcc, *MUTANT_FLAGS, *arguments]
        done = subprocess.run(command, cwd=self.folder, capture_output=True, check=check)
        return done.returncode == 0

    def _judge(self, block: Block) -> list[_Judged]:
        single = self.fmt.name == "f32"
        reference = None if single else CasadiReference(self.device.system)
        bounds: dict[str, Bound] = {}
        rule = None
        if self.loose and single:
            bounds, rule = bounds_or_rule(self.device, block)
        self.rules[block.name] = rule
        tried = streams(block)
        recorded = recorded_stream(self.device, domain_chirp(self.device, 2.0), "chirp in domain")
        tried += [recorded[block.name]] if block.name in recorded else []
        out = []
        for stream in tried:
            exact = exact_trajectory(block, self.library, stream, reference)
            judged = _Judged(exact, None, {})
            if self.loose:
                found = compare(self.device, block, self.library, stream, bounds, reference, rule)
                judged = _Judged(exact, run_symbolic(block, stream), found.limits)
            out.append(judged)
        # Bit by bit only: there, formats may decide differently.
        for stream in (
            at_the_limits(block, self.fmt.dtype),
            *other_memories(block, self.fmt.dtype),
        ):
            out.append(_Judged(_exact(block, self.library, stream, reference), None, {}))
        return out

    def load(self, mutant: Mutant) -> HostLibrary | None:
        """A mutant, compiled and loaded; None when the compiler refuses it."""
        (self.folder / "mutant.c").write_text(mutant.apply(self.files[mutant.file]))
        others = [o for n, o in self.objects.items() if n != mutant.file]
        link = ["-lm"] if self.fmt.needs_libm else []
        # A new name each time: the loader takes the same path for the same library.
        target = self.folder / f"mutant{len(list(self.folder.glob('mutant*.so')))}.so"
        if not self._gcc("-shared", "mutant.c", *others, "-o", target.name, *link):
            return None
        library = copy.copy(self.library)
        library.path, library.lib = target, self.library.ffi.dlopen(str(target))
        return library

    def unload(self, library: HostLibrary) -> None:
        """Close a mutant; its file stays, empty, so that its name is not used again."""
        library.ffi.dlclose(library.lib)
        library.path.write_bytes(b"")

    def difference(self, library: HostLibrary, file: str) -> str:
        """The first difference in any bit from what the C must give; empty without one."""
        block = self.block_of(file)
        if block is None:
            same = _task_signature(library) == self.wiring
            return "" if same else "the task differs from the one that ships"
        found = setup_difference(block, library, self.setups[block.name])
        for judged in self.judged[block.name]:
            if found:
                break
            run = run_c(library.block(block.name), judged.exact.stream)
            found = judged.exact.first_difference(*run)
        return found

    def outside_bound(self, library: HostLibrary, file: str) -> bool:
        """Whether the looser comparison sees the mutant."""
        block = self.block_of(file)
        if block is None:
            return True
        for judged in self.judged[block.name]:
            if judged.symbolic is None:
                continue
            y, s = run_c(library.block(block.name), judged.exact.stream)
            rule = self.rules[block.name]
            if rule is not None:
                if not _within(rule, judged.exact.stream, y, s):
                    return True
                continue
            for ports, got, expected in (
                (block.outputs, y, judged.symbolic[0]),
                (block.state, s, judged.symbolic[1]),
            ):
                for p in ports:
                    if p.flags:
                        if unexplained(p, expected, got, judged.limits):
                            return True
                        continue
                    error = np.abs(np.asarray(got[p.name], np.float64) - expected[p.name])
                    if not np.all(error <= judged.limits[p.name]):
                        return True
        return False

    def block_of(self, file: str) -> Block | None:
        """The Block that a file holds; None for the file that wires them."""
        prefix = self.library.prefix
        return next((b for b in self.device.system.kinds if file == f"{prefix}_{b.name}.c"), None)


def _task_signature(library: HostLibrary) -> list[bytes]:
    # Everything the device file does: defaults, the check of the tunables, init, the wiring.
    out = []
    ffi = library.ffi
    for task in library.system.tasks:
        runner = library.task(task.name)
        held = runner._coeffs
        for instance, tunable in library.system.tunables:
            low, high = np.float32(tunable.low), np.float32(tunable.high)
            below, above = (
                np.nextafter(x, np.float32(s * np.inf)) for x, s in ((low, -1), (high, 1))
            )
            for value in (low, high, below, above, np.nan, np.inf, 0.5 * (low + high)):
                code = runner.prepare({instance: {tunable.name: float(value)}})
                out.append(bytes([code % 256]) + b"".join(bytes(ffi.buffer(c)) for c in held))
        rng = np.random.default_rng(3)
        inputs = {
            x.name: single(rng.uniform(1.02 * x.port.low, 1.02 * x.port.high, (800, x.port.size)))
            for x in library.system.task_inputs(task)
        }
        slow = {
            k: single(0.3 * np.sin(0.01 * np.arange(len(v)))[:, None] * abs(v[0]))
            for k, v in inputs.items()
        }
        # Gains that are 0 by default hide what they multiply: other tunables too.
        for tunables in ({}, _other_tunables(library.system)) if held else ({},):
            filled: list[Any] = [*held, runner._params] if held else []
            for memory in filled:
                ffi.buffer(memory)[:] = b"\xa5" * len(ffi.buffer(memory))
            runner.prepare(tunables)
            out += [bytes(ffi.buffer(memory)) for memory in filled]
            rubbish = runner.state
            rubbish.view(np.uint8)[:] = 0xA5
            runner.state = rubbish
            runner.reset()
            out.append(runner.state.tobytes())
            for stream in (slow, inputs):
                out += _run_over_rubbish(
                    runner, {k: v[:, 0] if v.shape[1] == 1 else v for k, v in stream.items()}
                )
    if library.system.latches:
        out += _board_signature(library)
    return out


def _other_tunables(system: System) -> dict[str, dict[str, float]]:
    # All within their bounds, none at its default; in turn low and high, so that ends stay apart.
    out: dict[str, dict[str, float]] = {}
    for k, (instance, t) in enumerate(system.tunables):
        share = (0.3, 0.7)[k % 2]
        out.setdefault(instance, {})[t.name] = float(np.float32(t.low + share * (t.high - t.low)))
    return out


def _run_over_rubbish(runner: CRunner, inputs: Mapping[str, Array]) -> list[bytes]:
    # As CRunner.run, into outputs that are not zero before: what is not written shows.
    packed = runner.pack(inputs) if inputs else np.zeros(800, runner._in_type)
    out, states = np.zeros(len(packed), runner._out_type), np.zeros(len(packed), runner._state_type)
    out.view(np.uint8)[:] = 0xA5
    runner._run(
        *runner._coeffs,
        runner._cast(f"{runner.prefix}_state_t", runner._state),
        runner._cast(f"{runner.stem}_in_t", packed),
        runner._cast(f"{runner.stem}_out_t", out),
        runner._cast(f"{runner.prefix}_state_t", states),
        len(packed),
    )
    return [out.tobytes(), states.tobytes()]


def _board_signature(library: HostLibrary) -> list[bytes]:
    # All tasks on one state, as firmware calls them: what crosses from one to the other, and when.
    out = []
    for tunables in ({}, _other_tunables(library.system)):
        try:
            out += _board_run(library, library.board(tunables))
        except ValueError as error:  # a default that its own check refuses
            out.append(str(error).encode())
    return out


def _board_run(library: HostLibrary, board: CBoard) -> list[bytes]:
    system = library.system
    ticks = 1200
    inputs = {t.name: working_inputs(system, t, ticks // t.every + 1) for t in system.tasks}
    digest, out = hashlib.sha256(bytes(library.ffi.buffer(board._state))), []
    for tick in range(ticks):
        board.release(tick)
        for task in system.tasks:
            k, late = divmod(tick - task.phase, task.every)
            if late or k < 0:
                continue
            given = {name: v[k] for name, v in inputs[task.name].items()}
            for value in board.step(task.name, **given).values():
                digest.update(np.asarray(value, dtype=np.float64).tobytes())
        digest.update(bytes(library.ffi.buffer(board._state)))
        if tick % 100 == 99:
            out.append(digest.digest())
    return out


class _Prover:
    """Proofs that a surviving mutant of a Block's step computes the same."""

    def __init__(self, block: Block, fmt: Format, text: str) -> None:
        self.fmt = fmt
        # The names of values are the step's: in prepare and init the same ones mean others.
        lines = text.split("\n")
        self.first = max(i for i, x in enumerate(lines, 1) if re.match(r"void \w+_step\(", x))
        self.kernel, names = emitted_kernel(block, fmt)
        self.ranges = guarded_ranges(block, self.kernel, fmt)
        self.whole = whole_nodes(block, self.kernel, fmt)
        # Places as they are, choices of one of two values as such in either format.
        count = len(self.kernel.nodes)
        self.fused = fuse_selects(
            Kernel(self.kernel.name, self.kernel.nodes, (tuple(range(count)),))
        ).nodes
        self.node = {f"v{i}": i for i in range(count)}
        self.node |= {name: i for i, (name, _) in names.items()}

    def __call__(self, mutant: Mutant) -> str:
        """The proof, or nothing."""
        if mutant.line < self.first:
            return ""
        return (
            self._no_clip(mutant)
            or self._unobserved(mutant)
            or self._even(mutant)
            or self._between(mutant)
            or self._halves(mutant)
            or self._rounded_away(mutant)
            or self._half_moved(mutant)
            or self._sign_alone(mutant)
            or self._settled_choice(mutant)
            or self._never_looked_at(mutant)
        )

    def _halves(self, mutant: Mutant) -> str:
        # A whole number against a choice of numbers that are not whole: they never meet.
        if mutant.kind not in ("< to <=", "<= to <"):
            return ""
        found = re.match(r"const int (\w+) = (?:.* )?(\w+) <=? (\w+);$", mutant.before)
        names = found.groups() if found else ()
        if not all(n in self.node for n in names) or not names:
            return ""
        whole, other = (self.node[n] for n in names[1:])
        for a, b in ((whole, other), (other, whole)):
            choices = self._choices(b)
            if a in self.whole and choices and all(x != math.floor(x) for x in choices):
                return "a whole number is compared with numbers that are not whole"
        return ""

    def _choices(self, i: int) -> list[float]:
        # The constants that a chain of selects chooses from; empty for anything else.
        n = self.fused[i]
        if n.op == "const":
            return [n.value]
        if n.op != "select":
            return []
        arms = [self._choices(a) for a in n.args[1:]]
        return [x for arm in arms for x in arm] if all(arms) else []

    def _never_looked_at(self, mutant: Mutant) -> str:
        # Conditions that ranges settle leave a value without a reader.
        named = re.match(r"const \w+ (\w+) = ", mutant.before)
        if named is None or named.group(1) not in self.node:
            return ""
        settled = {
            k: v.low for k, v in self.ranges.items() if v.settled and self.kernel.nodes[k].boolean
        }
        i = self.node[named.group(1)]
        if i in settled or self._reaches_a_result(i, settled):
            return ""
        return "conditions that its ranges settle leave the value without a reader"

    def _between(self, mutant: Mutant) -> str:
        # A threshold that no value lies on either side of: none between the old one and the new.
        before, after = (list(_COMPARISON.finditer(c)) for c in (mutant.before, mutant.after))
        if len(before) != len(after):
            return ""
        changed = [(a, b) for a, b in zip(before, after, strict=True) if a.group() != b.group()]
        rest = [_COMPARISON.sub("", c) for c in (mutant.before, mutant.after)]
        if len(changed) != 1 or rest[0] != rest[1]:
            return ""
        names = [m.group("right") or m.group("left") for m in changed[0]]
        if names[0] != names[1] or names[0] not in self.node:
            return ""
        if bool(changed[0][0].group("right")) != bool(changed[0][1].group("right")):
            return ""
        ends = sorted(_value(m.group("low") or m.group("high")) for m in changed[0])
        why = self._never_within(self.node[names[0]], ends[0], ends[1])
        return f"{names[0]}: {why}, so none from {ends[0]:.9g} to {ends[1]:.9g}" if why else ""

    def _never_within(self, i: int, low: float, high: float) -> str:
        # Why a value never lies in an interval, ends included; empty when it may.
        n = self.fused[i]
        if i in self.whole and math.floor(high) == math.ceil(low) - 1:
            return "whole"
        known = self.ranges.get(i)
        if known is not None and not known.nan and (known.high < low or known.low > high):
            return f"in [{known.low:.6g}, {known.high:.6g}]"
        if n.op == "const":
            return "" if low <= n.value <= high else "a constant"
        if n.op == "fabs":
            both = [self._never_within(n.args[0], *x) for x in ((low, high), (-high, -low))]
            return "; ".join(dict.fromkeys(both)) if all(both) else ""
        if n.op in SELECTING:
            arms = [self._never_within(a, low, high) for a in n.args[1:]]
            if n.op == "if_else_zero":
                arms.append("" if low <= 0 <= high else "zero")
            return " or ".join(dict.fromkeys(arms)) if all(arms) else ""
        return ""

    def _uses(self, i: int) -> list[tuple[int, int]]:
        return [
            (k, place) for k, n in enumerate(self.fused) for place, a in enumerate(n.args) if a == i
        ]

    def _constant_arm(self, mutant: Mutant) -> tuple[int, float, float] | None:
        # A value that is a choice of, or a sum with, one constant: its node, the old, the new.
        found, now = _CHOICE.match(mutant.before), _CHOICE.match(mutant.after)
        if not found or not now or found.group("name") not in self.node:
            return None
        parts = [(found.group(k), now.group(k)) for k in ("head", "one", "other")]
        changed = [(a, b) for a, b in parts if a != b]
        if len(changed) != 1 or parts[0][0] != parts[0][1]:
            return None
        if not all(_SIGNED.fullmatch(x) for x in changed[0]):
            return None
        return self.node[found.group("name")], _value(changed[0][0]), _value(changed[0][1])

    def _rounded_away(self, mutant: Mutant) -> str:
        # A whole number a little off, compared with halves only.
        found = self._constant_arm(mutant)
        if found is None or found[0] not in self.whole or abs(found[1] - found[2]) >= 0.4:
            return ""
        reached, front = set[int](), [found[0]]
        while front:
            at = front.pop()
            uses = self._uses(at)
            # Without a use here the value was fused away: what is printed uses it otherwise.
            if not uses or any(at in r for r in self.kernel.results):
                return ""
            for k, place in uses:
                n = self.fused[k]
                if n.op in ("lt", "le"):
                    other = self._choices(n.args[1 - place])
                    if other and all(x % 1 == 0.5 for x in other):
                        continue
                    return ""
                others = [a for p, a in enumerate(n.args) if p != place]
                kept = n.op in ("fabs", "neg") or (n.op in SELECTING and place > 0)
                sums = n.op in ("add", "sub") and others[0] in self.whole and others[0] != at
                if not (kept or (sums and others[0] not in reached)):
                    return ""
                if k not in reached:
                    reached.add(k)
                    front.append(k)
        return "only compared with halves, and a whole number otherwise"

    def _half_moved(self, mutant: Mutant) -> str:
        # A limit between two whole numbers, moved and still between them.
        found = self._constant_arm(mutant)
        if found is None or any(x == math.floor(x) for x in found[1:]):
            return ""
        if math.floor(found[1]) != math.floor(found[2]):
            return ""
        reached, front = {found[0]}, [found[0]]
        while front:
            at = front.pop()
            uses = self._uses(at)
            # Without a use here the value was fused away: what is printed uses it otherwise.
            if not uses or any(at in r for r in self.kernel.results):
                return ""
            for k, place in uses:
                n = self.fused[k]
                if n.op in ("lt", "le") and n.args[1 - place] in self.whole:
                    continue
                if n.op not in SELECTING or place == 0:
                    return ""
                if k not in reached:
                    reached.add(k)
                    front.append(k)
        return "only whole numbers are compared with it, and it stays between the same two"

    def _sign_alone(self, mutant: Mutant) -> str:
        # A choice of which only the sign, or being zero, is looked at: itself, or as a factor.
        found = self._constant_arm(mutant)
        if found is None or not found[1] * found[2] > 0:
            return ""
        reached, front = {found[0]}, [(found[0], False)]
        while front:
            at, product = front.pop()
            uses = self._uses(at)
            # Without a use here the value was fused away: what is printed uses it otherwise.
            if not uses or any(at in r for r in self.kernel.results):
                return ""
            for k, place in uses:
                n = self.fused[k]
                others = [a for p, a in enumerate(n.args) if p != place]
                if n.op in ("eq", "ne", "lt", "le"):
                    other = self.fused[others[0]]
                    if other.op == "const" and other.value == 0:
                        continue
                    return ""
                if n.op in LOGICAL or (n.op in SELECTING and place == 0):
                    continue
                # A factor of at least 1 underflows nothing.
                factor = n.op == "mul" and not product and min(abs(x) for x in found[1:]) >= 1
                if not factor and not (n.op in SELECTING and not product):
                    return ""
                if k not in reached:
                    reached.add(k)
                    front.append((k, product or n.op == "mul"))
        return "only its sign, or whether it is zero, is looked at"

    def _settled_choice(self, mutant: Mutant) -> str:
        # A select whose condition its ranges settle: the other arm is never taken.
        found = re.match(r"const \w+ (\w+) = (.*?) \? (.*?) : (.*);$", mutant.before)
        if found is None or found.group(1) not in self.node:
            return ""
        n = self.kernel.nodes[self.node[found.group(1)]]
        if n.op not in SELECTING or n.args[0] not in self.ranges:
            return ""
        condition = self.ranges[n.args[0]]
        if not condition.settled:
            return ""
        kept = found.group(3) if condition.low else found.group(4)
        now = re.match(r"const \w+ (\w+) = (?:(.*?) \? (.*?) : (.*)|([^?]*));$", mutant.after)
        if now is None or (now.group(2) is not None and now.group(2) != found.group(2)):
            return ""
        taken = now.group(5) or (now.group(3) if condition.low else now.group(4))
        if taken not in (kept, kept.removeprefix("(").removesuffix(")")):
            return ""
        return f"the condition is always {str(bool(condition.low)).lower()}"

    def _unobserved(self, mutant: Mutant) -> str:
        # A select whose one arm is never looked at: what depends on it is masked then.
        select = re.compile(r"const \w+ (\w+) = (.*?) \? (.*?) : (.*);$")
        found, now = select.match(mutant.before), select.match(mutant.after)
        dropped = {"select always first": False, "select always second": True}.get(mutant.kind)
        if found and now and found.group(2) == now.group(2):
            same = [found.group(k) == now.group(k) for k in (3, 4)]
            dropped = None if not any(same) else same[1]
        if found is None or dropped is None or found.group(1) not in self.node:
            return ""
        i = self.node[found.group(1)]
        n = self.kernel.nodes[i]
        if n.op not in ("if_else_zero", "select"):
            return ""
        known = imply(self.kernel, n.args[0], dropped, without=i)
        if self._reaches_a_result(i, known):
            return ""
        return f"when the condition is {str(dropped).lower()}, no result looks at the value"

    def _reaches_a_result(self, i: int, known: Mapping[int, float]) -> bool:
        # Whether a change of a value can change a result, given some values.
        results = {k for r in self.kernel.results for k in r}
        reached, front = {i}, [i]
        while front:
            at = front.pop()
            if at in results:
                return True
            for u, user in enumerate(self.kernel.nodes):
                if at not in user.args or u in reached or u in known:
                    continue
                if user.op in ("if_else_zero", "select") and user.args[0] in known:
                    looked = 1 if known[user.args[0]] else 2
                    if user.args[looked : looked + 1] != (at,):
                        continue
                reached.add(u)
                front.append(u)
        return False

    def _even(self, mutant: Mutant) -> str:
        # A sign that nobody looks at.
        named = re.match(r"const \w+ (\w+) = ", mutant.before)
        if mutant.kind != "result negated" or named is None or named.group(1) not in self.node:
            return ""
        i = self.node[named.group(1)]
        if any(i in r for r in self.kernel.results):
            return ""
        for n in self.kernel.nodes:
            for position, a in enumerate(n.args):
                truth = n.op in LOGICAL or (n.op in SELECTING and position == 0)
                other = self.kernel.nodes[n.args[1 - position]] if len(n.args) == 2 else n
                truth |= n.op in ("eq", "ne") and other.op == "const" and other.value == 0
                if a == i and n.op != "fabs" and not truth:
                    return ""
        return "only its magnitude, or whether it is zero, is used"

    def _no_clip(self, mutant: Mutant) -> str:
        found = re.match(r"const \w+ (\w+) = esea_(fmin|fmax)\(.*\);$", mutant.before)
        if found is None or found.group(1) not in self.node:
            return ""
        n = self.kernel.nodes[self.node[found.group(1)]]
        if n.op != found.group(2) or n.args[0] not in self.ranges:
            return ""
        low, high = self.ranges[n.args[0]].low, self.ranges[n.args[0]].high
        limit = self.kernel.nodes[n.args[1]]
        if limit.op != "const":
            return ""
        limits = [limit.value]
        if mutant.kind.startswith("constant off"):
            same = mutant.before.rpartition(", "), mutant.after.rpartition(", ")
            if same[0][0] != same[1][0] or not _SIGNED.fullmatch(same[1][2].removesuffix(");")):
                return ""
            limits.append(_value(same[1][2].removesuffix(");")))
        elif mutant.kind != f"esea_{n.op} dropped":
            return ""
        never = all(high <= x if n.op == "fmin" else low >= x for x in limits)
        where = f"its operand lies in [{low:.6g}, {high:.6g}]"
        return f"the clip at {limit.value:.6g} never acts: {where}" if never else ""


def run_mutation(
    device: Device,
    real: str,
    sample: int | None = None,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
    blocks: Sequence[str] | None = None,
) -> MutationReport:
    """Mutate a device's emitted C and count the mutants that the comparisons catch.

    blocks: mutate the files of these Blocks only; without it, all Blocks and the wiring.
    """
    if real not in FLOATING_FORMATS:
        raise UserError(
            f"Unknown number format '{real}'.", f"Choose from {', '.join(FLOATING_FORMATS)}."
        )
    touched = chosen_blocks(device, blocks)
    say = progress or (lambda _: None)
    report = MutationReport(device.name, real)
    kinds: Counter[str] = Counter()
    caught: Counter[str] = Counter()
    with tempfile.TemporaryDirectory(prefix="esea-mutation-") as scratch:
        bench = _Bench(device, real, Path(scratch), sample is None, touched)
        files = {f"{bench.library.prefix}_{b.name}.c" for b in touched}
        for file in sorted(files):
            found = bench.difference(bench.library, file)
            if found:
                raise RuntimeError(f"the C that ships already differs: {found}")
        prefix = bench.library.prefix
        provers = {
            b.name: _Prover(b, FORMATS[real], bench.files[f"{prefix}_{b.name}.c"]) for b in touched
        }
        chosen = mutants(device, real, bench.files)
        if blocks:
            chosen = [m for m in chosen if m.file in files]
        if sample is not None and sample < len(chosen):
            chosen = random.Random(seed).sample(chosen, sample)
        for k, mutant in enumerate(chosen):
            if k % 50 == 0:
                say(f"{device.name}, {real}: mutant {k + 1} of {len(chosen)}")
            library = bench.load(mutant)
            if library is None:
                report.rejected += 1
                continue
            report.tried += 1
            kinds[mutant.kind] += 1
            block = bench.block_of(mutant.file)
            proof = provers[block.name](mutant) if block else ""
            if bench.difference(library, mutant.file):
                report.killed += 1
                if proof and "whole" not in proof:
                    report.contradicted.append((mutant, proof))
                caught[mutant.kind] += 1
                if bench.loose:
                    seen = bench.outside_bound(library, mutant.file)
                    report.killed_by_bound = (report.killed_by_bound or 0) + int(seen)
            elif proof:
                report.equivalent.append((mutant, proof))
            else:
                report.survivors.append(mutant)
            bench.unload(library)
    report.kinds = {k: (caught[k], n) for k, n in kinds.items()}
    return report
