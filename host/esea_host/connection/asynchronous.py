"""A connected board for programs with an event loop."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, Self

from esea_gen.errors import UserError
from esea_host.connection.device import ConnectedDevice, RunSample
from esea_host.connection.opening import open_device


class AsyncDevice:
    """The same for programs with an event loop: every call gives way while it waits.

    Parameters
    ----------
    address : str
        As for :func:`open_device`.
    device : str, optional
        What it must be.
    key : Path, optional
        File of its key, where it is paired; default: the stored one that it takes.
    """

    def __init__(self, address: str, device: str | None = None, key: Path | None = None) -> None:
        self._asked = address, device, key
        self.blocking: ConnectedDevice | None = None

    async def __aenter__(self) -> Self:
        self.blocking = await asyncio.to_thread(open_device, *self._asked)
        return self

    async def __aexit__(self, *_: object) -> None:
        await asyncio.to_thread(self._connected.close)

    @property
    def _connected(self) -> ConnectedDevice:
        if self.blocking is None:
            raise UserError(
                "The device is not connected.", "Use: async with connect(...) as device"
            )
        return self.blocking

    def __getattr__(self, name: str) -> Any:
        """Every method of :class:`ConnectedDevice`, to be awaited."""
        if name.startswith("_"):
            raise AttributeError(name)
        method = getattr(self._connected, name)
        if not callable(method):
            return method

        async def call(*arguments: Any, **named: Any) -> Any:
            return await asyncio.to_thread(method, *arguments, **named)

        return call

    async def stream(self, *names: str, timeout_s: float = 5.0) -> AsyncIterator[RunSample]:
        """Runs of one stream as they come.

        Parameters
        ----------
        *names : str
            A stream, or signals of one stream.
        timeout_s : float
            Longest silence.
        """
        batches = self._connected.sample_batches(names, timeout_s)
        try:
            while True:
                for sample in await asyncio.to_thread(next, batches):
                    yield sample
        finally:
            batches.close()


connect = AsyncDevice  # as it reads: async with connect(...) as device
