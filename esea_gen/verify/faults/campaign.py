"""Fault campaign on the board ``sim``: detection in time, effect on the limb within bounds."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any, Unpack

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from esea_gen.analysis.campaign import Progress, Running, run_cases
from esea_gen.analysis.journal import Configuration, rooms_digest
from esea_gen.board.driven import CURRENT_TICKS
from esea_gen.control.limits.safety import STALE_PERIODS
from esea_gen.device import Device, load_device
from esea_gen.emit.build import device_hash
from esea_gen.emit.states import TIMES_MS
from esea_gen.errors import UserError
from esea_gen.hostlib.library import compile_system
from esea_gen.model.encoder import HELD_MAX
from esea_gen.plotting import BOUND, INK, STYLE
from esea_gen.verify.faults.driven import DrivenRig, below_the_inputs, driver_faults
from esea_gen.verify.faults.emulated import EmulatedFault, emulated_sample
from esea_gen.verify.faults.kinds import INPUT_KINDS, BoardFault, all_faults, words
from esea_gen.verify.faults.rig import (
    CLAMPED,
    COMMON,
    LIMP,
    SCENES,
    SUBJECTS,
    WANTED_EVERY,
    FaultRig,
    FaultScene,
    drawn_moment,
    rig_of,
    scene_of,
)

DEFAULT_RUNS = 2000


@dataclass(frozen=True)
class LimbEnvelope:
    """Load on a limb of 12 Nm/rad after any single fault, until the motor is off and after."""

    torque_Nm: float
    run_out_Nm: float
    energy_J: float


# Shares of the trip, by person, above what a search for the worst fault found: a load-side encoder
# that drifts at 1 to 4 rad/s while the person turns back and moves on (clamped: a controller stuck
# at full torque, docs/fault-injection.md).  Until the motor is off, and after.
FOLLOWS = {LIMP: 1.0, COMMON: 1.0, "30 Nm/rad": 1.2, "60 Nm/rad": 1.2, CLAMPED: 1.2}
FOLLOWS |= {"120 Nm/rad": 1.4, "250 Nm/rad": 1.4}
RUN_OUT = {LIMP: 1.65, COMMON: 1.65, "30 Nm/rad": 2.2, "60 Nm/rad": 3.0, "120 Nm/rad": 3.6}
RUN_OUT |= {"250 Nm/rad": 4.5, CLAMPED: 4.5}


def envelope(device: Device) -> LimbEnvelope:
    safety = device.file.safety
    if safety is None:
        raise UserError(f"{device.origin}: no section [safety].", "Give a device with limits.")
    trip_Nm = safety.tau_max_Nm.value
    return LimbEnvelope(trip_Nm, RUN_OUT[COMMON] * trip_Nm, safety.energy_J.value)


def bound_ticks(device: Device, fault: BoardFault) -> int | None:
    """Ticks from a fault to the drive's end of following, where one is stated."""
    control = device.system.tasks[-1]
    across = control.every + control.release_ticks  # from a measurement to the limits by control
    if fault.place == "stop line":
        return 0  # looked at in every tick
    if fault.place == "operator":
        return TIMES_MS["STOP_OFF"][0]
    if fault.place == "link" or (fault.place == "mode" and fault.kind == "NaN"):
        # A frame with such a mode is none: nothing else comes until the deadline.
        return TIMES_MS["DEADLINE"][0]
    if fault.place == "current":
        return CURRENT_TICKS
    if fault.place.startswith("encoder "):
        return _frame_bound(fault, across)
    if fault.place == "coefficients":
        return across  # the checksum, at each control run
    if fault.place == "clock":
        if fault.kind == "lost ticks":
            return 0  # the tick after the gap
        # From the last release, which may come after the last run.
        stale = STALE_PERIODS * control.every + control.release_ticks - 1
        return stale if fault.amount >= stale else None
    unreadable = fault.kind == "NaN" or (
        fault.place.startswith("frame_error") and fault.kind == "jump" and fault.amount > 0
    )
    if fault.place.startswith(("count_", "frame_error_")) and unreadable:
        gear = "_gear" in fault.place
        return HELD_MAX + (across if gear else 0)
    if fault.kind == "NaN":
        return WANTED_EVERY  # in the step that reads it
    return None


def _frame_bound(fault: BoardFault, across: int) -> int | None:
    # It breaks when the tick's frames have been read, so the first bad ones are the next tick's.
    gear = fault.place.endswith(" gear")
    by_chance = ("one wrong bit", "swapped bytes") if gear else ("swapped bytes",)
    if fault.kind in by_chance:
        return None  # a parity that fits; one frame in 64 whose six bits of checksum do
    # What only the chip knows of its magnet comes with its diagnostics, every other tick.
    told = 3 if fault.kind.startswith("magnet") else 0
    return 1 + HELD_MAX + told + (across if gear else 0)


@dataclass(frozen=True)
class FaultRow:
    place: str
    kind: str
    runs: int
    found: int
    bound_ticks: int | None
    latest_ticks: int | None
    torque_then_Nm: float
    peak_torque_Nm: float
    energy_J: float
    unfound_torque_Nm: float | None
    unfound_energy_J: float | None
    outside: int
    person: str  # of the largest peak


@dataclass(frozen=True)
class FaultRun:
    input: str
    kind: str
    amount: float
    scene: str
    person: str
    at_tick: int
    seed: int
    detected: bool
    bound_ticks: int | None
    found_ticks: int | None
    reason: int
    torque_then_Nm: float
    peak_torque_Nm: float
    energy_J: float
    inside: bool


def _when(r: FaultRun) -> str:
    found = "not found" if r.found_ticks is None else f"found after {r.found_ticks} ticks"
    return found + ("" if r.bound_ticks is None else f", bound {r.bound_ticks}")


@dataclass(frozen=True)
class FaultCampaign:
    device: str
    content: str
    envelope: LimbEnvelope
    runs: tuple[FaultRun, ...]
    emulated: tuple[EmulatedFault, ...] = ()

    @property
    def outside(self) -> list[FaultRun]:
        return [r for r in self.runs if not r.inside]

    def rows(self) -> list[FaultRow]:
        """By place and kind, worst first; of memory, by Block."""
        groups: dict[tuple[str, str], list[FaultRun]] = {}
        for r in self.runs:
            place, _, word = r.input.partition(".")
            name = f"{place} of {word.partition('.')[0]}" if word else place
            groups.setdefault((name, r.kind), []).append(r)
        rows = [_row(place, kind, of) for (place, kind), of in groups.items()]
        return sorted(rows, key=lambda r: -r.peak_torque_Nm)

    def markdown(self) -> list[str]:
        heads = (
            "where", "what", "runs", "found", "bound, ticks", "latest", "until then, Nm",
            "peak, Nm", "of whom", "energy, J", "not found: peak, Nm", "energy, J",
        )  # fmt: skip
        lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
        for r in self.rows():
            cells = [r.place, r.kind, str(r.runs), str(r.found)]
            cells += ["–" if x is None else str(x) for x in (r.bound_ticks, r.latest_ticks)]
            cells += [f"{r.torque_then_Nm:.1f}", f"{r.peak_torque_Nm:.1f}", r.person]
            figures = ((r.energy_J, 2), (r.unfound_torque_Nm, 1), (r.unfound_energy_J, 2))
            cells += ["–" if x is None else f"{x:.{n}f}" for x, n in figures]
            lines.append("| " + " | ".join(cells) + " |")
        return lines

    def table(self) -> list[str]:
        found = sum(r.detected for r in self.runs)
        late = [r for r in self.runs if r.bound_ticks is not None]
        e = self.envelope
        return [
            *self.markdown(),
            f"{self.device}, simulated: {len(self.runs)} faults, {found} found; "
            f"{len(late)} with a stated bound.",
            f"Envelope {e.torque_Nm:g} Nm until the motor is off, {e.run_out_Nm:g} Nm after "
            f"for 12 Nm/rad (each by its own), "
            f"{e.energy_J:g} J; largest {max(r.torque_then_Nm for r in self.runs):.1f} Nm, "
            f"{max(r.peak_torque_Nm for r in self.runs):.1f} Nm, "
            f"{max(r.energy_J for r in self.runs):.1f} J.",
            *(
                f"OUTSIDE: {r.input} {r.kind} {r.amount:g}, {r.scene}, {r.person}, seed {r.seed}, "
                f"tick {r.at_tick}: {_when(r)}, "
                f"{r.peak_torque_Nm:.1f} Nm, {r.energy_J:.1f} J"
                for r in self.outside
            ),
            f"{len(self.outside)} outside.",
            *self._in_the_emulator(),
        ]

    def _in_the_emulator(self) -> list[str]:
        if not self.emulated:
            return []
        same = sum(f.same for f in self.emulated)
        ticks = sum(f.ticks for f in self.emulated)
        return [
            f"In the emulator: {same} of {len(self.emulated)} runs ({ticks} ticks) with the same "
            "motor command in every bit of every tick, and the same fault.",
            *(
                f"DIFFERS in the emulator: {f.input} {f.kind}, {f.scene}: motor command "
                + ("the same" if f.first_difference is None else f"from tick {f.first_difference}")
                + f", fault {f.emulated} for {f.fault}"
                for f in self.emulated
                if not f.same
            ),
        ]

    def figure(self) -> Figure:
        """Every input by every kind: worst torque, and when it was found."""
        return fault_picture(self.device, self.rows(), self.envelope.run_out_Nm)

    def to_dict(self) -> dict[str, Any]:
        return {
            "simulated": True,
            "device": self.device,
            "content": self.content,
            "envelope": asdict(self.envelope),
            "faults": [asdict(r) for r in self.runs],
            "table": [asdict(r) for r in self.rows()],
            "outside": len(self.outside),
            "emulated": [asdict(f) | {"same": f.same} for f in self.emulated],
        }


def _row(place: str, kind: str, of: Sequence[FaultRun]) -> FaultRow:
    found = [r for r in of if r.found_ticks is not None]
    lost = [r for r in of if r.found_ticks is None]
    bounds = {r.bound_ticks for r in of}
    return FaultRow(
        *(place, kind, len(of), len(found)),
        None if None in bounds else max(b for b in bounds if b is not None),
        max((r.found_ticks for r in found if r.found_ticks is not None), default=None),
        max(r.torque_then_Nm for r in of),
        max(r.peak_torque_Nm for r in of),
        max(r.energy_J for r in of),
        max((r.peak_torque_Nm for r in lost), default=None),
        max((r.energy_J for r in lost), default=None),
        sum(not r.inside for r in of),
        max(of, key=lambda r: r.peak_torque_Nm).person,
    )


@lru_cache(maxsize=4)
def loaded(origin: str, controller: str = "") -> Device:
    """A device, loaded once in a process, so that its board is built once."""
    return load_device(origin, controller or None)


def felt_in(
    device: Device, scene: FaultScene, fault: BoardFault, at: int, seed: int, *ticks: Sequence[int]
) -> dict[str, float]:
    """One run; ``found_ticks`` -1 where nothing was found."""
    rig = rig_of(device, DrivenRig if below_the_inputs(fault) else FaultRig)
    felt = asdict(rig.run(scene, fault, at, seed, *ticks))
    return felt | {"found_ticks": -1 if felt["found_ticks"] is None else felt["found_ticks"]}


def run_one(
    device: str, place: str, kind: str, amount: float, word: str, byte: int, **case: Any
) -> dict[str, float]:
    """One run, as the campaign's workers call it."""
    fault = BoardFault(place, kind, amount, word, byte)
    return felt_in(loaded(device), scene_of(case), fault, case["at"], case["seed"])


def campaign_cases(device: Device, origin: str, runs: int, seed: int) -> list[dict[str, Any]]:
    """Cases to run: faults in turn, each with a drawn scene, moment and plant."""
    library = compile_system(device.system, "f32")
    memory = [words(library.dtype(f"{library.prefix}_{kind}_t")) for kind in ("state", "coeffs")]
    # Models of the encoders' chips are of one axis.
    below = driver_faults() if len(device.axes) == 1 else []
    faults = all_faults(device, memory[0], memory[1], seed, runs, below)
    rng = random.Random(seed)
    movers = [p for p in SUBJECTS if p != CLAMPED]
    movers = movers if len(device.axes) == 1 else [COMMON]
    cases = []
    for k, f in enumerate(faults):
        scene = rng.choice(SCENES)
        person = rng.choice(movers) if scene.person == COMMON else scene.person
        at, sign = drawn_moment(rng, person), rng.choice((1, -1))
        drawn = {"scene": scene.name, "person": person, "sign": sign, "at": at}
        drawn["seed"] = seed * 100_000 + k
        cases.append(asdict(f) | {"device": origin} | drawn)
    return cases


def fault_campaign(
    origin: str, *, runs: int = DEFAULT_RUNS, seed: int = 0, **how: Unpack[Running]
) -> FaultCampaign:
    """Let a device's board ``sim`` fail in so many ways, with plant and person in the loop."""
    device = loaded(origin)
    if not device.laws:
        raise UserError(
            f"{device.origin}: has no drive to fail.", "Give one with a drive, such as elbow_drive."
        )
    content = device_hash(device)
    done = run_cases(
        run_one,
        campaign_cases(device, origin, runs, seed),
        configuration=Configuration({"code": rooms_digest(), "device": content}),
        **how,
    )
    limits = envelope(device)
    made = []
    for r in done.results:
        if r.values is None:
            raise UserError(f"{r.case}: {r.failure}", "Correct the cause named above.")
        made.append(_judged(device, limits, r.case, r.values))
    return FaultCampaign(device.name, content, limits, tuple(made))


def with_emulated(
    campaign: FaultCampaign,
    origin: str,
    runs: int,
    seed: int,
    count: int,
    progress: Progress | None = None,
) -> FaultCampaign:
    """The same, with so many of its faults played to an emulated processor."""
    device = loaded(origin)
    cases = campaign_cases(device, origin, runs, seed)
    found = emulated_sample(device, cases, count, seed, progress=progress)
    return replace(campaign, emulated=tuple(found))


def _judged(
    device: Device, limits: LimbEnvelope, case: dict[str, Any], values: dict[str, float]
) -> FaultRun:
    fault = BoardFault(case["place"], case["kind"], case["amount"], case["word"], case["byte"])
    found = None if values["found_ticks"] < 0 else int(values["found_ticks"])
    bound = bound_ticks(device, fault)
    then_Nm, peak_Nm, energy_J = (
        values[k] for k in ("torque_then_Nm", "peak_torque_Nm", "energy_J")
    )
    in_time = bound is None or (found is not None and found <= bound)
    follows, run_out = (limits.torque_Nm * of[case["person"]] for of in (FOLLOWS, RUN_OUT))
    gentle = then_Nm <= follows and peak_Nm <= run_out
    return FaultRun(
        input=fault.input,
        kind=fault.kind,
        amount=fault.amount,
        **{k: case[k] for k in ("scene", "person", "seed")},
        at_tick=case["at"],
        detected=found is not None,
        bound_ticks=bound,
        found_ticks=found,
        reason=int(values["reason"]),
        torque_then_Nm=then_Nm,
        peak_torque_Nm=peak_Nm,
        energy_J=energy_J,
        inside=in_time and gentle and energy_J <= limits.energy_J,
    )


def fault_picture(device: str, rows: Sequence[FaultRow], torque_Nm: float) -> Figure:
    """Inputs by kinds, then other parts: worst torque, and ticks until detection."""
    inputs = [r for r in rows if r.kind in INPUT_KINDS and " of " not in r.place]
    others = [r for r in rows if r not in inputs]
    places = list(dict.fromkeys(r.place for r in inputs))
    heights = [0.45 * len(places) + 1.0, 0.19 * len(others) + 0.5]
    with mpl.rc_context(STYLE):
        figure = Figure((10.5, sum(heights) + 0.6), layout="constrained")
        above, below = figure.subplots(2, 1, height_ratios=heights)
        worst = np.full((len(places), len(INPUT_KINDS)), np.nan)
        for r in inputs:
            at = places.index(r.place), INPUT_KINDS.index(r.kind)
            worst[at] = r.peak_torque_Nm
            text = f"{_found(r)}\n{r.peak_torque_Nm:.1f} Nm"
            ink = "white" if r.peak_torque_Nm > torque_Nm else INK
            above.text(at[1], at[0], text, ha="center", va="center", fontsize=7.5, color=ink)
        above.imshow(worst, cmap="YlOrBr", vmin=0.0, vmax=1.6 * torque_Nm, aspect="auto")
        above.set_xticks(range(len(INPUT_KINDS)), INPUT_KINDS)
        above.set_yticks(range(len(places)), places)
        above.set_title(f"{device}, simulated: latest detection in ticks, largest torque on limb")
        below.barh(range(len(others)), [r.peak_torque_Nm for r in others], color="#f6c667")
        for k, r in enumerate(others):
            below.text(r.peak_torque_Nm + 0.05, k, _found(r), va="center", fontsize=7.5, color=INK)
        below.axvline(torque_Nm, color=BOUND, linewidth=1.2)
        below.set_yticks(range(len(others)), [f"{r.place}, {r.kind}" for r in others], fontsize=7.5)
        below.set_ylim(len(others) - 0.4, -0.6)
        below.set_xlim(0.0, 1.06 * torque_Nm)
        below.set_xlabel("largest torque on the limb (Nm); line: envelope of 12 Nm/rad")
        above.grid(visible=False)
        above.tick_params(length=0)
    return figure


def _found(r: FaultRow) -> str:
    return "not detected" if not r.found else f"{r.latest_ticks} ({r.found}/{r.runs})"
