"""Signals that tasks need, matched to a device by axis and name; missing ones are reported."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from esea_gen.device import Device
from esea_gen.emit.roles import board_roles
from esea_gen.errors import UserError
from esea_gen.model.sensing import of_axis
from esea_host.study.edge import trial_conditions
from esea_host.study.plan import build_plan
from esea_host.study.protocol import Protocol
from esea_host.study.task import StudyTask, TaskSignal

DEG = 180 / math.pi
# What a task may ask for: the impairment of all axes, and torque on a joint.
IMPAIRMENT, CONSTRAINED = "impairment", "constrained"
TORQUE = "tau_desired"
# Of an axis: whether its impairment acts.
ACTS = "acts"


@dataclass(frozen=True)
class Tap:
    """Where a device tells a signal, and the factor to the unit of the input's name."""

    stream: str
    column: str
    factor: float = 1.0


class DeviceSignals:
    def __init__(self, device: Device) -> None:
        self.device, self.axes = device, device.axes
        roles = board_roles(device.system)
        self.drive, self.wanted_names = roles.drive, roles.wanted_names
        told = [(t, x.name) for t in device.system.tasks for x in device.system.task_outputs(t)]
        self._streams = {name: f"{task.name}_out" for task, name in reversed(told)}

    def tap(self, signal: TaskSignal, name: str = "") -> Tap | None:
        """Stream of a signal; None if the board has no such signal."""
        column = of_axis(signal.quantity, self._axis(signal))
        stream = self._streams.get(column) if self._known(signal) else None
        degrees = name.endswith("_deg") and signal.quantity.endswith("_rad")
        return Tap(stream, column, DEG if degrees else 1.0) if stream else None

    def _axis(self, signal: TaskSignal) -> str:
        return signal.axis or self.axes[0]

    def _known(self, signal: TaskSignal) -> bool:
        return signal.axis in self.axes if signal.axis else len(self.axes) == 1

    def of_axes(self, quantity: str) -> dict[str, Tap]:
        taps = {a: self.tap(TaskSignal(quantity, a)) for a in self.axes}
        return {a: tap for a, tap in taps.items() if tap is not None}

    def taps(self, task: StudyTask) -> dict[str, Tap]:
        self.must_fit([(task, {})])
        return {n: tap for n, s in task.inputs.items() if (tap := self.tap(s, n)) is not None}

    def wanted(self, requests: Mapping[str, float]) -> dict[str, float]:
        found, unknown = {}, []
        for request, value in requests.items():
            name = self._wanted_name(request)
            if name is not None:
                found[name] = value
            elif value:
                unknown.append(request)
        if unknown:
            takes = [IMPAIRMENT] if CONSTRAINED in self.wanted_names else []
            takes += [n for n in self.wanted_names if n.startswith(TORQUE)]
            raise UserError(
                f"The task asks {self.device.name} for {', '.join(unknown)}; it takes "
                f"{', '.join(takes) or 'nothing'}.",
                "Run it with its own device.",
            )
        return found

    def _wanted_name(self, request: str) -> str | None:
        name = CONSTRAINED if request == IMPAIRMENT else request
        if request.startswith(TORQUE) and len(self.axes) == 1:
            name = of_axis(request, self.axes[0])
        allowed = name == CONSTRAINED or name.startswith(TORQUE)
        return name if allowed and name in self.wanted_names else None

    def lacks(self, task: StudyTask, conditions: Mapping[str, float]) -> list[str]:
        """Requirements of a task that the device lacks, a sentence each."""
        here, found = self.device.name, []
        named = " and ".join(a or "without a name" for a in self.axes)
        axes = f"its axes are {named}" if len(self.axes) > 1 else f"its only axis is {named}"
        for name, signal in task.inputs.items():
            if not self._known(signal):
                whose = f"axis {signal.axis}" if signal.axis else "a single axis"
                found.append(f"{name} is {signal.quantity} of {whose}, and {axes}")
            elif self.tap(signal, name) is None:
                column = of_axis(signal.quantity, self._axis(signal))
                found.append(f"{name} is {column}, which {here} does not report")
        for request, value in conditions.items():
            if value and self._wanted_name(request) is None:
                has = f", and {here} has no [{request}]" if request == IMPAIRMENT else ""
                found.append(f"the condition {request} = {value:g} is to act{has}")
        return found

    def told(self, uses: Iterable[tuple[StudyTask, Mapping[str, float]]]) -> list[str]:
        uses = list(uses)
        self.must_fit(uses)
        taps = {n: tap for task, _ in uses for n, tap in self.taps(task).items()}
        lines = [f"{n}: {tap.column} of {tap.stream}" for n, tap in taps.items()]
        asked = {r: name for _, c in uses for r in c if (name := self._wanted_name(r))}
        acts = " and ".join(tap.column for tap in self.of_axes(ACTS).values())
        return lines + [f"{r}: asked for as {n}, confirmed by {acts}" for r, n in asked.items()]

    def must_fit(self, uses: Iterable[tuple[StudyTask, Mapping[str, float]]]) -> None:
        found: dict[str, list[str]] = {}
        for task, conditions in uses:
            for lack in self.lacks(task, conditions):
                names = found.setdefault(lack, [])
                names += [] if task.name in names else [task.name]
        if found:
            told = "; ".join(f"{lack} ({', '.join(names)})" for lack, names in found.items())
            raise UserError(
                f"{self.device.name} does not fit: {told}.",
                "Connect the device that the study is for, or name its axes in the device file as "
                "the tasks do.",
            )


def uses_of(protocol: Protocol) -> list[tuple[StudyTask, Mapping[str, float]]]:
    """Tasks and conditions of all sessions of a protocol, in whichever group."""
    found = list[tuple[StudyTask, Mapping[str, float]]]()
    for session in range(len(protocol.file.session)):
        for group in protocol.file.groups or [""]:
            for trial in build_plan(protocol, 0, session, group).trials:
                task, parameters = trial.asked()
                found.append((task, trial_conditions(task, parameters)))
    return found
