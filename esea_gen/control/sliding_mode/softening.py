"""Lower gains while the error swings, for a drive lighter or slower than its model.

With such gains at all times tracking would be worse, and a limp hand would continue to move.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import casadi as ca

from esea_gen.language.block import Labels
from esea_gen.language.ports import Flag, Port, Tunable, around, clip

FROM_HZ = 4.0
"""Two high-passes of first order: wanted torques and what people do is mostly slower."""
MOST_RAD = 0.0065
"""What counts of a swing: a step of the wanted torque is large, but it is over soon."""
WINDOW_S, BACK_S = 0.5, 60.0
SEEN_RAD, FULL_RAD = 3.5e-3, 3.9e-3
"""RMS from which on the gains soften, and from which on they are all soft.  The shipped drive has
1 to 2 mrad with a person, up to 4 following a torque; a swing of 0.15 Nm 6 mrad and more."""
SLOPE_FALLS, LEAD_RISES = 0.5, 0.6
"""Shares: lambda from 15 to 7.5 1/s, the lead from 2.5 to 4."""

EQUATIONS = f"""
    [soft 1] | sigma | Max(sigma_1 * Max(0, Min(1, (q_2 - q_seen**2) / (q_full**2 - q_seen**2))), \
        sigma{{k-1}} * exp(-h / T_s)) | softness
    [soft 2] | lambda | lambda_0 * (1 - {SLOPE_FALLS} * sigma{{k-1}}) | slope, softened
    [soft 3] | kappa | kappa_0 * (1 + {LEAD_RISES} * sigma{{k-1}}) | lead, within its bound
"""
SOFTENED = Flag("SOFTENED", "the error swings, or did so lately: the gains are softer")
COEFFICIENT = Port("softening", 0.0, 1.0, "how soft a swing makes the gains")
TUNABLE = Tunable(
    "softening",
    1.0,
    0.0,
    1.0,
    "how soft a swing of the error makes the gains; 0: they stay as they are",
    "docs/control.md",
)


class SwingSoftening:
    """Softening of the sliding mode's gains during swings."""

    def __init__(self, h: float, error_lim: float, lead_high: float) -> None:
        self.h, self.lead_high = h, lead_high
        self.follow = 1 - math.exp(-2 * math.pi * FROM_HZ * h)
        self.gain = 1 - math.exp(-h / WINDOW_S)
        self.keep = math.exp(-h / BACK_S)
        self.state = (
            around("slow_rad", 1.01 * error_lim, "slow part of the error"),
            around("middle_rad", 2.02 * error_lim, "slow part of what is left"),
            Port("square", 0.0, 1.001, "mean square of the fast part, 1 is the most that counts"),
            Port("soft", 0.0, 1.0, "how soft the gains are"),
        )

    def step(
        self, c: Any, s: Any, e: ca.SX, on: ca.SX, entering: ca.SX, label: Labels
    ) -> tuple[SimpleNamespace, dict[str, Any]]:
        """The gains of this step, with ``soft``, and the state after it."""
        last = ca.if_else(entering, e, s.slow_rad)
        slow = last + self.follow * (e - last)
        middle = s.middle_rad + self.follow * (e - slow - s.middle_rad)
        # In shares of the most that counts: its square in rad^2 has few digits in fixed point.
        swing = clip((e - slow - middle) * (1 / MOST_RAD), -1, 1)
        swing = label("swing", swing, "fast part of e, 1 is the most that counts")
        square = (1 - self.gain) * s.square + self.gain * (swing * swing)
        square = label("square", square, "its mean square")
        seen, full = (SEEN_RAD / MOST_RAD) ** 2, (FULL_RAD / MOST_RAD) ** 2
        asked = (square - seen) * (1 / (full - seen))
        now = ca.fmax(c.softening * clip(asked, 0, 1), s.soft * self.keep)
        # The gains take what the run before found: in fixed point the fast part of the error, a
        # difference times 125, must not reach the command in the same step.
        soft = label("soft", s.soft, "1: all soft")
        slope = label("slope_1_s", c.lambda_1_s * (1 - SLOPE_FALLS * soft), "lambda now")
        slope2 = label("slope2_1_s2", slope * slope)
        lead = c.lead + LEAD_RISES * soft * (c.lead + 1)
        gains = vars(c) | {
            "lambda_1_s": slope,
            "lambda2_1_s2": slope2,
            "integral_gain_1_s": self.h * slope2,
            "lead": label("lead_now", ca.fmin(lead, self.lead_high - 1), "less 1"),
            "soft": soft,
        }
        kept = {"slow_rad": slow, "middle_rad": middle, "square": square, "soft": now}
        return SimpleNamespace(**gains), {n: ca.if_else(on, x, 0) for n, x in kept.items()}
