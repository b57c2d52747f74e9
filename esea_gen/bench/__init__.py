"""Benchmarks: the generated C against its peers, on this machine and on an emulated board."""

from esea_gen.bench.bench import Row, run_benchmarks

__all__ = ["Row", "run_benchmarks"]
