"""The wrist study: simulated impairment, virtual normalisation, motor-learning task."""

from esea_host.wrist import moving, tasks

__all__ = ["moving", "tasks"]
