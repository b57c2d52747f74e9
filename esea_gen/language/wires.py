"""Parts of a System: tasks, ends of wires, inputs and outputs, latches between tasks."""

from __future__ import annotations

from dataclasses import dataclass

from esea_gen.language.ports import Port


@dataclass(frozen=True)
class Task:
    name: str  # C identifier; its entry point is ``esea_<device>_<name>_step``
    blocks: tuple[str, ...]  # instances it runs, in order
    every: int = 1  # period in base ticks
    phase: int = 0  # tick of its first run, below ``every``
    # Ticks from the start of a run until others see what it wrote; its period where None.
    release: int | None = None

    @property
    def release_ticks(self) -> int:
        return self.every if self.release is None else self.release


@dataclass(frozen=True)
class Signal:
    """One end of a wire: a port of an instance."""

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
    """A value that enters or leaves the System through a task's input or output struct."""

    name: str  # field of the struct
    port: Port
    signals: tuple[Signal, ...]


@dataclass(frozen=True)
class Latch:
    """A value stored for another task."""

    name: str  # field of the latches struct
    source: Signal  # the output that it holds
    port: Port
    writer: str  # task that writes it
