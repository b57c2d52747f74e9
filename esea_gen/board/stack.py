"""Bounds of the stack from the compiler's call graphs, with everything that may interrupt."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path

# What the compiler's own library may use below a function that calls it; it has no call graph.
LIBRARY_BYTES = 64
# What a Cortex-M puts on the stack at an interrupt, with 4 bytes to align it.
FRAME_BYTES, FRAME_FPU_BYTES = 32 + 4, 104 + 4
_POINTER = "__indirect_call"


@dataclass
class CallGraph:
    """Functions with their own use of the stack, and who calls whom."""

    own: dict[str, int] = field(default_factory=dict)
    calls: dict[str, set[str]] = field(default_factory=dict)

    @classmethod
    def read(cls, paths: Sequence[Path]) -> CallGraph:
        """From files of GCC's ``-fcallgraph-info=su``."""
        graph = cls()
        for path in paths:
            text = path.read_text(encoding="utf-8")
            for title, label in re.findall(r'node: \{ title: "(.*?)" label: "(.*?)"', text):
                used = re.search(r"\\n(\d+) bytes \((\w+)", label)
                if used and used.group(2) != "static":
                    raise ValueError(f"{title} uses a stack of unknown size")
                if used:
                    graph.own[title] = int(used.group(1))
            found = re.findall(r'edge: \{ sourcename: "(.*?)" targetname: "(.*?)"', text)
            for source, target in found:
                graph.calls.setdefault(source, set()).add(target)
        return graph

    def _reached(self, caller: str, pointed: Sequence[str]) -> Sequence[str]:
        # A driver's pointers are those of its struct of functions alone.
        if re.search(r"(^|:)esea_(as5048a|biss|escon|stop_line|store)_|drivers/|app/store", caller):
            return [n for n in self.own if re.search(r":hw_\w+$", n)]
        return pointed

    def deepest(self, entry: str, pointed: Sequence[str] = ()) -> int:
        """Largest use below a function, its own included; of a function without graph, 0."""

        def depth(name: str, above: tuple[str, ...]) -> int:
            if name in above and name != _POINTER:
                raise ValueError(f"recursion: {' -> '.join((*above, name))}")
            if name == _POINTER:
                targets: Collection[str] = self._reached(above[-1], pointed)
            else:
                targets = self.calls.get(name, ())
            below = (depth(n, (*above, name)) for n in targets)
            return self.own.get(name, 0) + max(below, default=0)

        return depth(entry, ())


def deepest_stack(graphs: Sequence[Path], entry: str) -> int:
    """Largest stack use below a function, from the compiler's call graphs."""
    return CallGraph.read(graphs).deepest(entry)


def stack_by_priority(
    graph: CallGraph, fast: Sequence[str], slow: Sequence[str], fpu: bool
) -> dict[str, int]:
    """Largest use of each priority of a Cortex-M image, the frame at its interrupt included."""
    frame = FRAME_FPU_BYTES if fpu else FRAME_BYTES
    port = [n for n in graph.own if re.search(r":port_\w+$", n) or n.startswith("esea_board_")]
    (receive,) = [n for n, below in graph.calls.items() if "esea_cortex_m_received" in below]
    entries = {
        "main": ("esea_reset_handler", (*fast, *slow)),
        "slower": ("esea_slower_handler", slow),
        "tick": ("esea_tick_handler", fast),
        "receive": (receive, ()),
    }
    missing = [e for e, _ in entries.values() if e not in graph.own]
    if missing:
        raise ValueError(f"no call graph has {', '.join(missing)}")
    return {
        name: graph.deepest(entry, (*port, *steps))
        + LIBRARY_BYTES
        + (frame if name != "main" else 0)
        for name, (entry, steps) in entries.items()
    }
