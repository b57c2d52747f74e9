"""Predictive control: plant and cost, rollout, box QP, and the controllers of a device."""
