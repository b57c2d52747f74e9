"""Asks a board for its constraint, again and again, while its motors are on."""

from __future__ import annotations

import math
import threading

from esea_gen.emit.roles import board_roles
from esea_gen.link.transport import LinkError
from esea_host.connection import ConnectedDevice

WORKING = ("ARMED", "ACTIVE", "LETTING_GO")
TORQUE_MODE, DEADLINE_MS = 1.0, 500
TURN_S, AGAIN_S = 0.05, 0.5


class ConstraintKeeper:
    """Asks for 0 Nm and the constraint; arms simulated boards only, until a stop or fault."""

    def __init__(self, device: ConnectedDevice, arms: bool, threaded: bool = True) -> None:
        roles = board_roles(device.identity.device.system)
        self.there = roles.drive and "constrained" in roles.wanted_names
        self.wanted, self.said = False, ""
        self._device, self.arms = device, arms and device.simulated
        self._asked_s = -math.inf
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None
        if threaded and (self.there or self.arms):
            self._thread = threading.Thread(target=self._run, name="esea-constraint", daemon=True)
            self._thread.start()

    def turn(self, now_s: float) -> None:
        """One request; ``now_s`` rises from turn to turn."""
        state = self._device.state()
        if state in WORKING and self.there:
            constrained = float(self.wanted)
            self._device.want(DEADLINE_MS, mode=TORQUE_MODE, constrained=constrained)
        self.arms = self.arms and state not in ("STOPPED", "FAULT")
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
        while not self._closed.wait(TURN_S):
            turns += 1
            try:
                self.turn(turns * TURN_S)
                self.said = ""
            except LinkError as error:
                self.said = str(error)
                if self._device.receiver.error is not None:
                    return

    def close(self) -> None:
        self._closed.set()
        if self._thread is not None:
            self._thread.join(3.0)
