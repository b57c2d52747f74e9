"""Benchmarks: the generated C and the host tools against peers, in the same run."""
