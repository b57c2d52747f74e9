"""A value of a procedure against its limit, and the fix where it is above."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

RATIO_OFF = 0.03
FRICTION_SHARE = 0.5


@dataclass(frozen=True)
class StartupCheck:
    """One comparison with a limit."""

    procedure: str
    what: str
    value: float  # in unit; the value must not be above
    limit: float
    unit: str
    fix: str  # what to do otherwise

    @property
    def passed(self) -> bool:
        """Whether the value is within the limit; NaN is not."""
        return self.value <= self.limit

    def line(self) -> str:
        """For people."""
        word = "within" if self.passed else "ABOVE"
        return f"{self.what}: {self.value:.3g}, {word} {self.limit:.3g} {self.unit}".rstrip()

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready, units in the keys."""
        unit = (self.unit or "1").replace("%", "pct")
        finite = math.isfinite(self.value)
        return {
            "procedure": self.procedure,
            "what": self.what,
            f"value_{unit}": self.value if finite else None,
            f"limit_{unit}": self.limit,
            "passed": self.passed,
            "fix": "" if self.passed else self.fix,
        }
