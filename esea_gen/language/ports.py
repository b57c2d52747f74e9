"""Interface of a Block: ports, tunables, constants, flags, and the checks of a value.

A quantity has its unit in its name.  Thresholds are float32, so that all formats decide alike.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property, reduce
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np
import numpy.typing as npt

from esea_gen.language.names import check_flags, check_name

Array = npt.NDArray[np.float64]


Status = Literal["published", "identified", "assumed", "derived"]
Kind = Literal["quantity", "flag", "count"]


UNIT_SUFFIXES = {
    "_rad": "rad",
    "_deg": "deg",
    "_rad_s": "rad/s",
    "_rad_s2": "rad/s^2",
    "_Nm": "Nm",
    "_Nm_rad": "Nm/rad",
    "_Nm_rad3": "Nm/rad^3",
    "_Nms_rad": "Nm s/rad",
    "_1_rad": "1/rad",
    "_1_s": "1/s",
    "_1_s2": "1/s^2",
    "_s": "s",
    "_Hz": "Hz",
    "_bits": "bit",
    "_kgm2": "kg m^2",
    "_rad_s3": "rad/s^3",
    "_Nm_s": "Nm/s",
    "_Nm_s2": "Nm/s^2",
    "_Nm_s_rad": "Nm/(rad s)",
    "_J": "J",
    "_W": "W",
    "_C": "degC",
    "_K_W": "K/W",
    "_Ohm": "Ohm",
    "_Nm_A": "Nm/A",
    "_Nm2": "Nm^2",
    "per_K": "1/K",
}


def unit_of(name: str) -> str:
    """Unit that a name carries in its suffix; ``"1"`` without a known one.

    Parameters
    ----------
    name : str
        A quantity's name, such as ``omega_mid_rad_s``.
    """
    best = max((s for s in UNIT_SUFFIXES if name.endswith(s)), key=len, default="")
    return UNIT_SUFFIXES.get(best, "1")


def f32_inside(low: float, high: float) -> tuple[float, float]:
    """Snap an interval's ends inwards to float32 numbers.

    Every threshold that decides something is such a number, so that f64 and f32 decide alike on the
    same input.

    Parameters
    ----------
    low, high : float
    """
    lo, hi = np.float32(low), np.float32(high)
    if float(lo) < low:
        lo = np.nextafter(lo, np.float32(np.inf))
    if float(hi) > high:
        hi = np.nextafter(hi, np.float32(-np.inf))
    return float(lo), float(hi)


def threshold(value: float) -> float:
    """A positive threshold as the nearest float32 not above it (all formats then decide alike).

    Parameters
    ----------
    value : float
    """
    return f32_inside(-value, value)[1]


@dataclass(frozen=True)
class Flag:
    """One bit of a status word.

    Parameters
    ----------
    name : str
        Upper case name, ``INPUT_INVALID``.
    meaning : str
        What it tells the reader of a log.
    counted : bool
        Whether the C keeps a saturating counter of the steps in which it was set.
    compares : tuple of str
        Outputs whose magnitude, once computed, decides the bit; empty when the inputs alone do, so
        that all number formats agree.
    threshold : float
        What it is compared with.
    only_by_fault : str
        Why only a fault of the arithmetic itself can set the bit, so that no stream is asked to.
        That it stays quiet is checked by the comparisons, with the distance to its threshold; no
        interval shows it.
    """

    name: str
    meaning: str
    counted: bool = False
    compares: tuple[str, ...] = ()
    threshold: float = 0.0
    only_by_fault: str = ""


@dataclass(frozen=True)
class Code:
    """One number of a port that carries one of several reasons.

    Parameters
    ----------
    name : str
        Upper case name, ``STOP``.
    value : int
        The number; never used again for another reason.
    cause : str
        What has happened.
    cure : str
        What the person at the machine should do.
    bound : str
        How long it may take until it is found.
    """

    name: str
    value: int
    cause: str
    cure: str
    bound: str = ""


@dataclass(frozen=True)
class Port:
    """A named value that crosses a Block's border: input, output, state or coefficient.

    Parameters
    ----------
    name : str
        Name with its unit as suffix (``theta_rad``).
    low, high : float
        Physical range; snapped inwards to float32 numbers.
    meaning : str
        One sentence for headers, telemetry and reports.
    size : int
        Number of elements.
    equation : str
        Number of the equation it comes from, as printed in the source.
    init : float
        States: value after ``init``.
    on_invalid : float or str
        Inputs: the constant, or the name of the state, used in place of an invalid value.
    repair : {"init", "block"}
        States: ``init`` lets the guard put the initial value in place of a corrupt one; ``block``
        leaves that to the Block's own step, which is told through ``guard.state_ok``.
    flags : tuple of Flag
        Outputs that are status words: the bits, least significant first.
    codes : tuple of Code
        Outputs that are one of several numbered reasons: what each number means.
    finer : float
        Outputs: fixed point is planned for a proven error so many times below its general aim.
    kind : {"quantity", "flag", "count"}
        A flag is 0 or 1, a condition in C; a count or a choice is a whole number.
    choices : type of IntEnum, optional
        Of a choice: its numbers by name, which C compares with.
    """

    name: str
    low: float
    high: float
    meaning: str
    size: int = 1
    equation: str = ""
    init: float = 0.0
    on_invalid: float | str = 0.0
    repair: Literal["init", "block"] = "init"
    flags: tuple[Flag, ...] = ()
    codes: tuple[Code, ...] = ()
    finer: float = 1.0
    kind: Kind = "quantity"
    choices: type[IntEnum] | None = None

    def __post_init__(self) -> None:
        check_name("port", self.name)
        if not self.low < self.high:
            raise ValueError(f"port {self.name}: range [{self.low}, {self.high}] is empty")
        if self.size < 1:
            raise ValueError(f"port {self.name}: size {self.size} is below 1")
        check_flags(self.name, [f.name for f in self.flags])
        low, high = f32_inside(self.low, self.high)
        object.__setattr__(self, "low", low)
        object.__setattr__(self, "high", high)
        if self.kind == "count" and not max(-low, high) < 2**24:
            raise ValueError(f"port {self.name}: a count must be below 2^24, not [{low}, {high}]")
        if self.kind == "count" and low < 0 and self.repair == "block":
            raise ValueError(f"port {self.name}: a count below 0 is repaired by init alone")

    @classmethod
    def count(cls, name: str, high: float, meaning: str, **named: Any) -> Port:
        """A port that is a whole number from 0, or a ``low`` of a state, to ``high``.

        Parameters
        ----------
        name, high, meaning, **named
            As in the class.
        """
        return cls(name, named.pop("low", 0), high, meaning, kind="count", **named)

    @classmethod
    def choice(cls, name: str, choices: type[IntEnum], meaning: str, **named: Any) -> Port:
        """A port that is one of several numbers with a name, the least of them 0.

        Parameters
        ----------
        name, choices, meaning, **named
            As in the class.
        """
        high = named.pop("high", max(choices))
        return cls.count(name, high, meaning, choices=choices, **named)

    @classmethod
    def flag(cls, name: str, meaning: str, **named: Any) -> Port:
        """A port that is 0 or 1.

        Parameters
        ----------
        name, meaning, **named
            As in the class.
        """
        return cls(name, 0, 1, meaning, kind="flag", **named)

    @property
    def whole(self) -> bool:
        """Whether C holds an integer: a status word, a flag or a count."""
        return bool(self.flags) or self.kind != "quantity"

    @property
    def integer(self) -> str:
        """Type of that integer."""
        return "int32" if self.low < 0 else "uint32"

    @property
    def unit(self) -> str:
        """Unit from the name's suffix; ``"1"`` when dimensionless."""
        return "bits" if self.flags else unit_of(self.name)


def around(name: str, limit: float, meaning: str, *more: Any, **named: Any) -> Port:
    """A port whose range is ``limit`` either way of 0.

    Parameters
    ----------
    name, meaning
        As in :class:`Port`.
    limit : float
        Largest magnitude.
    *more, **named
        The rest of :class:`Port`.
    """
    return Port(name, -limit, limit, meaning, *more, **named)


def status_port(meaning: str, invalid: str, repaired: str, *more: Flag) -> Port:
    """A status word that begins with the guard's two flags (``guard.status`` fills it).

    Parameters
    ----------
    meaning : str
        As in :class:`Port`.
    invalid, repaired : str
        What an invalid input and a corrupt state mean for the Block.
    *more : Flag
        The Block's own flags.

    Returns
    -------
    Port
        The port ``status``.
    """
    guarded = Flag("INPUT_INVALID", invalid, True), Flag("STATE_REPAIRED", repaired, True)
    flags = (*guarded, *more)
    return Port("status", 0, 2 ** len(flags) - 1, meaning, flags=flags)


@dataclass(frozen=True)
class Tunable:
    """A value that may be changed while the board runs.

    Parameters
    ----------
    name : str
        Name with its unit as suffix.
    default, low, high : float
        Default and the bounds outside which a change is refused; bounds are snapped inwards to
        float32 numbers, and a default as near as rounding is the bound (:meth:`taken`).
    meaning : str
        One sentence, with the effect of turning it up.
    source : str
        Where the default comes from.
    status : str
        ``published``, ``identified`` or ``assumed``.
    safer : str
        End at which it limits more, ``low`` or ``high``; empty where neither is safer. A board that
        kept a value which a later build no longer allows takes the bound next to it where an end
        is declared, its default where none is.
    """

    name: str
    default: float
    low: float
    high: float
    meaning: str
    source: str = ""
    status: Status = "assumed"
    safer: Literal["", "low", "high"] = ""
    size: ClassVar[int] = 1
    kind: ClassVar[Kind] = "quantity"

    def __post_init__(self) -> None:
        check_name("tunable", self.name)
        low, high = f32_inside(self.low, self.high)
        object.__setattr__(self, "low", low)
        object.__setattr__(self, "high", high)
        object.__setattr__(self, "default", self.taken(self.default))
        if not self.low <= self.default <= self.high:
            within = f"[{self.low}, {self.high}]"
            raise ValueError(f"tunable {self.name}: default {self.default} outside {within}")

    def taken(self, value: float) -> float:
        """A value as it is set: the bound, for one that only float32's rounding puts beyond it.

        Bounds are snapped inwards, so the number that a device file or a message names as the bound
        lies beyond by up to one rounding.

        Parameters
        ----------
        value : float
            A value somebody gave.
        """
        for bound, beyond in ((self.low, value < self.low), (self.high, value > self.high)):
            if beyond and abs(value - bound) <= float(np.spacing(np.float32(abs(bound)))):
                return bound
        return value

    @property
    def unit(self) -> str:
        """Unit from the name's suffix."""
        return unit_of(self.name)

    @property
    def port(self) -> Port:
        """The coefficient of a tunable that passes through."""
        return Port(self.name, self.low, self.high, self.meaning)


@dataclass(frozen=True)
class Constant:
    """A number folded into the code, stored for headers and reports.

    Parameters
    ----------
    name : str
        Name with its unit as suffix.
    value : float
        The number, SI units.
    source : str
        Table, equation or recording it comes from.
    status : str
        ``published``, ``identified``, ``assumed`` or ``derived``.
    """

    name: str
    value: float
    source: str
    status: Status

    @property
    def unit(self) -> str:
        """Unit from the name's suffix."""
        return unit_of(self.name)


@dataclass(frozen=True)
class Equation:
    """An equation a Block implements, for documents and comments.

    Parameters
    ----------
    number : str
        Number in the source, ``"(3.4)"``; ours start with ``"["``.
    printed : callable
        Gives ``mathml``, presentation MathML, by SymPy from the expression that is evaluated.
    text : str
        What it says, in a few words.
    """

    number: str
    printed: Callable[[], str] = field(repr=False, compare=False)
    text: str

    @cached_property
    def mathml(self) -> str:
        return self.printed()


def symbols_of(ports: Iterable[Port | Tunable]) -> dict[str, ca.SX]:
    """One symbol a port, by name.

    Parameters
    ----------
    ports : iterable of Port or Tunable
    """
    return {p.name: ca.SX.sym(p.name, p.size) for p in ports}


def in_range(x: ca.SX, low: float, high: float) -> ca.SX:
    """Whether a value is inside a range; false for NaN (promise 5: test before any clip).

    Parameters
    ----------
    x : casadi.SX
        Scalar.
    low, high : float
        Ends, both inside.
    """
    return ca.logic_and(x <= high, x >= low)


def port_ok(x: ca.SX, port: Port) -> ca.SX:
    """Whether a port's value is plausible.

    A scalar, a flag or a count must be inside its range.  For a vector of numbers the sum of
    magnitudes must be within size times the largest magnitude (and a thousandth, room for
    rounding): one comparison finds any NaN, infinity or blown-up element.

    Parameters
    ----------
    x : casadi.SX
        The value, ``port.size`` elements.
    port : Port
    """
    if port.size == 1 or port.kind != "quantity":
        inside = [in_range(e, port.low, port.high) for e in ca.vertsplit(x)]
        return reduce(ca.logic_and, inside)
    total = ca.fabs(x[0])
    for i in range(1, port.size):
        total = total + ca.fabs(x[i])
    return total <= float(np.float32(1.001 * port.size * max(abs(port.low), abs(port.high))))


def clip(x: ca.SX, low: Any, high: Any) -> ca.SX:
    """Clip a value that has passed its port check.

    Parameters
    ----------
    x : casadi.SX
        Scalar, not NaN.
    low, high : float or casadi.SX
        Ends.
    """
    return ca.fmax(ca.fmin(x, high), low)


def flag_word(bits: Iterable[ca.SX]) -> ca.SX:
    """Pack flags into a status word, first flag in the lowest bit.

    Parameters
    ----------
    bits : iterable of casadi.SX
        1 or 0 each, at most 24 of them (exact in float32).
    """
    word: Any = ca.SX(0)
    for i, b in enumerate(bits):
        if i >= 24:
            raise ValueError("a status word has at most 24 flags")
        word = word + ca.if_else(b, float(1 << i), 0)
    return ca.SX(word)
