"""Operator of a board behind a window: sends its requests."""

from __future__ import annotations

import math
import threading
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from esea_gen.emit.roles import board_roles
from esea_gen.errors import UserError
from esea_gen.link.transport import LinkError
from esea_gen.model.sensing import of_axis
from esea_host.connection import ConnectedDevice

WORKING = ("ARMED", "ACTIVE", "LETTING_GO")
TORQUE_MODE, DEADLINE_MS = 1.0, 500
AGAIN_S = 0.5
AMPLITUDE_Nm, WANTED_HZ = 1.7, 0.6


class BoardOperator(ABC):
    """Asks while the motors are on; zeroes and arms simulated boards until a stop or fault."""

    TURN_S: ClassVar[float] = 0.05
    AGAIN: ClassVar[bool] = True  # whether it arms a board again that was disarmed

    def __init__(
        self, device: ConnectedDevice, asks: bool, arms: bool, threaded: bool = True
    ) -> None:
        self.there, self.arms, self.said = asks, arms and device.simulated, ""
        self._device, self._asked_s = device, -math.inf
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None
        if threaded and (self.there or self.arms):
            self._thread = threading.Thread(target=self._run, name="esea-operator", daemon=True)
            self._thread.start()

    @abstractmethod
    def asked(self, now_s: float) -> Mapping[str, float]:
        """Request at a time, beside the torque mode."""

    def turn(self, now_s: float) -> None:
        """One request; ``now_s`` rises from turn to turn."""
        state = self._device.state()
        if state in WORKING and self.there:
            self._device.want(DEADLINE_MS, mode=TORQUE_MODE, **self.asked(now_s))
        over = ("STOPPING", "STOPPED", "FAULT", *(() if self.AGAIN else WORKING))
        self.arms = self.arms and state not in over
        if self.arms and now_s > self._asked_s + AGAIN_S:
            # A hand that moves is not zeroed, a busy computer lets a deadline pass: again.
            if state == "UNREFERENCED":
                self._device.zero()
            elif state == "READY" and self.there:
                self._device.arm()
            else:
                return
            self._asked_s = now_s

    def _run(self) -> None:
        turns = 0
        while not self._closed.wait(self.TURN_S):
            turns += 1
            try:
                self.turn(turns * self.TURN_S)
                self.said = ""
            except LinkError as error:
                self.said = str(error)
                if self._device.receiver.error is not None:
                    return

    def close(self) -> None:
        self._closed.set()
        if self._thread is not None:
            self._thread.join(3.0)


class ConstraintKeeper(BoardOperator):
    """Requests 0 Nm, and the constraint while it is switched on."""

    def __init__(self, device: ConnectedDevice, arms: bool, threaded: bool = True) -> None:
        roles = board_roles(device.identity.device.system)
        self.wanted = False
        there = roles.drive and "constrained" in roles.wanted_names
        super().__init__(device, there, arms, threaded)

    def asked(self, now_s: float) -> Mapping[str, float]:
        return {"constrained": float(self.wanted)}


class DemoOperator(BoardOperator):
    """Asks each axis of a simulated board for a sine of torque, until somebody stops it."""

    TURN_S, AGAIN = 0.01, False

    def __init__(self, device: ConnectedDevice) -> None:
        if not device.simulated:
            raise UserError("A demonstration moves simulated boards only.", "Use esea-host view.")
        known = device.identity.device
        self._names = [of_axis("tau_desired_Nm", a) for a in known.axes]
        super().__init__(device, bool(known.laws), arms=True)

    def asked(self, now_s: float) -> Mapping[str, float]:
        wanted_Nm = AMPLITUDE_Nm / len(self._names) * math.sin(2 * math.pi * WANTED_HZ * now_s)
        return dict.fromkeys(self._names, wanted_Nm)
