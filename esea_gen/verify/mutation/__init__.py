"""Mutation: faults put into kernels and wiring, printed as the C that ships is, and looked for."""
