"""Ports, Blocks, Programs, Systems.  Imports nothing else of this package."""
