"""``lndrl bench fleet``: how many actors one learner carries, with synthetic ones."""

from __future__ import annotations

from lndrl.bench.fleet.plan import MOST_ACTORS_PLAYED, Plan, plan_of
from lndrl.bench.fleet.row import Row, measure
from lndrl.bench.fleet.table import table

__all__ = ["MOST_ACTORS_PLAYED", "Plan", "Row", "measure", "plan_of", "table"]
