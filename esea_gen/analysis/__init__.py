"""Response, passivity, sweeps and many cases: figures from signals."""
