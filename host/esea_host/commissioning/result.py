"""What a step found: comparisons with limits, numbers, what to do, a picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from matplotlib.figure import Figure

from esea_gen.identify.drive.startup import StartupCheck


@dataclass(frozen=True)
class StepResult:
    step: str
    title: str
    picture: Figure  # drawn, not yet written
    checks: tuple[StartupCheck, ...] = ()
    problem: tuple[str, str] | None = None
    found: Mapping[str, Any] = field(default_factory=dict)  # numbers by name with unit

    @property
    def passed(self) -> bool:
        """Whether there was something to judge, and all of it is within its limits."""
        return self.problem is None and bool(self.checks) and all(c.passed for c in self.checks)

    def lines(self) -> list[str]:
        out = [f"{self.title}: {'PASSED' if self.passed else 'FAILED'}"]
        if self.problem is not None:
            out += [f"  {self.problem[0]}", f"    Fix: {self.problem[1]}"]
        for c in self.checks:
            out.append(f"  {c.line()}")
            if not c.passed:
                out.append(f"    Fix: {c.fix}")
        return out

    def to_dict(self) -> dict[str, Any]:
        what, fix = self.problem or ("", "")
        return {
            "step": self.step,
            "title": self.title,
            "passed": self.passed,
            "problem": what,
            "fix": fix,
            "checks": [c.to_dict() for c in self.checks],
            "found": dict(self.found),
        }
