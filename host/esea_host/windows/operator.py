"""Somebody who operates the simulated board while one looks on."""

from __future__ import annotations

import math
import threading
import time

from esea_gen.errors import UserError
from esea_gen.link.transport import LinkError
from esea_gen.model.sensing import of_axis
from esea_host.connection import ConnectedDevice

AMPLITUDE_Nm, WANTED_HZ = 1.7, 0.6
TURN_S, DEADLINE_MS, PATIENCE_S = 0.01, 500, 1.0


class DemoOperator:
    """Zeroes, arms and asks each axis for a sine until stopped; simulated boards only."""

    def __init__(self, device: ConnectedDevice) -> None:
        if not device.simulated:
            raise UserError("A demonstration moves simulated boards only.", "Use esea-host view.")
        self._device, self._closed = device, threading.Event()
        self.said = ""
        self._thread = threading.Thread(target=self._run, name="esea-demo", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._closed.set()
        self._thread.join(3.0)

    def _run(self) -> None:
        names = [of_axis("tau_desired_Nm", a) for a in self._device.identity.device.axes]
        try:
            self._begin()
            start_s = time.monotonic()
            while not self._closed.wait(TURN_S) and self._device.state() in ("ARMED", "ACTIVE"):
                phase = 2 * math.pi * WANTED_HZ * (time.monotonic() - start_s)
                wanted_Nm = AMPLITUDE_Nm / len(names) * math.sin(phase)
                self._device.want(DEADLINE_MS, mode=1.0, **dict.fromkeys(names, wanted_Nm))
        except LinkError as error:
            self.said = str(error)

    def _begin(self) -> None:
        # A person who sways is not zeroed: again, until it is.  A stop ends it at once.
        while not self._closed.wait(0.3):
            state = self._device.state()
            if state == "STOPPED":
                return
            if state == "READY" and not self._device.identity.device.laws:
                return
            if state == "READY":
                self._device.arm()
                break
            if state == "UNREFERENCED":
                self._device.zero()
        end_s = time.monotonic() + PATIENCE_S
        while self._device.state() == "READY" and time.monotonic() < end_s:
            self._closed.wait(TURN_S)
