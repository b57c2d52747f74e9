"""Which of the values that were tried to take, and why."""

from __future__ import annotations

from collections.abc import Sequence

from esea_gen.studies.tuning_sweep.trial import Trial

# A value whose error is within this of the least is as good: the smallest such is taken.
NEAR = 0.1
# Percent of overshoot above the least one that a smaller error does not pay for.
OVERSHOOT_ROOM = 5.0
# Values with more than this times the least error do not say what the least overshoot is: a torque
# that is not followed overshoots nothing.
FOLLOWS = 2.0


def _nothing(trials: Sequence[Trial]) -> str:
    """Why no trial is usable; the reason where there is but one."""
    reasons = {t.unusable for t in trials}
    return "no value is usable" + (f", {reasons.pop()}" if len(reasons) == 1 else "")


def choose_layer(trials: Sequence[Trial]) -> tuple[Trial | None, str]:
    """The narrowest boundary layer that the surface never leaves."""
    usable = [t for t in trials if not t.unusable]
    if not usable:
        return None, _nothing(trials)
    good = [t for t in usable if t.surface_rad_s <= t.value]
    if not good:
        return None, "the surface leaves every layer that was tried: try wider ones"
    best = min(good, key=lambda t: t.value)
    below = [t for t in trials if t.value < best.value]
    reason = f"the surface stays within it (largest |s| {best.surface_rad_s:.3g} rad/s)"
    if below:
        worst = max(below, key=lambda t: t.value)
        left = worst.unusable or f"is left for {100 * worst.outside_share:.2g} % of the time"
        reason += f"; the next narrower one, {worst.value:g}, {left}"
    return best, reason


def choose_error(trials: Sequence[Trial]) -> tuple[Trial | None, str]:
    """The smallest value whose error is near the least, without overshoot to pay for it."""
    usable = [t for t in trials if not t.unusable]
    if not usable:
        return None, _nothing(trials)
    least = min(t.rms_Nm for t in usable)
    follow = [t for t in usable if t.rms_Nm <= FOLLOWS * least]
    room = min(t.overshoot_percent for t in follow) + OVERSHOOT_ROOM
    calm = [t for t in follow if t.overshoot_percent <= room]
    best = min(t.rms_Nm for t in calm)
    chosen = min((t for t in calm if t.rms_Nm <= (1 + NEAR) * best), key=lambda t: t.value)
    reason = (
        f"RMS error {chosen.rms_Nm:.3g} Nm, within {100 * NEAR:.0f} % of the least that needs no "
        f"more than {room:.3g} % overshoot ({best:.3g} Nm)"
    )
    above = [t for t in trials if t.value > chosen.value]
    if above:
        last = max(above, key=lambda t: t.value)
        end = last.unusable or (
            f"{last.rms_Nm:.3g} Nm and {last.overshoot_percent:.3g} % overshoot"
        )
        reason += f"; at {last.value:g}: {end}"
    return chosen, reason
