"""Parts of a System: tasks, ends of wires, what enters and leaves, what tasks hold for others."""

from __future__ import annotations

from dataclasses import dataclass

from esea_gen.language.ports import Port


@dataclass(frozen=True)
class Task:
    """A periodic task.

    name: C identifier; its entry point is ``esea_<device>_<name>_step``.
    blocks: instances it runs, in order.
    every: period in base ticks.
    phase: tick of its first run, below ``every``.
    release: ticks from the start of a run until what it wrote is visible to other tasks; its period
        when not given.
    """

    name: str
    blocks: tuple[str, ...]
    every: int = 1
    phase: int = 0
    release: int | None = None

    @property
    def release_ticks(self) -> int:
        """Ticks from the start of a run to the release of its latches."""
        return self.every if self.release is None else self.release


@dataclass(frozen=True)
class Signal:
    """One end of a wire: a port of an instance.

    instance: name of the instance.
    port: name of its port.
    """

    instance: str
    port: str

    @classmethod
    def parse(cls, text: str) -> Signal:
        """From ``"instance.port"``."""
        instance, dot, port = text.partition(".")
        if not (instance and dot and port):
            raise ValueError(f"'{text}' is not of the form instance.port")
        return cls(instance, port)


@dataclass(frozen=True)
class External:
    """A value that enters or leaves the System through a task's input or output struct.

    name: field of the struct.
    port: what it carries.
    signals: the ports that it feeds, or the one that it comes from.
    """

    name: str
    port: Port
    signals: tuple[Signal, ...]


@dataclass(frozen=True)
class Latch:
    """A value held for another task.

    name: field of the latches struct.
    source: the output that it holds.
    port: what it carries.
    writer: task that writes it.
    """

    name: str
    source: Signal
    port: Port
    writer: str


__all__ = ["External", "Latch", "Signal", "Task"]
