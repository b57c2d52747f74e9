"""Properties of the limits' C for any bits of inputs, state and coefficients, proven by z3.

First every sum of floats and product of two unknowns stands for any number, which allows more than
the C does: what holds then, holds. Where that is too coarse, sums are computed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

from esea_gen.control.limits.faults import Fault, Key
from esea_gen.control.limits.latch import MIRROR, UNKNOWN
from esea_gen.control.limits.safety import STALE_PERIODS
from esea_gen.device import Device
from esea_gen.language.ports import Port
from esea_gen.language.watch import LATE_MOST

from .limits_numbers import Number
from .limits_step import Change, LimitsC, Step
from .smt import Answer, ask, every, implied, negated, some

LIMIT_S = 120  # of processor time, about
TOGETHER = 3  # properties in one question: reading one costs as much as answering it
KEY = Fraction(Key.RELEASED)


@dataclass(frozen=True)
class Property:
    """A statement about one step."""

    name: str
    claim: str
    formula: Callable[[Step], str]


PROPERTIES: dict[str, Property] = {}


def _holds(claim: str) -> Callable[[Callable[[Step], str]], Callable[[Step], str]]:
    def add(formula: Callable[[Step], str]) -> Callable[[Step], str]:
        name = formula.__name__.lstrip("_")
        PROPERTIES[name] = Property(name, claim, formula)
        return formula

    return add


# The command.


@_holds("|u_Nm| is at most the device file's u_max_Nm")
def _command_within_compiled(s: Step) -> str:
    return s.out("u_Nm").inside(-s.limit.u_max_Nm, s.limit.u_max_Nm)


@_holds("|u_Nm| is at most the narrowed u_max_Nm, or at most the last command on its way there")
def _command_within_narrowed(s: Step) -> str:
    u, last, most = s.out("u_Nm"), s.before("u_last_Nm"), s.coef("u_max_Nm")
    up, down = some(u <= most, u <= last), some(u >= -most, u >= last)
    return some(u.equals(0), every(up, down))


@_holds("while the latch is open, u_Nm moves by at most the step, narrowed and compiled")
def _command_rate(s: Step) -> str:
    u, last = s.out("u_Nm"), s.before("u_last_Nm")
    return implied(s.runs, every(u <= last + s.change, u >= last - s.change))


def _no_more(s: Step, sign: int) -> str:
    """No push in a direction, or less than before by the full step."""
    u, last = s.out("u_Nm"), s.before("u_last_Nm")
    if sign > 0:
        return some(u <= 0, u <= last - s.change)
    return some(u >= 0, u >= last + s.change)


@_holds("at an end of the range of motion and beyond, a push further out falls at the full rate")
def _ends(s: Step) -> str:
    angle = s.given("theta_load_rad")
    return every(
        implied(angle >= s.coef("rom_max_rad"), _no_more(s, 1)),
        implied(angle <= s.coef("rom_min_rad"), _no_more(s, -1)),
    )


@_holds("above the brake speed, of joint or drive, a push with the motion falls at the full rate")
def _brake(s: Step) -> str:
    # Raw numbers are halved, half a unit upwards: the brake acts one unit later.
    brake = s.coef("brake_rad_s").next_unit()
    speeds = [s.given(n) for n in ("omega_load_rad_s", "omega_motor_rad_s")]
    return every(
        implied(some(*(w >= brake for w in speeds)), _no_more(s, 1)),
        implied(some(*(w <= -brake for w in speeds)), _no_more(s, -1)),
    )


@_holds("in mode 0 the command falls to 0 at the full rate")
def _off(s: Step) -> str:
    u = s.out("u_Nm")
    falls = every(_no_more(s, 1), _no_more(s, -1))
    return implied(s.given("mode").equals(0), some(u.equals(0), falls))


# Causes: u_Nm 0 and latched in the same step.


@_holds("stop: anything but 0, NaN too, cuts")
def _stop(s: Step) -> str:
    return implied(s.given("stop").differs(0), s.cut)


@_holds("an input that is NaN, outside its port's range or not whole, or request_ok not 1, cuts")
def _input_invalid(s: Step) -> str:
    bad = [
        negated(s.given(p.name).inside(Fraction(p.low), Fraction(p.high))) for p in s.block.inputs
    ]
    for name, most in (("mode", 2), ("rearm", 7), ("doubt", 3)):
        bad.append(negated(some(*(s.given(name).equals(k) for k in range(most + 1)))))
    bad.append(s.given("request_ok").differs(1))
    return implied(some(*bad), s.cut)


@_holds("sensing_ok, clock_ok or coeffs_ok, anything but 1, cuts")
def _sensing(s: Step) -> str:
    names = ("sensing_ok", "clock_ok", "coeffs_ok")
    return implied(some(*(s.given(n).differs(1) for n in names)), s.cut)


@_holds("a doubt cuts")
def _doubt(s: Step) -> str:
    return implied(s.given("doubt").differs(0), s.cut)


@_holds("late_level above what is bridged, NaN too, cuts")
def _late(s: Step) -> str:
    return implied(negated(s.given("late_level") <= LATE_MOST), s.cut)


@_holds(f"stamp 0, or no new stamp for {STALE_PERIODS} control periods, cuts; an old stamp ages")
def _control_stale(s: Step) -> str:
    beat, age = s.given("control_beat"), s.before("age")
    same = beat.equals(s.before("beat_last"))
    old = every(same, age >= s.limit.stale_ticks - 1)
    more = some(s.after("age") >= age.plus(Fraction(1)), s.after("age") >= s.limit.stale_ticks)
    aged = implied(same, more)
    return every(implied(some(beat < 1, old), s.cut), some(s.cut, aged))


@_holds("deflection beyond the limit, compiled or narrowed, cuts")
def _deflection(s: Step) -> str:
    apart = s.given("theta_motor_rad") - s.given("theta_load_rad")
    narrowed = s.coef("theta_max_rad")
    found = [s.beyond("theta_rad", s.limit.theta_max_rad)]
    found += [s.above(s.given("theta_rad"), narrowed), s.above(apart, narrowed)]
    found += [apart > s.limit.theta_max_rad, apart < -s.limit.theta_max_rad]
    return implied(some(*found), s.cut)


@_holds("interaction torque beyond the limit, compiled or narrowed, cuts")
def _torque(s: Step) -> str:
    found = s.beyond("tau_Nm", s.limit.tau_max_Nm)
    return implied(some(found, s.above(s.given("tau_Nm"), s.coef("tau_max_Nm"))), s.cut)


@_holds("speed of joint or drive beyond the limit, compiled or narrowed, cuts")
def _speed(s: Step) -> str:
    found = []
    for name in ("omega_load_rad_s", "omega_motor_rad_s"):
        found.append(s.beyond(name, s.limit.omega_max_rad_s))
        found.append(s.above(s.given(name), s.coef("omega_max_rad_s")))
    return implied(some(*found), s.cut)


@_holds("a joint beyond the range of motion and its margin, compiled or narrowed, cuts")
def _range_of_motion(s: Step) -> str:
    angle, k = s.given("theta_load_rad"), s.limit
    found = [angle > k.rom_max_rad + k.rom_margin_rad, angle < k.rom_min_rad - k.rom_margin_rad]
    found += [angle > s.coef("trip_high_rad"), angle < s.coef("trip_low_rad")]
    return implied(some(*found), s.cut)


@_holds("energy_J above the limit, compiled or narrowed, cuts")
def _energy(s: Step) -> str:
    energy = s.out("energy_J")
    return implied(some(energy > s.limit.energy_J, energy > s.coef("energy_max_J")), s.cut)


@_holds("a coefficient outside its compiled bounds, NaN too, or ends turned round, cuts")
def _coefficients(s: Step) -> str:
    bad = [
        negated(s.coef(p.name).inside(Fraction(p.low), Fraction(p.high)))
        for p in s.block.coefficients
    ]
    bad.append(negated(s.coef("rom_min_rad") < s.coef("rom_max_rad")))
    return implied(some(*bad), s.cut)


@_holds("a state outside its range, or at odds with another, cuts; the reason is 2")
def _memory(s: Step) -> str:
    bad = []
    for p in s.block.state:
        low, high = Fraction(p.low), Fraction(p.high)
        if p.size > 1:
            # All elements are checked by the sum of their magnitudes.
            low, high = -high * p.size * Fraction("1.002"), high * p.size * Fraction("1.002")
        bad += [negated(s.before(p.name, i).inside(low, high)) for i in range(p.size)]
    key, fault, last = (s.before(n) for n in ("key", "fault_stored", "u_last_Nm"))
    bad.append(negated(some(key.equals(0), key.equals(KEY))))
    bad.append(every(key.equals(KEY), fault.differs(0)))
    bad.append(every(key.equals(0), some(negated(fault >= 1), last.differs(0))))
    bad += [(s.before(one) + s.before(other)).differs(total) for one, other, total in PAIRS[:2]]
    # Raw numbers of the last command may be one unit apart: half a unit rounds to none.
    apart = s.before("u_last_Nm") + s.before("u_mirror_Nm")
    unit = 0 if apart.fraction is None else Fraction(1, 2**apart.fraction)
    bad.append(some(apart > unit, apart < -unit))
    return implied(some(*bad), every(s.cut, s.out("fault").equals(int(Fault.STATE_CORRUPT))))


@_holds("a cause that the status word shows cuts, and so does every reason")
def _shown_cause(s: Step) -> str:
    names = [f.name for f in next(p for p in s.block.outputs if p.name == "status").flags]
    causes = [*names[: names.index("TORQUE_CLIPPED")], "CLOCK", "LATE", "COEFFICIENTS"]
    causes += names[names.index("COEFFICIENTS") + 1 :]
    return implied(some(*[s.flag(n) for n in causes], s.out("fault").differs(0)), s.cut)


# The latch.


@_holds("nothing is released but with mode 0, rearm one more, command 0, a closed whole memory")
def _release(s: Step) -> str:
    last, now = s.before("rearm_last"), s.given("rearm")
    following = some(*(every(last.equals(k), now.equals((k + 1) % 8)) for k in range(8)))
    conditions = every(
        s.given("mode").equals(0),
        s.given("u_command_Nm").equals(0),
        s.given("stop").equals(0),
        following,
        s.before("key").equals(0),
        s.before("fault_stored") >= 1,
        s.out("fault").equals(0),
    )
    return implied(every(s.runs, s.before("key").differs(KEY)), conditions)


@_holds("without the released key in memory there is no torque, not even in the step of release")
def _latched_no_torque(s: Step) -> str:
    return implied(s.before("key").differs(KEY), s.out("u_Nm").equals(0))


PAIRS = (
    ("fault_stored", "fault_mirror", MIRROR),
    ("rearm_last", "rearm_mirror", MIRROR),
    ("u_last_Nm", "u_mirror_Nm", 0),
)


def _agree(of: Callable[[str], Number]) -> str:
    """What is stored twice is the same."""
    return every(*((of(one) + of(other)).equals(total) for one, other, total in PAIRS))


@_holds("the first reason stays until the release")
def _first_reason(s: Step) -> str:
    whole = _agree(s.before)
    closed = every(s.before("key").equals(0), s.before("u_last_Nm").equals(0))
    inside = every(
        *(
            s.before(p.name, i).inside(Fraction(p.low), Fraction(p.high) / p.size)
            for p in s.block.state
            for i in range(p.size)
        )
    )
    same = s.after("fault_stored").equals(s.before("fault_stored"))
    held = every(whole, closed, inside, s.before("fault_stored") >= 1, s.after("key").equals(0))
    return implied(held, same)


@_holds("a new reason is the smallest of what the status word shows")
def _new_reason(s: Step) -> str:
    cuts = every(s.before("key").equals(KEY), s.latched)
    order = [
        *("STATE_REPAIRED", "TUNABLE_INVALID", "STOPPED", "INPUT_INVALID", "SENSING_LOST"),
        *("CONTROL_STALE", "DEFLECTION", "INTERACTION_TORQUE", "SPEED", "RANGE_OF_MOTION"),
        *("ENERGY", "CLOCK", "LATE", "COEFFICIENTS", "SWINGS", "ROUGH", "STUCK_BIT"),
    ]
    earlier: list[str] = []
    claims = []
    for code, name in enumerate(order, start=int(Fault.STATE_CORRUPT)):
        first = every(s.flag(name), *(negated(e) for e in earlier))
        claims.append(implied(first, s.out("fault").equals(code)))
        earlier.append(s.flag(name))
    return implied(cuts, every(*claims))


@_holds("torque, reason, key and status word agree: open with reason 0, or cut with a reason")
def _agreement(s: Step) -> str:
    opened = every(s.after("key").equals(KEY), s.out("fault").equals(0))
    shown = negated(s.flag("FAULT_LATCHED"))
    same = every(
        s.out("fault").equals(s.after("fault_stored")), s.out("u_Nm").equals(s.after("u_last_Nm"))
    )
    return every(same, some(s.cut, every(opened, shown)))


@_holds("memory of zeros is latched")
def _zero_memory(s: Step) -> str:
    zero = every(*(s.before(p.name, i).equals(0) for p in s.block.state for i in range(p.size)))
    return implied(zero, s.cut)


@_holds("the memory that init writes is latched with reason 1, whatever comes first")
def _initial_memory(s: Step) -> str:
    start = every(*(now.equals(written) for now, written in s.initial))
    return implied(start, every(s.cut, s.out("fault").equals(int(Fault.NOT_ARMED))))


@_holds("a whole request is remembered, so that it counts once")
def _request_spent(s: Step) -> str:
    now, corrupt = s.given("rearm"), s.flag("STATE_REPAIRED")
    seen = some(*(now.equals(k) for k in range(8)))
    remembered = s.after("rearm_last").equals(now)
    unknown = s.after("rearm_last").equals(UNKNOWN)
    return every(implied(every(seen, negated(corrupt)), remembered), implied(corrupt, unknown))


# Numbers.


def _range(x: Number, port: Port) -> str:
    return x.inside(Fraction(port.low), Fraction(port.high))


@_holds("every output but the energy is a number inside its port's range: no NaN, no infinity")
def _outputs_in_range(s: Step) -> str:
    ports = [p for p in s.block.outputs if p.name not in ("status", "energy_J")]
    return every(*(_range(s.out(p.name), p) for p in ports))


@_holds("energy_J is a finite number, not below 0")
def _energy_is_number(s: Step) -> str:
    energy = s.out("energy_J")
    return every(energy.finite(), energy >= 0)


@_holds("every state after the step is a number, inside its port's range unless of a vector")
def _states_in_range(s: Step) -> str:
    # An element of a vector need only be a number: all are checked by their sum.
    return every(
        *(
            s.after(p.name, i).finite() if p.size > 1 else _range(s.after(p.name), p)
            for p in s.block.state
            for i in range(p.size)
        )
    )


@_holds("the memory that a step leaves agrees with itself")
def _own_memory(s: Step) -> str:
    key = s.after("key")
    released = every(key.equals(KEY), s.after("fault_stored").equals(0))
    closed = every(key.equals(0), s.after("fault_stored") >= 1, s.after("u_last_Nm").equals(0))
    return every(_agree(s.after), some(released, closed))


@_holds("a counter never falls: it stays at its maximum")
def _counters(s: Step) -> str:
    return every(*(f"(bvule {a} {b})" for a, b in s.counters))


# Not empty: what must be possible, or the properties would say nothing.


def _runs_up(s: Step) -> str:
    # At one place: a search for factors is long.
    rest = dict.fromkeys(("theta_rad", "tau_Nm", "omega_load_rad_s", "omega_motor_rad_s"), 0)
    place = rest | {"theta_load_rad": 1, "theta_motor_rad": 1}
    ends = {"rom_max_rad": 2, "rom_gain_Nm_rad": 1, "brake_rad_s": 8, "speed_gain_Nms_rad": 1}
    return every(
        *(s.given(n).equals(v) for n, v in place.items()),
        *(s.coef(n).equals(v) for n, v in ends.items()),
        s.out("u_Nm") > s.limit.u_max_Nm * Fraction(9, 10),
        s.runs,
    )


def _is_released(s: Step) -> str:
    return every(s.before("key").equals(0), s.after("key").equals(KEY))


def _each_reason(code: Fault) -> Callable[[Step], str]:
    def formula(s: Step) -> str:
        return every(s.before("key").equals(KEY), s.out("fault").equals(int(code)))

    return formula


POSSIBLE: dict[str, Callable[[Step], str]] = {
    "full torque": _runs_up,
    "release": _is_released,
    **{f"reason {int(f)}": _each_reason(f) for f in Fault if Fault.NOT_ARMED < f < Fault.MOTOR_HOT},
}


@dataclass(frozen=True)
class LimitsVerdict:
    """What was found of one property."""

    name: str
    claim: str
    said: str
    free: str
    example: dict[str, str]


def _asked(step: Step, claim: str, limit_s: int) -> Answer:
    """Look for bits that break a claim, case by case."""
    answers = []
    for case in step.cases:
        found = ask(step.script, every(case, negated(claim)), limit_s)
        if found.said == "sat":
            return found
        answers.append(found)
    return next((a for a in answers if a.said != "unsat"), answers[0])


LEVELS = {"f32": ("+-*/", "*/"), "q31": ("*",)}
SAID = {"unsat": "proven", "sat": "broken"}


def _proved(step: Step, names: list[str], limit_s: int) -> dict[str, Answer]:
    """Answers for some properties: together, and one by one where that fails."""
    answer = _asked(step, every(*(PROPERTIES[n].formula(step) for n in names)), limit_s)
    if answer.said == "unsat" or len(names) == 1:
        return dict.fromkeys(names, answer)
    return {n: _proved(step, [n], limit_s)[n] for n in names}


def prove_limits(
    device: Device,
    real: str,
    names: Sequence[str] = (),
    change: Change | None = None,
    limit_s: int = LIMIT_S,
) -> list[LimitsVerdict]:
    """Ask for each property."""
    c = LimitsC(device, real, change)
    asked = list(names or PROPERTIES)
    found: dict[str, LimitsVerdict] = {}
    for free in LEVELS[real]:
        left = [n for n in asked if n not in found or found[n].said != "proven"]
        step = Step(c, free) if left else None
        for k in range(0, len(left), TOGETHER):
            assert step is not None
            for name, answer in _proved(step, left[k : k + TOGETHER], limit_s).items():
                said = SAID.get(answer.said, "open")
                found[name] = LimitsVerdict(
                    name, PROPERTIES[name].claim, said, free, answer.example
                )
    return [found[n] for n in asked]


def show_possible(
    device: Device, real: str, names: list[str] | None = None
) -> Iterator[LimitsVerdict]:
    """Ask, exactly, for bits with which each thing happens that must be able to."""
    step = Step(LimitsC(device, real))
    for name in names or POSSIBLE:
        found = ask(step.script, POSSIBLE[name](step), LIMIT_S)
        said = {"unsat": "impossible", "sat": "possible"}.get(found.said, "open")
        yield LimitsVerdict(name, "", said, "", found.example)
