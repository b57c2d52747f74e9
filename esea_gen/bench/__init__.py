"""Benchmarks: the generated C against its peers, on this machine and on an emulated board."""

from esea_gen.bench.bench import run_benchmarks
from esea_gen.bench.row import Row

__all__ = ["Row", "run_benchmarks"]
