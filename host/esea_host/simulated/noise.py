"""A bad line: bytes flipped, cut out, sent twice, or in the wrong order; from a seed."""

from __future__ import annotations

import numpy as np

from esea_gen.link.transport import Transport

KINDS = ("flip", "cut", "repeat", "swap")


class NoisyTransport:
    """A link that damages what comes in."""

    def __init__(self, transport: Transport, seed: int, every_bytes: float = 2000.0) -> None:
        self.transport, self.every_bytes = transport, every_bytes
        self._random = np.random.default_rng(seed)
        self.accidents = dict.fromkeys(KINDS, 0)

    def damage(self, data: bytes) -> bytes:
        out = bytearray(data)
        for _ in range(self._random.poisson(len(data) / self.every_bytes)):
            kind = KINDS[self._random.integers(len(KINDS))]
            at, length = (
                int(self._random.integers(len(out) + 1)),
                int(self._random.integers(1, 400)),
            )
            part = out[at : at + length]
            self.accidents[kind] += 1
            if kind == "flip" and at < len(out):
                out[at] ^= 1 << int(self._random.integers(8))
            elif kind == "cut":
                del out[at : at + length]
            elif kind == "repeat":
                out[at:at] = part
            elif kind == "swap":
                out[at : at + 2 * length] = out[at + length : at + 2 * length] + part
        return bytes(out)

    def read(self, timeout_s: float) -> bytes:
        return self.damage(self.transport.read(timeout_s))

    def write(self, data: bytes, timeout_s: float) -> None:
        self.transport.write(data, timeout_s)

    def close(self) -> None:
        self.transport.close()

    def said(self) -> str:
        return self.transport.said()
