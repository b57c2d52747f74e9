"""Recordings of a rig: what their columns mean, what is wrong with them, what trains and judges."""
