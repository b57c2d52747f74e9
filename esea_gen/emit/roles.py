"""Who gives a System's inputs on a board, and what the board itself looks at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from esea_gen.language.system import External, Signal, System

MOST_COUPLINGS = 4  # whose life a board counts


@dataclass(frozen=True)
class ZeroedEncoder:
    """An encoder whose zero a calibration sets.

    theta, status: the outputs that tell of it.
    """

    instance: str
    block: str
    theta: str
    status: str


@dataclass(frozen=True)
class CountedCoupling:
    """A coupling whose life is counted: where the first task's run tells of it.

    sensor: its torque sensor's instance.
    side: ``in`` or ``out``, the struct that has its deflection.
    block, status, flags: Block and status word that say whether to believe it, and by what bits.
    most_rad: largest deflection.
    """

    sensor: str
    side: str
    theta: str
    tau: str
    block: str
    status: str
    flags: tuple[str, ...]
    most_rad: float


@dataclass(frozen=True)
class BoardRoles:
    """Who gives a System's inputs on the board's own clock, and what the board itself looks at.

    drive: whether there is a motor, with limits before it.
    measured: inputs that its drivers give; the others are wanted by the host.
    first: the task whose outputs the board looks at.
    """

    drive: bool
    measured: tuple[External, ...]
    wanted: tuple[External, ...]
    encoders: tuple[ZeroedEncoder, ...]
    couplings: tuple[CountedCoupling, ...]
    first: str

    @property
    def wanted_names(self) -> tuple[str, ...]:
        """Names of what the host gives."""
        return tuple(x.name for x in self.wanted)


def board_roles(system: System) -> BoardRoles:
    """Roles of a System's inputs; with a motor all but counts and frame words are wanted.

    Without one only ``stop`` is, which the board itself gives to whatever limits there are.
    """
    inputs = {x.name: x for t in system.tasks for x in system.task_inputs(t)}
    drive = "rearm" in inputs
    measured = [
        x
        for x in inputs.values()
        if (x.name.startswith(("count_", "frame_error_")) if drive else x.name != "stop")
    ]
    outputs = {
        (x.signals[0].instance, x.signals[0].port): x.name
        for x in (system.outputs if drive else ())
    }
    return BoardRoles(
        drive,
        tuple(measured),
        tuple(x for x in inputs.values() if x not in measured),
        tuple(
            ZeroedEncoder(name, block.name, outputs[name, "theta_rad"], outputs[name, "status"])
            for name, block in (system.blocks.items() if drive else ())
            if {"zero_rad", "zeroed"} <= {t.name for t in block.tunables}
        ),
        _couplings(system),
        system.tasks[0].name,
    )


def _told(system: System, theta: Any, outputs: Mapping[Signal, External]) -> Any:
    # A deflection that is smoothed on its way is not told: the one it is made from is.
    while isinstance(theta, Signal) and theta not in outputs:
        sink = Signal(theta.instance, "theta_rad")
        if sink.port not in (p.name for p in system.blocks[sink.instance].inputs):
            break
        theta = system.feed(sink)
    return theta


_NOT_BELIEVED = ("INPUT_INVALID", "ENCODER_UNUSABLE")


def _couplings(system: System) -> tuple[CountedCoupling, ...]:
    # Torque sensors of the first task whose deflection and torque are told of each run.
    outputs = {x.signals[0]: x for x in system.task_outputs(system.tasks[0])}
    found = []
    for name in system.tasks[0].blocks:
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
        found.append(
            CountedCoupling(name, side, told.name, tau.name, block, status.name, flags, most_rad)
        )
    return tuple(found[:MOST_COUPLINGS])
