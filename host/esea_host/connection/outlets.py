"""Live outlets of a board's telemetry to other programs: Foxglove, LSL.

Both libraries are optional.
"""

from __future__ import annotations

import importlib
import json
import math
import os
import platform
from typing import Any

import numpy as np

from esea_gen.errors import UserError
from esea_host.connection.decoder import TICK
from esea_host.connection.receiver import Batch
from esea_host.recording.layout import PACKAGE, StreamLayout

QUICKEST_S = 10.0  # a quickest arrival counts this long, and once more


def _library(module: str, package: str) -> Any:
    try:
        return importlib.import_module(module)
    except (ImportError, RuntimeError) as error:  # pylsl: its C library is missing
        raise UserError(f"{package} cannot be used ({error}).", f"pip install {package}") from None


class FoxgloveOutlet:
    """A WebSocket server for Foxglove and Lichtblick: the recording's own messages, live."""

    def __init__(self, port: int = 8765, simulated: bool = False) -> None:
        self._foxglove = _library("foxglove", "foxglove-sdk")
        host, self._marks = "127.0.0.1", {"simulated": "1"} if simulated else {}
        try:
            self._server = self._foxglove.start_server(name="esea-host", host=host, port=port)
        except (OSError, RuntimeError) as error:
            raise UserError(f"Port {port} cannot be served ({error}).", "Use another.") from None
        self.port = int(self._server.port)
        self.said = f"Foxglove: ws://{host}:{self.port}"
        self._channels: dict[str, Any] = {}
        self._start_ns: int | None = None

    def _channel(self, layout: StreamLayout) -> Any:
        if layout.name not in self._channels:
            schema = self._foxglove.Schema(
                name=f"{PACKAGE}.{layout.name}", encoding="protobuf", data=layout.descriptor()
            )
            told = {"units": json.dumps(layout.units)} | self._marks
            self._channels[layout.name] = self._foxglove.Channel(
                f"/{layout.name}", schema=schema, message_encoding="protobuf", metadata=told
            )
        return self._channels[layout.name]

    def put(self, batch: Batch) -> None:
        if self._start_ns is None:
            self._start_ns = batch.arrived_ns - int(batch.board_ns[0])
        channel, data = self._channel(batch.layout), batch.layout.record(batch.rows)
        for row, ns in zip(data, (batch.board_ns + self._start_ns).tolist(), strict=True):
            channel.log(row.tobytes(), log_time=ns)

    def close(self) -> None:
        self._server.stop()


class LslOutlet:
    """An outlet of the Lab Streaming Layer for each stream: its numbers, by name and unit.

    Samples are stamped by the board's clock, put onto LSL's by the quickest recent arrival.
    """

    def __init__(self, device: str, at: str, rates_Hz: dict[str, float], simulated: bool) -> None:
        self._lsl = _library("pylsl", "pylsl")
        self._device, self._rates, self._simulated = device, rates_Hz, simulated
        # Receivers take two boards of one source for one board that came back.
        self._board = f"{at} at {platform.node()}" + f" {os.getpid()}" * at.startswith("sim:")
        self._outlets: dict[str, tuple[Any, list[str]]] = {}
        self._ahead_s, self._until_s = [math.inf, math.inf], -math.inf
        self.said = f"LSL: {', '.join(f'{device} {s}' for s in rates_Hz)}"

    def _outlet(self, layout: StreamLayout) -> tuple[Any, list[str]]:
        if layout.name not in self._outlets:
            columns = [c for c in layout.columns if c.name != TICK and c.size == 1]
            name = f"{self._device} {layout.name}"
            rate, of = self._rates.get(layout.name, 0.0), f"{name} of {self._board}"
            # Status words have more bits than a single has.
            info = self._lsl.StreamInfo(name, "Mocap", len(columns), rate, "double64", of)
            if self._simulated:
                info.desc().append_child_value("simulated", "1")
            channels = info.desc().append_child("channels")
            for c in columns:
                one = channels.append_child("channel")
                one.append_child_value("label", c.name)
                one.append_child_value("unit", c.unit or "1")
            self._outlets[layout.name] = self._lsl.StreamOutlet(info), [c.name for c in columns]
        return self._outlets[layout.name]

    def put(self, batch: Batch) -> None:
        outlet, names = self._outlet(batch.layout)
        now_s, last_s = float(self._lsl.local_clock()), float(batch.board_ns[-1]) * 1e-9
        if now_s >= self._until_s:  # the clocks drift apart
            self._ahead_s, self._until_s = [self._ahead_s[1], math.inf], now_s + QUICKEST_S
        self._ahead_s[1] = min(self._ahead_s[1], now_s - last_s)
        rows = np.column_stack([batch.rows[n].astype(np.float64) for n in names])
        for row, ns in zip(rows.tolist(), batch.board_ns.tolist(), strict=True):
            outlet.push_sample(row, ns * 1e-9 + min(self._ahead_s))

    def close(self) -> None:
        self._outlets.clear()
