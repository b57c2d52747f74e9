"""The steps of a commissioning, in the order in which they are safe."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from esea_gen.device import Device
from esea_gen.errors import UserError
from esea_gen.model.sensing import of_axis
from esea_gen.studies.torque_check.check import RECORD_S, SETTLE_S, CheckDecision, TorqueCheck
from esea_gen.studies.torque_check.procedure import (
    LIMITS,
    REPEATS,
    ZERO_LIMIT,
    KnownLoad,
    judged_from_Nm,
)
from esea_host.commissioning.bench import Capture, CommissioningBench, HandAct
from esea_host.commissioning.drive import (
    AGAIN,
    commanded_work,
    judged_encoders,
    judged_sides,
    motor_sign,
    turned_friction,
)
from esea_host.commissioning.record import StepResult, against, new_picture, over, torque_bars
from esea_host.commissioning.startup import FRICTION_SHARE, GearPath, StartupCheck, travel
from esea_host.commissioning.swinging import (
    LENGTH_S,
    SWING_TURN_S,
    SwungMass,
    hangs_within,
    judged_swings,
    require_masses,
    wanted_Nm,
)

ZERO_TRIES, LOOK_S = 5, 1.0
REST_RAD = 0.02  # about a degree: a joint that is held still by hand
TURN_RAD_S, FRICTION_RAD_S = 0.5, (0.4, 0.8, 1.4)
REACH_SHARE = 0.8  # of the travel that is left towards positive angles
PUSH_NM_SHARE = 0.12  # of full scale: enough to wind the rubber up, and nobody is in the joint
PULL_SHARE = 0.1  # of full scale
ARM_KGM2 = 0.02  # of an arm in the virtual machine
COUNT_TRIES = 3  # to record a phase in which no count changes half way
TIME = "time, s"


@dataclass(frozen=True)
class StepOptions:
    known: KnownLoad | None = None  # the hanging mass
    settle_s: float = SETTLE_S
    record_s: float = RECORD_S
    repeats: int = REPEATS
    second: KnownLoad | None = None  # another mass on the same arm
    hangs_rad: float | None = None  # where it hangs straight down; None: middle of the travel
    arm_Nm: float = 0.0  # the arm's own weight times its distance


@dataclass(frozen=True)
class CommissioningStep:
    name: str
    title: str
    finds: str  # what it is for
    run: Callable[[CommissioningBench, StepOptions], StepResult] = field(repr=False)  # does it
    motor: bool = False  # whether the motor moves
    needs: tuple[tuple[str, str], ...] = ()  # fields of the options, and how each is given
    loads: Callable[[Device, StepOptions], object] = lambda *_: None  # refuses unsuitable masses

    def lacks(self, options: StepOptions) -> str:
        """How to supply the missing requirements; empty if there are none."""
        return ", ".join(how for name, how in self.needs if getattr(options, name) is None)


# -- zero -----------------------------------------------------------------------------------------


def _zero(bench: CommissioningBench, _: StepOptions) -> StepResult:
    bench.ask(
        HandAct(
            "rest", "Put the joint at its zero, nothing on it, nobody in it; let it stand still."
        )
    )
    bench.wait(LOOK_S)
    tries = 0
    while tries < ZERO_TRIES:
        tries += 1
        bench.device.zero()
        bench.wait(0.3)
        if bench.reach("READY"):
            break
        bench.say(f"It was not still ({bench.device.state()}): once more.")
    c = bench.capture(LOOK_S)
    state = bench.device.state()
    figure, (above, below) = new_picture("angles after zeroing", bench.device.simulated, 2)
    mrad = [(n, 1e3 * c[f"theta_{n}_rad"]) for n in ("motor", "load")]
    over(above, c.time_s, mrad, TIME, "joint, mrad", 1e3 * REST_RAD)
    limit_Nm = ZERO_LIMIT.torque_Nm(bench.board.tau_full_scale_Nm, 0.0)
    over(below, c.time_s, [("sensed torque", c["tau_Nm"])], TIME, "Nm", limit_Nm)
    if state != "READY":
        fix = "Hold the joint still, and check the encoders' status words in the live view."
        problem = f"The board is {state} after {tries} tries, not READY.", fix
        return StepResult("zero", ZERO, figure, problem=problem, found={"tries": tries})
    at, spread = (max(f(c[f"theta_{n}_rad"]) for n in ("motor", "load")) for f in (_off, np.ptp))
    torque = abs(float(np.mean(c["tau_Nm"])))
    checks = (
        StartupCheck("zero", "joint away from its zero", at, REST_RAD, "rad", AGAIN),
        StartupCheck("zero", "motion at rest", float(spread), REST_RAD, "rad", AGAIN),
        StartupCheck(
            "zero", "sensed torque with nothing on it", torque, limit_Nm, "Nm",
            "Remove what loads the joint, and zero again.",
        ),
    )  # fmt: skip
    found = {"tries": tries, "joint_rad": at, "torque_Nm": torque}
    return StepResult("zero", ZERO, figure, checks, found=found)


def _off(x: np.ndarray) -> float:
    return abs(float(np.mean(x)))


# -- turned by hand -------------------------------------------------------------------------------


def _reach_rad(device: Device) -> float:
    if device.laws:
        return REACH_SHARE * travel(device)[1]
    joint = device.file.joint
    assert joint is not None  # a board's device has one
    return REACH_SHARE * joint.theta_max_rad.value


def _turned(bench: CommissioningBench, how: str, speeds: tuple[float, ...]) -> Capture:
    bench.make_ready()
    reach = _reach_rad(bench.board)
    # Without a motor play in the coupling is taken up, so that it does not look like an error.
    pull_Nm = 0.0 if bench.drives else PULL_SHARE * bench.board.tau_full_scale_Nm
    legs = [(end, v) for v in speeds for end in (reach, 0.0)]
    path = GearPath.through(legs, bench.device.identity.tick_us * 1e-6)
    lasts_s = len(path) * bench.device.identity.tick_us * 1e-6 + 1.0
    what = "The motor stays off. From now on, for {0:.0f} s, turn the joint by hand at its output"
    if not bench.drives:
        what = (
            "From now on, for {0:.0f} s, with a light steady pull on the load side, turn both "
            "sides of the coupling together by hand"
        )
    text = (
        f"{what.format(lasts_s)}, to {math.degrees(reach):.0f} deg in the positive direction, then "
        f"back: {how}"
    )
    bench.ask(HandAct("turn", text, pull_Nm, path))
    return bench.capture(lasts_s)


def _encoders(bench: CommissioningBench, _: StepOptions) -> StepResult:
    c = _turned(bench, "slowly, twice.", (TURN_RAD_S, TURN_RAD_S))
    r = bench.recording(c)
    figure, (above, below) = new_picture("joint turned by hand", bench.device.simulated, 2)
    sides = [("motor side", r.motor_rad), ("load side", r.load_rad)]
    if bench.drives:
        judged = judged_encoders(bench.board, c, r)
        sides.insert(0, ("motor's encoder", r.gear_rad))
    else:
        judged = judged_sides(r, c["tau_Nm"])
    over(above, c.time_s, sides, TIME, "joint, rad")
    errors = [(f"{side} side", 1e3 * e) for side, e in judged.errors.items()]
    if errors:
        limit = 1e3 * judged.limit_rad
        other = "encoder" if bench.drives else "side"
        over(below, judged.at_rad, errors, "joint, rad", f"off the motor's {other}, mrad", limit)
    return StepResult(
        "encoders", ENCODERS, figure, judged.checks, judged.problem, judged.found
    )  # fmt: skip


def _friction(bench: CommissioningBench, _: StepOptions) -> StepResult:
    speeds = ", then ".join(f"{v:g}" for v in FRICTION_RAD_S)
    c = _turned(bench, f"at about {speeds} rad/s.", FRICTION_RAD_S)
    f = turned_friction(bench.board, bench.recording(c))
    figure, (axes,) = new_picture("torque that turns the drive", bench.device.simulated)
    lines = [("by the rubber", f.rubber_Nm), ("identified friction and inertia", f.model_Nm)]
    over(axes, f.time_s, lines, TIME, "Nm at the joint")
    a = bench.board.file.actuator
    assert a is not None
    full_Nm = a.gear_ratio.value * a.u_max_Nm.value
    lost = f.fc.value + f.fv.value * max(FRICTION_RAD_S)
    look = "Check for a rubbing cable, a tight bearing, too much tension."
    checks = (
        StartupCheck(
            "friction", f"friction at {max(FRICTION_RAD_S):g} rad/s, of the motor's largest torque",
            100 * lost / full_Nm, 100 * FRICTION_SHARE, "%", look,
        ),
        StartupCheck(
            "friction", "Coulomb friction, of the device file's value",
            100 * f.fc.value / a.fc_Nm.value, 200.0, "%",
            f"{look}  If it is the machine's own, write it into the device file.",
        ),
        StartupCheck(
            "friction", "half the interval of the Coulomb friction, of its value",
            100 * f.fc.half / abs(f.fc.value), 30.0, "%",
            "Turn it evenly, and to and fro at each speed.",
        ),
        StartupCheck(
            "friction", "negative Coulomb friction", max(0.0, -f.fc.value), 0.0, "Nm",
            "Friction cannot drive the motor: repeat the steps 'encoders' and 'torque'.",
        ),
    )  # fmt: skip
    found = {f"fc_{k}": v for k, v in f.fc.to_dict("Nm").items()}
    found |= {f"fv_{k}": v for k, v in f.fv.to_dict("Nms_rad").items()}
    return StepResult("friction", FRICTION, figure, checks, found=found)


# -- motor sign -----------------------------------------------------------------------------------


def _sign(bench: CommissioningBench, _: StepOptions) -> StepResult:
    bench.make_ready()
    most_Nm = PUSH_NM_SHARE * bench.board.tau_full_scale_Nm
    bench.ask(
        HandAct(
            "clamp",
            "Clamp the output where it is, nobody in the joint. The motor will wind the rubber up "
            f"a little, to {most_Nm:.2g} Nm, one way and the other.",
        )
    )
    knots = np.array([0, 0.2, 0.8, 1.4, 2.6, 3.2, 3.8])
    pushes = most_Nm * np.array([0, 0, 1, 1, -1, -1, 0])
    c = bench.driven(float(knots[-1]), lambda at: float(np.interp(at, knots, pushes)))
    fault = bench.device.fault()
    figure, (above, below) = new_picture("pushed against a clamp", bench.device.simulated, 2)
    r = bench.recording(c)
    moved = [("motor's encoder", 1e3 * (r.gear_rad - r.gear_rad[0]))]
    moved.append(("motor side", 1e3 * (r.motor_rad - r.motor_rad[0])))
    moved.append(("load side", 1e3 * (r.load_rad - r.load_rad[0])))
    over(above, c.time_s, moved, TIME, "joint, mrad")
    torques = [("wanted", c["tau_desired_Nm"]), ("sensed", c["tau_Nm"])]
    over(below, c.time_s, torques, TIME, "Nm at the joint")
    work_J, turned_J = commanded_work(bench.board, r)
    found = {"command_work_J": work_J, "work_either_way_J": turned_J, "fault": fault}
    problem = motor_sign(r, c["tau_desired_Nm"], most_Nm, work_J, turned_J)
    if fault and (problem is None or problem[1] == AGAIN):
        said = f"The board switched itself off: {bench.fault_name(fault)}."
        problem = said, "Remove its cause, then acknowledge it: esea-host view, Ctrl+L."
    checks: tuple[StartupCheck, ...] = ()
    if problem is None:
        error_Nm = float(np.sqrt(np.mean((c["tau_Nm"] - c["tau_desired_Nm"])[200:] ** 2)))
        checks = (
            StartupCheck(
                "sign", "rms error of the torque", error_Nm, 0.5 * most_Nm,
                "Nm", "Check in the live view which limit acts, and whether the cable is tight.",
            ),
        )  # fmt: skip
        found["torque_error_rms_Nm"] = error_Nm
    return StepResult("sign", SIGN, figure, checks, problem, found)


# -- known mass -----------------------------------------------------------------------------------


def _load_check(device: Device, options: StepOptions) -> TorqueCheck:
    assert options.known is not None
    times = {"settle_s": options.settle_s, "record_s": options.record_s}
    return TorqueCheck(device, options.known, repeats=options.repeats, **times)


def _torque(bench: CommissioningBench, options: StepOptions) -> StepResult:
    check = _load_check(bench.board, options)
    bench.make_ready()
    if check.known.torque_Nm < (least_Nm := judged_from_Nm(bench.board)):
        bench.say(f"The load must be at least {least_Nm:.3g} Nm; with less, no sensor passes.")
    needed_s = check.settle_s + check.record_s + 0.2
    parts = []
    again: list[str] = []
    while (step := check.next_step) is not None:
        sign = {"zero": 0, "plus": 1, "minus": -1}[step.kind]
        number = f"{len(check.measurements) + 1} of {len(check.steps)}"
        text = "Leave it as it is." if again[-1:] == [step.label] else step.text
        held = "motor" if bench.drives else "motor side"
        text = f"{number}. Hold the {held} still. {text} Then wait {needed_s:.0f} s."
        bench.ask(HandAct("load", text, torque_Nm=sign * check.known.torque_Nm))
        c = bench.capture(needed_s)
        # What hangs on the joint and what the rubber does to the joint are in balance.
        hung_Nm = -c["tau_Nm"]
        try:
            found = check.record(step.label, c.time_s, hung_Nm, "esea-host commission")
        except UserError as refused:
            bench.say(str(refused))
            continue
        drifts = abs(found.drift_Nm) > check.limit_Nm("drift", step.kind)
        if drifts and again.count(step.label) < COUNT_TRIES and _stands(bench.board, c, check):
            check.undo()
            again.append(step.label)
            bench.say(f"{found.drift_Nm:+.3f} Nm of drift, by one count of an encoder: once more.")
            continue
        parts.append(hung_Nm)
    figure, (above, below) = new_picture("hanging mass", bench.device.simulated, 2)
    every = max(1, sum(map(len, parts)) // 4000)
    tau = np.concatenate(parts)[::every]
    tick_s = bench.device.identity.tick_us * 1e-6
    seconds = every * tick_s * np.arange(len(tau))
    over(above, seconds, [("load as sensed", tau)], "recorded time, s", "Nm", check.known.torque_Nm)
    hints = {x.name: f"{x.what[0].upper()}{x.what[1:]}. {x.reason[0].upper()}{x.reason[1:]}."
             for x in LIMITS}  # fmt: skip
    if check.suspects is not None:
        hints["accuracy"] = " ".join(check.suspects)
    worst: dict[str, CheckDecision] = {}
    for d in sorted(check.decisions, key=lambda d: d.value_Nm / d.limit_Nm):
        worst[d.criterion] = d
    named = [worst[n] for n in dict.fromkeys(d.criterion for d in check.decisions)]
    torque_bars(below, {d.criterion: d.value_Nm / d.limit_Nm for d in named})
    checks = tuple(
        StartupCheck("torque", d.criterion, d.value_Nm, d.limit_Nm, "Nm", hints[d.criterion])
        for d in named
    )
    all_found = {"torque_check": check.to_dict(), "recorded_again": again}
    problem = check.doubt if check.verdict == "cannot judge" else None
    if problem is not None:
        problem = f"Cannot judge. {problem[0]}", problem[1]
    return StepResult("torque", TORQUE, figure, checks, problem, all_found)


def _stands(device: Device, c: Capture, check: TorqueCheck) -> bool:
    # Whether no joint encoder moved by more than a count while it was judged.  One that changes
    # half way makes 1.5 times its torque along the straight line: more than the limit allows.
    judged = (c.time_s >= check.settle_s) & (c.time_s < check.settle_s + check.record_s)
    full = 1 << round(device.file.encoder.resolution_bits.value)
    counts = (np.unwrap(c[f"count_{side}"][judged], period=full) for side in ("motor", "load"))
    return all(np.ptp(count) < 1.5 for count in counts)


# -- adaptation -----------------------------------------------------------------------------------


def _masses(device: Device, options: StepOptions) -> list[KnownLoad]:
    masses = [known for known in (options.known, options.second) if known is not None]
    require_masses(device, *masses)
    return masses


def _adaptation(bench: CommissioningBench, options: StepOptions) -> StepResult:
    device = bench.board
    masses = _masses(device, options)
    hangs_rad = hangs_within(device, options.hangs_rad)
    swings: list[SwungMass] = []
    fault = 0
    for known in masses:
        if not fault:
            swings.append(_swung(bench, known, options.arm_Nm, hangs_rad))
            fault = bench.device.fault()
    figure, (above, below) = new_picture("masses swung by the drive", bench.device.simulated, 2)
    if fault:
        r = swings[-1].recording
        over(above, r.tick_s * np.arange(len(r)), [("load side", r.load_rad)], TIME, "joint, rad")
        below.remove()
        problem = (
            f"The board switched itself off: {bench.fault_name(fault)}.",
            f"Check that {masses[len(swings) - 1].mass_kg:g} kg hung on the arm, straight down "
            f"at {math.degrees(hangs_rad):.0f} deg.  Acknowledge the fault, and repeat the step.",
        )
        return StepResult("adaptation", ADAPTATION, figure, (), problem, {"fault": fault})
    judged = judged_swings(device, swings, hangs_rad)
    note = "Rejected: nothing was set on the board. The most likely cause is the first fix."
    if all(c.passed for c in judged.checks):
        for name, value in (judged.tunables | {"share": 1.0}).items():
            bench.device.set(of_axis(f"adaptation.{name}", bench.axis), value)
        values = ", ".join(f"{n} {v:.3f}" for n, v in judged.tunables.items())
        note = (
            f"Set on the board: {values}, share 1. To keep them without power: "
            "esea-host parameters ADDRESS --keep."
        )
    labels = [f"{known.mass_kg:g} kg" for known in masses]
    against(above, labels, judged.known_Nm, judged.shown_Nm, "stated, Nm", "sensed, Nm")
    left = [("sensed, less what the masses explain", judged.left_Nm)]
    unit = "Nm; dashed: limit, effective"
    over(below, judged.time_s, left, "time in both swings, s", unit, judged.left_limit_Nm)
    return StepResult("adaptation", ADAPTATION, figure, judged.checks, None, judged.found, note)


def _swung(
    bench: CommissioningBench, known: KnownLoad, arm_Nm: float, hangs_rad: float
) -> SwungMass:
    bench.make_ready()
    path = _to(bench, hangs_rad)
    at = f"{math.degrees(hangs_rad):.0f} deg"
    text = f"Turn the joint to {at}, nothing on it. There the arm is to hang straight down."
    bench.ask(HandAct("turn", text, path=path))
    if bench.hands_free:
        bench.wait(len(path) * bench.device.identity.tick_us * 1e-6 + LOOK_S)
    bench.ask(
        HandAct(
            "swing",
            f"Hang {known.mass_kg:g} kg on the arm, {known.arm_m:g} m from the joint; let it come "
            f"to rest, and step back. The motor will swing it for {LENGTH_S:.0f} s, by about 50 "
            "deg either way. Nobody touches it.",
            known.weight_Nm + arm_Nm,
            hangs_rad=hangs_rad,
            inertia_kgm2=known.mass_kg * known.arm_m**2 + ARM_KGM2,
        )
    )
    bench.wait(LOOK_S)
    c = bench.driven(LENGTH_S, lambda at_s: wanted_Nm(at_s, known.weight_Nm + arm_Nm), SWING_TURN_S)
    lasted_s = len(c) * bench.device.identity.tick_us * 1e-6
    if lasted_s < LENGTH_S - 1 and not bench.device.fault():
        said = "".join(f" ({text})" for text in list(bench.device.texts)[-1:])
        raise UserError(
            f"The swing ended after {lasted_s:.1f} s: the board is {bench.device.state()}{said}.",
            "Check the link and who else commands the board, and repeat the step.",
        )
    return SwungMass(known.weight_Nm + arm_Nm, bench.recording(c), c["tau_Nm"])


def _to(bench: CommissioningBench, angle_rad: float) -> GearPath:
    way = angle_rad - float(bench.capture(LOOK_S)["theta_load_rad"][-1])
    legs = [(math.copysign(max(abs(way), REST_RAD), way), TURN_RAD_S)]
    return GearPath.through(legs, bench.device.identity.tick_us * 1e-6)


ZERO, ENCODERS, SIGN = "Zero", "Encoders: direction and error", "Motor sign"
FRICTION, TORQUE, ADAPTATION = "Friction", "Torque of a known mass", "Adaptation to the rubber"
MASS, SECOND = ("known", "--mass KG and --arm M"), ("second", "--second-mass KG")
STEPS = (
    CommissioningStep("zero", ZERO, "the joint's zero, taken at rest", _zero),
    CommissioningStep(
        "encoders", ENCODERS,
        "which way each encoder counts, and how far the motor side's is off over the travel",
        _encoders,
    ),
    CommissioningStep("sign", SIGN, "that the motor turns as commanded", _sign, True),
    CommissioningStep(
        "friction", FRICTION, "friction of drive and cable, felt by a hand", _friction
    ),
    CommissioningStep(
        "torque", TORQUE, "the sensor's accuracy", _torque, False, (MASS,), _load_check
    ),
    CommissioningStep(
        "adaptation", ADAPTATION, "gain and loss of this rubber", _adaptation,
        True, (MASS, SECOND), _masses,
    ),
)  # fmt: skip


# Without a motor.
SENSOR_STEPS = (
    STEPS[0],
    CommissioningStep(
        "encoders", "Encoders: direction, difference",
        "which way each encoder counts, and how far the two differ over the travel", _encoders,
    ),
    STEPS[-2],
)  # fmt: skip


def steps_of(device: Device) -> tuple[CommissioningStep, ...]:
    """Steps for a device; without a motor, those of a sensor."""
    if not device.laws:
        return SENSOR_STEPS
    return STEPS if device.file.adaptation else STEPS[:-1]


def guide(device: Device) -> list[str]:
    reach = math.degrees(_reach_rad(device))
    lines = [
        f"Commissioning of {device.name} ({device.title}); joint free from 0 to {reach:.0f} deg."
    ]
    for k, step in enumerate(steps_of(device), 1):
        motor = "; THE MOTOR MOVES" if step.motor else ""
        lines.append(f"{k}. {step.name}: {step.finds}{motor}.")
    return lines


def run_step(
    bench: CommissioningBench, step: CommissioningStep, options: StepOptions
) -> StepResult:
    if lacks := step.lacks(options):
        raise UserError(f"The step '{step.name}' needs a known mass.", f"Give {lacks}.")
    bench.begin()
    return step.run(bench, options)
