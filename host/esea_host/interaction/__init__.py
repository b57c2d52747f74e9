"""Interaction quality: through which compliant element motion is smoother, and feels better."""
