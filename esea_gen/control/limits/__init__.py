"""Limits before the motor: checks, latch, faults, redundancy."""
