"""The target of the motor-learning task: a mass that a damper couples to the cursor."""

from __future__ import annotations

import math
from dataclasses import dataclass

from esea_gen.errors import UserError

MASS_KG, DAMPING_KG_S = 5.0, 18.0  # equation 7.7; the printed unit kgm/s is a misprint
WITHIN_DEG, HOLD_S, REACH_S = 2.0, 0.75, 10.0
SHARE, LARGER_SHARE = 0.20, 0.25


@dataclass(frozen=True)
class Moving:
    x_deg: float
    v_deg_s: float = 0.0


def advance(
    target: Moving, cursor_from_deg: float, cursor_to_deg: float, dt_s: float, rate_1_s: float
) -> Moving:
    """One step of equation 7.7, exact for a cursor that moves evenly between two samples."""
    speed = (cursor_to_deg - cursor_from_deg) / dt_s
    slip = target.v_deg_s - speed
    kept = math.exp(-rate_1_s * dt_s)
    moved = speed * dt_s + slip * (1.0 - kept) / rate_1_s
    return Moving(target.x_deg + moved, speed + kept * slip)


def target_distance_deg(smallest_deg: float) -> float:
    """Where targets stand: a fifth of the smallest range, a quarter where that is too near."""
    for share in (SHARE, LARGER_SHARE):
        if share * smallest_deg > WITHIN_DEG:
            return share * smallest_deg
    raise UserError(
        f"The smallest range of motion is {smallest_deg:.1f} deg: targets at "
        f"{100 * LARGER_SHARE:.0f} % of it would appear within {WITHIN_DEG:g} deg of the origin, "
        "caught before anything moves.",
        f"More than {WITHIN_DEG / LARGER_SHARE:g} deg are needed: measure again with another "
        "neutral position; who cannot reach that cannot do this task.",
    )
