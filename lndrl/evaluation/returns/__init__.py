"""What planners earn by a training's reward, at one discount and another."""

from lndrl.evaluation.returns.discount import discounted_sums, learning_parts
from lndrl.evaluation.returns.drive import EpisodeReturns, PlannerReturns, drive_returns, paid_as
from lndrl.evaluation.returns.report import ReturnsReport
from lndrl.evaluation.returns.tables import returns_tables

__all__ = [
    "EpisodeReturns",
    "PlannerReturns",
    "ReturnsReport",
    "discounted_sums",
    "drive_returns",
    "learning_parts",
    "paid_as",
    "returns_tables",
]
