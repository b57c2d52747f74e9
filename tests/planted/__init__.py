"""Faults planted into Python sources, one at a time, to see whether the tests notice."""
