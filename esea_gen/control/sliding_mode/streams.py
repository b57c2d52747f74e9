"""What the sliding mode is tried with: a loop whose command comes late, is clipped or held."""

from __future__ import annotations

import numpy as np

from esea_gen.language.block import Block
from esea_gen.language.ports import Array
from esea_gen.language.stream import OwnStreams, Stream, single


def _events(block: Block, rng: np.random.Generator) -> list[Stream]:
    # On and off, the command applied one or two periods late, clipped, or held at zero; errors from
    # a hundredth of the boundary layer to far beyond it.
    steps = 3000
    t = np.arange(steps)
    ports = {p.name: p for p in block.inputs}
    sizes = {p.name: np.zeros(steps) for p in block.inputs}

    def wave(name: str, share: float, period: float) -> Array:
        size = share * ports[name].high
        return np.asarray(size * np.sin(2 * np.pi * t / period + rng.uniform(0, 6)))

    sizes["mode"] = np.where((t // 170) % 4 == 3, 0.0, 1.0 + (t // 700) % 2)
    grow = 10.0 ** (-2 + 2 * (t % 900) / 900)
    for name, period in (("delta_set_rad", 260.0), ("theta_rad", 240.0)):
        sizes[name] = grow * wave(name, 0.3, period)
    for name, share, period in (
        ("delta_rate_rad_s", 0.05, 70.0),
        ("delta_acc_rad_s2", 0.02, 50.0),
        ("omega_motor_rad_s", 0.05, 80.0),
        ("omega_load_rad_s", 0.05, 85.0),
        ("tau_Nm", 0.1, 150.0),
        ("tau_h_Nm", 0.1, 190.0),
        ("d4_rad_s2", 0.1, 110.0),
        ("u_a_Nm", 0.5, 60.0),
    ):
        sizes[name] = (0.2 + grow) * wave(name, share, period)
    applied = ports["u_applied_Nm"].high
    out = []
    for name, late in (("applied one step late", 1), ("applied two steps late", 2)):
        # What the Block itself asked for, so that only a true difference holds it back.
        x = {k: single(v) for k, v in sizes.items()}
        simulator = block.simulator()
        asked = [0.0, 0.0]
        for k in range(steps):
            u = asked[-late] if late <= len(asked) else 0.0
            part = k // 200 % 5
            if part == 3:
                u = float(np.clip(u, -0.3 * applied, 0.3 * applied))
            elif part == 4:
                u = 0.0
            x["u_applied_Nm"][k] = single(u)
            y = simulator.step(**{n: float(v[k]) for n, v in x.items()})
            asked.append(float(single(y["u_command_Nm"])))
        out.append(Stream(name, x))
    return out


STREAMS = OwnStreams(_events)
