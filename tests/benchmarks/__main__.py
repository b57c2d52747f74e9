"""``python -m tests.benchmarks``: print the benchmarks and write ``bench.json``."""

from tests.benchmarks.sensor import main

if __name__ == "__main__":
    raise SystemExit(main())
