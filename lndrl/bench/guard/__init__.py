"""``lndrl bench guard``: contests of the guard with bodies that do their worst."""

from lndrl.bench.guard.contest import CASES, STEPS, measure, run

__all__ = ["CASES", "STEPS", "measure", "run"]
