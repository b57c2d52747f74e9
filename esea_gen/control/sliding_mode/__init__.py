"""Sliding mode control: surface, law, softening, governor, and its linear loop."""
