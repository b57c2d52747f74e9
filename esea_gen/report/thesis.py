"""The page of the thesis, recomputed: one self-contained file."""

from __future__ import annotations

from esea_gen.report.page import environment
from esea_gen.reproduce.thesis import DIFFERS, REPRODUCED, TAKEN, UNEXPLAINED, Recomputed

_TONES = {REPRODUCED: "good", TAKEN: "good", DIFFERS: "warn", UNEXPLAINED: "bad"}


def thesis_page(result: Recomputed, command: str) -> str:
    content = result.to_dict()
    return (
        environment()
        .get_template("report/thesis.html.j2")
        .render(
            f=content,
            command=command,
            explained=result.explained,
            chapters=list(dict.fromkeys(i["chapter"] for i in content["items"])),
            tone=lambda verdict: _TONES.get(verdict, ""),
            shown=lambda x: "–" if x is None else f"{x:.4g}".replace("-", "−"),
            share=lambda x: "" if x is None else "0" if x == 0 else f"{100 * x:.1f} %",
        )
    )
