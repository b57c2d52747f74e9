"""Passivity of the rendered impedance over its gains, and the sliding condition."""
