"""The paper's nine metrics, the test bench that gathers them, and tables."""

from lndrl.evaluation.episodes import EpisodeRunner
from lndrl.evaluation.metrics import Metrics, Rate, Spread, metrics_of
from lndrl.evaluation.own_metrics import OwnMetric, add_metrics, own_metrics
from lndrl.evaluation.result import EvaluationResult, load_result
from lndrl.evaluation.runner import BLOCK, evaluate, result_of, settings_for
from lndrl.evaluation.tables import comparison_table, result_table
from lndrl.wilson import wilson_interval

__all__ = [
    "BLOCK",
    "EpisodeRunner",
    "EvaluationResult",
    "Metrics",
    "OwnMetric",
    "Rate",
    "Spread",
    "add_metrics",
    "comparison_table",
    "evaluate",
    "load_result",
    "metrics_of",
    "own_metrics",
    "result_of",
    "result_table",
    "settings_for",
    "wilson_interval",
]
