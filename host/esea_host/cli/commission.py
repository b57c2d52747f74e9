"""``commission``: a machine made ready, step by step."""

from __future__ import annotations

import math
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from esea_gen.cli.options import option, writable
from esea_gen.device import board_device
from esea_gen.errors import UserError
from esea_gen.studies.torque_check.procedure import KnownLoad, require
from esea_host.cli.app import app, out, say
from esea_host.cli.options import AddressArgument, DeviceOption, KeyOption
from esea_host.cli.view import need_a_screen
from esea_host.commissioning import (
    STEPS,
    CommissioningBench,
    CommissioningEndedError,
    CommissioningRecord,
    CommissioningStep,
    HandAct,
    StepOptions,
    guide,
    run_step,
    simulated_bench,
    steps_of,
    unit_of,
)
from esea_host.commissioning.record import NAME
from esea_host.connection.address import parse_address, simulated_options
from esea_host.connection.opening import open_device, require_device
from esea_host.recording.replay import loaded_device
from esea_host.simulated import SimulatedBoard

NAMES = ", ".join(s.name for s in STEPS)


@app.command()
def commission(
    address: AddressArgument,
    device: DeviceOption = None,
    key: KeyOption = None,
    step: Annotated[
        list[str] | None, option("--step", f"{NAMES}; repeatable; default: all.")
    ] = None,
    axis: Annotated[str | None, option("--axis", "Axis; default: the first.")] = None,
    folder: Annotated[
        Path | None, option("--record DIR", "Folder; default: commissioning/DEVICE-AXIS.")
    ] = None,
    terminal: Annotated[bool, option("--terminal", "Show no window.")] = False,
    mass: Annotated[float | None, option("--mass", "Known mass, kg.")] = None,
    arm: Annotated[float | None, option("--arm", "Distance from the joint, m.")] = None,
    angle: Annotated[float, option("--angle", "Arm's angle off horizontal, deg.")] = 0,
    settle: Annotated[float, option("--settle", "Wait per load, s.")] = StepOptions.settle_s,
    judge: Annotated[float, option("--judge", "Record per load, s.")] = StepOptions.record_s,
    repeats: Annotated[int, option("--repeats", "Loads in each direction.")] = StepOptions.repeats,
    second_mass: Annotated[
        float | None, option("--second-mass KG", "For 'adaptation': about half of --mass.")
    ] = None,
    hangs: Annotated[
        float | None,
        option("--hangs DEG", "Joint angle at which the arm hangs straight down; default: middle."),
    ] = None,
    arm_weight: Annotated[
        float, option("--arm-weight NM", "The arm's own weight times its distance.")
    ] = 0,
) -> None:
    """Check zero, encoders, motor sign, friction, known mass, adaptation; write a record.

    Without a motor: zero, encoders, known mass.
    """
    if (mass is None) != (arm is None) or (second_mass is not None and arm is None):
        raise UserError("Mass and arm belong together.", "Give --mass KG and --arm M.")
    known = None if mass is None or arm is None else KnownLoad(mass, arm, math.radians(angle))
    second = None if second_mass is None or arm is None else KnownLoad(second_mass, arm)
    if hangs is not None:
        require("--hangs", hangs, -180, 180, "deg", "Give the joint's angle.")
    require("--arm-weight", arm_weight, -50, 50, "Nm", "Give its weight times its distance.")
    hangs_rad = None if hangs is None else math.radians(hangs)
    options = StepOptions(known, settle, judge, repeats, second, hangs_rad, arm_weight)
    _check(step or [], options)
    if not terminal:
        need_a_screen("--terminal")
    with _bench(address, device, key, axis) as bench:
        chosen = _chosen(step or [], bench)
        for one in (s for s in chosen if not s.lacks(options)):
            one.loads(bench.board, options)  # now, not after the steps before it
        machine = f"{bench.board.name}-{bench.axis}".rstrip("-")
        unit = unit_of(bench.device)
        record = CommissioningRecord(folder or Path("commissioning") / machine, machine, unit)
        writable(record.folder / NAME)  # now, not after a step
        out.print(record.notice())
        if bench.device.state() == "UNKNOWN":  # a simulated board's time is the bench's
            bench.reach("UNREFERENCED", 1.2)
        if not terminal:
            from esea_host.windows.commission import run_commissioning

            run_commissioning(bench, chosen, options, record)
            last = [record.last(s.name, bench.board.digest) for s in chosen]
            passed = all(entry is not None and entry["passed"] for entry in last)
        else:
            passed = _in_terminal(bench, chosen, options, record)
    all_steps = tuple((s.name, s.title) for s in steps_of(bench.board))
    say(record.summary(all_steps, bench.board.digest))
    out.print(f"record: {record.folder}" if record.entries else "Nothing was recorded.")
    if not passed:
        raise typer.Exit(1)


def _check(names: list[str], options: StepOptions) -> None:
    wrong = [n for n in names if n not in (s.name for s in STEPS)]
    if wrong:
        raise UserError(f"There is no step '{wrong[0]}'.", f"Choose from {NAMES}.")
    for step in STEPS:
        if step.name in names and (lacks := step.lacks(options)):
            raise UserError(f"The step '{step.name}' needs a known mass.", f"Give {lacks}.")


def _chosen(names: list[str], bench: CommissioningBench) -> tuple[CommissioningStep, ...]:
    steps = steps_of(bench.board)
    known = [s.name for s in steps]
    lacks = f"has only the steps {', '.join(known)}"
    require_device(bench.board, lambda d: {*names} <= {s.name for s in steps_of(d)}, lacks)
    return tuple(s for s in steps if not names or s.name in names)


@contextmanager
def _bench(
    address: str, device: str | None, key: Path | None, axis: str | None
) -> Iterator[CommissioningBench]:
    place = parse_address(address, device)
    if place.kind == "file":
        raise UserError("A file cannot be commissioned.", "Give the address of a board.")
    if place.kind == "sim":
        # Hands have to reach the virtual machine: it runs in this process.
        given = simulated_options(place.place, ("plant", "seed"))
        name, seed = place.place.partition("?")[0], int(given.get("seed", 0))
        drives = bool(board_device(loaded_device(name)).laws)
        plant = given.get("plant", "ideal" if drives else None)
        drive = SimulatedBoard(name, plant, "nobody" if drives else None, seed)
        try:
            # Another start than of any earlier one, whose results do not count for it.
            drive.board.lib.sim_unique(1 + secrets.randbelow((1 << 32) - 1))
            drive.restart()
            yield simulated_bench(drive, out.print, axis)
        finally:
            drive.close()
        return
    with open_device(address, device, key) as board:
        yield CommissioningBench(board, _person, out.print, axis=axis)


def _person(act: HandAct) -> None:
    out.print("  Press Return when ready; Ctrl+C ends the step.")
    try:
        input()
    except (KeyboardInterrupt, EOFError):
        raise CommissioningEndedError("The step was ended before it was through.") from None


def _in_terminal(
    bench: CommissioningBench,
    chosen: tuple[CommissioningStep, ...],
    options: StepOptions,
    record: CommissioningRecord,
) -> bool:
    say(guide(bench.board))
    passed = True
    for step in chosen:
        if lacks := step.lacks(options):
            out.print(f"{step.name}: not done; it needs {lacks}")
            continue
        motor = "   THE MOTOR MOVES; Ctrl+C stops it" if step.motor else ""
        out.print(f"\n{step.title}: {step.finds}{motor}")
        try:
            result = run_step(bench, step, options)
        except (CommissioningEndedError, KeyboardInterrupt):
            bench.device.stop(again=True)
            out.print(f"{step.title}: ended; stopping the board")
            return False
        say(result.lines(bench.device.simulated))
        record.add(result, bench.device)
        passed = passed and result.passed
        if not result.passed:
            out.print("Later steps depend on this one: correct it first.")
            break
    return passed
