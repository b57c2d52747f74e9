"""``python -m esea_gen.bench``: print the benchmarks and write ``bench.json``."""

from esea_gen.bench.bench import main

if __name__ == "__main__":
    raise SystemExit(main())
