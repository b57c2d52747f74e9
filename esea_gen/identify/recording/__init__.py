"""Recordings of a rig: columns, defects, training and held-out data."""
