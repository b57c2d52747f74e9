"""System: Blocks wired by port name into tasks.

A task runs at a whole multiple of the System's base tick, with a phase.  Inside a task a value goes
straight from one Block to the next, in the order in which the task lists them.  A value that
crosses from one task to another goes through a latch: the writer leaves it pending, it is released
at a declared tick (by default one period after the writer's start), and a reader holds what was
released when its own run started.  So the result is the same bits whether a slow task is preempted
or not: logical execution time.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from esea_gen.language.component import Component, Executor
from esea_gen.language.names import check_name
from esea_gen.language.ports import Port, Tunable
from esea_gen.language.watch import WATCH, WATCHED, TaskWatch, Watched
from esea_gen.language.wires import External, Latch, Signal, Task


class System:
    """Blocks wired into tasks.

    Parameters
    ----------
    name : str
        Device name, prefix of the C.
    base_period_s : float
        Base tick.
    blocks : mapping of str to Block
        Instances by name; one Block may stand behind several instances.
    tasks : tuple of Task
        What runs when.
    wires : mapping of str to str
        ``{"sensor.omega_rad_s": "velocity.omega_mid_rad_s"}``: reader from writer.
    inputs : mapping of str to tuple of str
        External inputs: name to the ports they feed (all in one task).
    outputs : mapping of str to str
        External outputs: name to the port they come from.

    Raises
    ------
    ValueError
        For a port that is unknown, fed twice or not at all, of another unit, size or period, or
        for wires against the order inside a task.
    """

    def __init__(
        self,
        name: str,
        base_period_s: float,
        blocks: Mapping[str, Component],
        tasks: tuple[Task, ...],
        wires: Mapping[str, str],
        inputs: Mapping[str, tuple[str, ...]],
        outputs: Mapping[str, str],
    ) -> None:
        self.name = name
        self.base_period_s = base_period_s
        # Blocks and Programs: who can take only one of them asks for its kind.
        self.blocks: dict[str, Any] = dict(blocks)
        self.tasks = tasks
        self.wires = {Signal.parse(r): Signal.parse(w) for r, w in wires.items()}
        self._task_of = {i: t for t in tasks for i in t.blocks}
        named = {"system": [name], "task": [t.name for t in tasks], "block": blocks}
        for kind, names in (named | {"input": inputs, "output": outputs}).items():
            for n in names:
                check_name(kind, n)
        self._check_tasks()
        feeds = {n: tuple(Signal.parse(s) for s in sinks) for n, sinks in inputs.items()}
        self.inputs = tuple(self._external_input(n, s) for n, s in feeds.items())
        self.outputs = tuple(
            External(n, self._output(Signal.parse(s)), (Signal.parse(s),))
            for n, s in outputs.items()
        )
        self._check_wires()
        self.latches = self._latches()
        self._external = {s: x for x in self.inputs for s in x.signals}
        self._latch = {x.source: x for x in self.latches}

    # -- reading the structure -------------------------------------------------------------------

    @property
    def kinds(self) -> tuple[Any, ...]:
        """The different Blocks, each once, in order of first use."""
        return tuple({id(block): block for block in self.blocks.values()}.values())

    @property
    def tunables(self) -> tuple[tuple[str, Tunable], ...]:
        """Every tunable with the instance it belongs to, in the order of the C params struct."""
        return tuple((i, t) for i, b in self.blocks.items() for t in b.tunables)

    def is_tuned(self, task: Task) -> bool:
        """Whether a task's Blocks read any coefficient.

        Parameters
        ----------
        task : Task
        """
        return any(self.blocks[i].coefficients for i in task.blocks)

    def task(self, name: str) -> Task:
        """Task by name.

        Parameters
        ----------
        name : str
        """
        return next(t for t in self.tasks if t.name == name)

    def task_of(self, instance: str) -> Task:
        """Task that runs an instance.

        Parameters
        ----------
        instance : str
        """
        return self._task_of[instance]

    def task_inputs(self, task: Task) -> tuple[External, ...]:
        """External inputs of a task.

        Parameters
        ----------
        task : Task
        """
        return tuple(
            x for x in self.inputs if any(self.task_of(s.instance) is task for s in x.signals)
        )

    def task_outputs(self, task: Task) -> tuple[External, ...]:
        """External outputs of a task.

        Parameters
        ----------
        task : Task
        """
        return tuple(x for x in self.outputs if self.task_of(x.signals[0].instance) is task)

    def latches_read(self, task: Task) -> tuple[Latch, ...]:
        """Latches that a task reads, each once.

        Parameters
        ----------
        task : Task
        """
        sources = [w for r, w in self.wires.items() if self.task_of(r.instance) is task]
        return tuple(x for x in self.latches if x.source in sources and x.writer != task.name)

    def watched(self, task: Task) -> tuple[Port, ...]:
        """Values of the watch that a task reads.

        Parameters
        ----------
        task : Task
        """
        read = {
            w.port
            for r, w in self.wires.items()
            if w.instance == WATCH and self.task_of(r.instance) is task
        }
        return tuple(p for name, p in WATCHED.items() if name in read)

    @property
    def checker(self) -> str:
        """The task whose runs check the coefficients: the slowest with any, where that is asked."""
        asked = any("coeffs_ok" in (p.name for p in self.watched(t)) for t in self.tasks)
        tuned = [t for t in self.tasks if self.is_tuned(t)]
        return max(tuned, key=lambda t: t.every).name if asked and tuned else ""

    @property
    def resumed(self) -> tuple[str, ...]:
        """Instances that a restored state starts afresh."""
        return tuple(i for i, b in self.blocks.items() if b.starts_latched)

    def feed(self, sink: Signal) -> External | Latch | Watched | Signal:
        """Where an input port gets its value: input, latch, watch or an output of its task.

        Parameters
        ----------
        sink : Signal
        """
        external = self._external.get(sink)
        if external is not None:
            return external
        source = self.wires[sink]
        if source.instance == WATCH:
            return Watched(self._output(source))
        if self.task_of(source.instance) is not self.task_of(sink.instance):
            return self._latch[source]
        return source

    # -- checks ----------------------------------------------------------------------------------

    def _check_tasks(self) -> None:
        run = sorted(i for t in self.tasks for i in t.blocks)
        if WATCH in self.blocks:
            raise ValueError(f"no block may be called {WATCH}: the tasks' own watch is")
        # They share the C's types and, on Windows and macOS in any case, files.
        names = [x.name.lower() for x in (*self.kinds, *self.tasks)]
        if twice := sorted({n for n in names if names.count(n) > 1}):
            raise ValueError(f"different blocks or tasks named {', '.join(twice)} (in any case)")
        if run != sorted(self.blocks):
            raise ValueError(f"tasks run {run}, but the blocks are {sorted(self.blocks)}")
        for t in self.tasks:
            if t.every < 1 or not 0 <= t.phase < t.every:
                raise ValueError(f"task {t.name}: phase {t.phase} must be in [0, {t.every})")
            if not 1 <= t.release_ticks <= t.every:
                raise ValueError(f"task {t.name}: release {t.release} must be in [1, {t.every}]")
            period = t.every * self.base_period_s
            for i, own in ((i, self.blocks[i].period_s) for i in t.blocks):
                if abs(own - period) > 1e-12:
                    runs = f"task {t.name} runs every {period:g} s"
                    raise ValueError(f"{i} is built for {own:g} s, but {runs}")

    def _input(self, s: Signal) -> Port:
        return self._port(s, self.blocks[s.instance].inputs if s.instance in self.blocks else ())

    def _output(self, s: Signal) -> Port:
        if s.instance == WATCH:
            return self._port(s, tuple(WATCHED.values()))
        return self._port(s, self.blocks[s.instance].outputs if s.instance in self.blocks else ())

    def _port(self, s: Signal, ports: tuple[Port, ...]) -> Port:
        if found := [p for p in ports if p.name == s.port]:
            return found[0]
        raise ValueError(f"no such port {s.instance}.{s.port}; there are {[p.name for p in ports]}")

    def _external_input(self, name: str, sinks: tuple[Signal, ...]) -> External:
        ports = [self._input(s) for s in sinks]
        if len({(p.unit, p.size, p.low, p.high) for p in ports}) != 1:
            raise ValueError(f"external input {name} feeds ports of different unit, size or range")
        return External(name, ports[0], sinks)

    def _check_wires(self) -> None:
        fed = [s for x in self.inputs for s in x.signals] + list(self.wires)
        if len(fed) != len(set(fed)):
            raise ValueError("an input port is fed twice")
        for sink, source in self.wires.items():
            a, b = self._output(source), self._input(sink)
            if (a.kind, a.unit, a.size) != (b.kind, b.unit, b.size):
                ends = (f"{s} ({p.kind} {p.unit} x {p.size})" for s, p in ((source, a), (sink, b)))
                raise ValueError(" feeds ".join(ends))
            task = self.task_of(sink.instance)
            if source.instance != WATCH and self.task_of(source.instance) is task:
                order = task.blocks.index
                if order(source.instance) >= order(sink.instance):
                    raise ValueError(f"{source} must run before {sink} in task {task.name}")
        for name, block in self.blocks.items():
            for p in block.inputs:
                if Signal(name, p.name) not in fed:
                    raise ValueError(f"input {name}.{p.name} is not fed")

    def _latches(self) -> tuple[Latch, ...]:
        found: dict[Signal, Latch] = {}
        for sink, source in self.wires.items():
            if source.instance == WATCH:
                continue
            writer = self.task_of(source.instance)
            if writer is not self.task_of(sink.instance):
                name = f"{source.instance}_{source.port}"
                found.setdefault(source, Latch(name, source, self._output(source), writer.name))
        return tuple(found.values())

    def simulator(
        self, tunables: Mapping[str, Mapping[str, float]] | None = None
    ) -> SystemSimulator:
        """An executor of the whole System.

        Parameters
        ----------
        tunables : mapping, optional
            ``{instance: {tunable: value}}`` other than the defaults.
        """
        return SystemSimulator(self, tunables)


class SystemSimulator:
    """Runs a System symbolically, float64.

    Parameters
    ----------
    system : System
    tunables : mapping, optional
        ``{instance: {tunable: value}}`` other than the defaults.
    """

    def __init__(
        self, system: System, tunables: Mapping[str, Mapping[str, float]] | None = None
    ) -> None:
        self.system = system
        self.blocks: dict[str, Executor] = {
            i: b.simulator((tunables or {}).get(i)) for i, b in system.blocks.items()
        }
        self.pending: dict[str, Any] = {x.name: 0.0 for x in system.latches}
        self.visible: dict[str, Any] = {x.name: 0.0 for x in system.latches}
        self.held = {t.name: {x.name: 0.0 for x in system.latches_read(t)} for t in system.tasks}
        self.watch = TaskWatch()
        self.seen = {t.name: self.watch.values() for t in system.tasks}
        self.checked = 0
        self._steps = {t.name: [(i, self._feeds(i)) for i in t.blocks] for t in system.tasks}
        self._told = {
            t.name: [
                (x.name, (x.signals[0].instance, x.signals[0].port)) for x in system.task_outputs(t)
            ]
            for t in system.tasks
        }
        self._latched = {
            t.name: [
                (x.name, (x.source.instance, x.source.port))
                for x in system.latches
                if x.writer == t.name
            ]
            for t in system.tasks
        }
        self._checker = system.checker

    def _feeds(self, instance: str) -> list[tuple[str, int, Any]]:
        # Per input port: which of the tables in ``step`` it reads, and under which key.
        out: list[tuple[str, int, Any]] = []
        for p in self.system.blocks[instance].inputs:
            feed = self.system.feed(Signal(instance, p.name))
            if isinstance(feed, Signal):
                out.append((p.name, 3, (feed.instance, feed.port)))
            elif isinstance(feed, Watched):
                out.append((p.name, 2, feed.port.name))
            else:
                out.append((p.name, int(isinstance(feed, Latch)), feed.name))
        return out

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {', '.join(self.blocks)}>"

    def release(self, tick: int) -> None:
        """Release the latches due at a base tick; the tasks that start in it read them.

        Parameters
        ----------
        tick : int
            The base tick; call this before any task of it runs.
        """
        self.watch.see(tick)
        for task in self.system.tasks:
            since = tick - task.phase - task.release_ticks
            if since >= 0 and since % task.every == 0:
                self.watch.due(task.name)
                for name, _ in self._latched[task.name]:
                    self.visible[name] = self.pending[name]
                if task.name == self._checker:
                    self.watch.coeffs_ok = self.checked
        for task in self.system.tasks:
            if tick >= task.phase and (tick - task.phase) % task.every == 0:
                self.watch.start(task.name)
                self.seen[task.name] = self.watch.values()
                self.held[task.name] = {k: self.visible[k] for k in self.held[task.name]}

    def step(self, task_name: str, **inputs: Any) -> dict[str, Any]:
        """One run of a task: its external outputs.

        Parameters
        ----------
        task_name : str
        **inputs : float or ndarray
            Its external inputs.
        """
        results: dict[tuple[str, str], Any] = {}
        tables = inputs, self.held[task_name], self.seen[task_name], results
        for instance, feeds in self._steps[task_name]:
            values = {name: tables[k][key] for name, k, key in feeds}
            for port, value in self.blocks[instance].step(**values).items():
                results[instance, port] = value
        for name, source in self._latched[task_name]:
            self.pending[name] = results[source]
        self.watch.end(task_name)
        if task_name == self._checker:
            self.checked = 1
        return {name: results[source] for name, source in self._told[task_name]}


__all__ = ["External", "Latch", "Signal", "System", "SystemSimulator", "Task"]
