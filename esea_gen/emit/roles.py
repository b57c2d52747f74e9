"""Sources of a System's inputs on a board, and signals that the board itself uses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from esea_gen.language.system import External, Signal, System, Task

MOST_COUPLINGS = 4  # whose life a board counts


@dataclass(frozen=True)
class MotorAxis:
    task: str  # that runs every tick and tells of it
    u: str  # its outputs: what the motor gets, why it holds
    tau_hold: str  # what holds the set torque, and what of that the blend is worth
    tau_blend: str
    fault: str
    tau_desired: str
    added: tuple[str, ...]  # outputs that are added to what is wanted


@dataclass(frozen=True)
class ZeroedEncoder:
    """An encoder whose zero a calibration sets."""

    instance: str
    block: str
    task: str
    theta: str
    status: str


@dataclass(frozen=True)
class CountedCoupling:
    """A coupling whose life is counted: where a run of its task tells of it."""

    sensor: str
    task: str  # that runs every tick
    side: str  # ``in`` or ``out``, the struct that has its deflection
    theta: str
    tau: str
    block: str  # Block and status word that say whether to believe it, and by what bits
    status: str
    flags: tuple[str, ...]
    most_rad: float


@dataclass(frozen=True)
class BoardRoles:
    """Sources of a System's inputs on a board's clock, and outputs that the board itself reads."""

    axes: tuple[MotorAxis, ...]  # its motors, each with limits before it
    measured: tuple[External, ...]  # inputs that its drivers give
    wanted: tuple[External, ...]
    encoders: tuple[ZeroedEncoder, ...]
    couplings: tuple[CountedCoupling, ...]

    @property
    def drive(self) -> bool:
        return bool(self.axes)

    def counts(self, encoder: str) -> tuple[int, ...]:
        """Places among ``measured`` of the counts of one encoder of each axis: ``motor``."""
        names = [f"{x.name}_" for x in self.measured]
        return tuple(k for k, n in enumerate(names) if n.startswith(f"count_{encoder}_"))

    @property
    def wanted_names(self) -> tuple[str, ...]:
        return tuple(x.name for x in self.wanted)


def sensing_tasks(system: System) -> tuple[Task, ...]:
    """Tasks that measure, every tick; control may run as often."""
    return tuple(t for t in system.tasks if not t.name.startswith("control"))


def board_roles(system: System) -> BoardRoles:
    """Roles of a System's inputs; with a motor all but counts and frame words are commands.

    Without one only ``stop`` is, which the board itself gives to whatever limits there are.
    """
    inputs = {x.name: x for t in system.tasks for x in system.task_inputs(t)}
    drive = "rearm" in inputs
    measured = [
        x
        for x in inputs.values()
        if (x.name.startswith(("count_", "frame_error_", "motor_")) if drive else x.name != "stop")
    ]
    return BoardRoles(
        tuple(_axis(system, t) for t in sensing_tasks(system)) if drive else (),
        tuple(measured),
        tuple(x for x in inputs.values() if x not in measured),
        tuple(e for t in sensing_tasks(system) for e in _encoders(system, t)),
        tuple(c for t in sensing_tasks(system) for c in _couplings(system, t))[:MOST_COUPLINGS],
    )


def _axis(system: System, task: Task) -> MotorAxis:
    outputs = system.task_outputs(task)
    fault = next(x for x in outputs if x.signals[0].port == "fault")
    told = {x.signals[0]: x.name for x in outputs}
    added = [x for x in outputs if x.name.startswith("tau_impairment_")]
    return MotorAxis(
        task.name,
        told[Signal(fault.signals[0].instance, "u_Nm")],
        next(x.name for x in outputs if x.name.startswith("tau_hold_")),
        next(x.name for x in outputs if x.name.startswith("tau_blend_")),
        fault.name,
        next(x.name for x in system.task_inputs(task) if x.name.startswith("tau_desired_")),
        tuple(x.name for x in added),
    )


def _encoders(system: System, task: Task) -> Iterator[ZeroedEncoder]:
    outputs = {x.signals[0]: x.name for x in system.task_outputs(task)}
    for name in task.blocks:
        block = system.blocks[name]
        if {"zero_rad", "zeroed"} <= {t.name for t in block.tunables}:
            told = (outputs[Signal(name, port)] for port in ("theta_rad", "status"))
            yield ZeroedEncoder(name, block.name, task.name, *told)


def _told(system: System, theta: Any, outputs: Mapping[Signal, External]) -> Any:
    # Report the raw deflection, not the smoothed one.
    while isinstance(theta, Signal) and theta not in outputs:
        sink = Signal(theta.instance, "theta_rad")
        if sink.port not in (p.name for p in system.blocks[sink.instance].inputs):
            break
        theta = system.feed(sink)
    return theta


_NOT_BELIEVED = ("INPUT_INVALID", "ENCODER_UNUSABLE")


def _couplings(system: System, task: Task) -> Iterator[CountedCoupling]:
    # Torque sensors of a task whose deflection and torque are told of each run.
    outputs = {x.signals[0]: x for x in system.task_outputs(task)}
    for name in task.blocks:
        sink, tau = Signal(name, "theta_rad"), outputs.get(Signal(name, "tau_Nm"))
        if tau is None or sink.port not in (p.name for p in system.blocks[name].inputs):
            continue
        theta = _told(system, system.feed(sink), outputs)
        side = "in" if isinstance(theta, External) else "out"
        told = outputs.get(theta) if isinstance(theta, Signal) else theta
        speaks = theta.instance if isinstance(theta, Signal) else name
        status = outputs.get(Signal(speaks, "status"))
        if not isinstance(told, External) or status is None:
            continue
        flags = tuple(f.name for f in status.port.flags if f.name in _NOT_BELIEVED)
        block = system.blocks[speaks].name
        most_rad = min(-told.port.low, told.port.high)
        names = told.name, tau.name, block, status.name
        yield CountedCoupling(name, task.name, side, *names, flags, most_rad)
