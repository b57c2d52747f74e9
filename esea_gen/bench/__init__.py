"""Bounds of instructions and releases of tasks."""
