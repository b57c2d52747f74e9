"""Interaction quality: through which compliant element motion is smoother, and feels better."""

from esea_host.interaction import tasks

__all__ = ["tasks"]
