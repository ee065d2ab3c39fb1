"""The results page: the paper's table beside ours, paired comparisons, and the goals."""

from lndrl.evaluation.benchmark.results.goals import GOALS, Goal, Verdict, verdicts
from lndrl.evaluation.benchmark.results.page import Comparison, Results, gather
from lndrl.evaluation.benchmark.results.paired import Difference, paired_interval
from lndrl.evaluation.benchmark.results.repeated import Repeated, repeated

__all__ = [
    "GOALS",
    "Comparison",
    "Difference",
    "Goal",
    "Repeated",
    "Results",
    "Verdict",
    "gather",
    "paired_interval",
    "repeated",
    "verdicts",
]
