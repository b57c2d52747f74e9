"""Play a recording, at any speed."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator

from esea_host.recording.log import Log

LONGEST_S = 3600.0  # without a row


def play(log: Log, stream: str, speed: float) -> Iterator[str]:
    started_s = time.monotonic()
    table = log[stream]
    holes = {gap.after_tick: gap for gap in table.gaps}
    columns = [table[n].tolist() for n in table.names]
    for at_s, *values in zip(table.time_s.tolist(), *columns, strict=True):
        wait_s = at_s / speed - (time.monotonic() - started_s) if speed else 0.0
        if wait_s > LONGEST_S:  # a clock that jumps
            started_s -= wait_s - LONGEST_S
            wait_s = LONGEST_S
        if wait_s > 0:
            time.sleep(wait_s)
        row = dict(zip(table.names, values, strict=True))
        # JSON has no NaN.
        plain = {
            k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in row.items()
        }
        yield json.dumps({"time_s": round(at_s, 6), **plain})
        if row.get("sequence") in holes:
            yield json.dumps({"gap": holes[row["sequence"]].to_dict()})
