"""Benchmarks of the parts; ``lndrl.bench.report`` knows them by name."""
