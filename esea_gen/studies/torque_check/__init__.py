"""Guided check of the torque sensor with a hanging mass."""
