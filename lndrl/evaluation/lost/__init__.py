"""Why a planner or policy gets lost: how, what came before it, and how likely it is where."""

from lndrl.evaluation.lost.record import AHEAD, COLUMNS, Recorder, Trace
from lndrl.evaluation.lost.report import LostReport
from lndrl.evaluation.lost.run import check_localization, trace_episodes
from lndrl.evaluation.lost.summary import CELL, RISKS, Cell, Limits, Loss
from lndrl.evaluation.lost.tables import RISK_NAMES, bin_names, lost_tables, summary_lines

__all__ = [
    "AHEAD",
    "CELL",
    "COLUMNS",
    "RISKS",
    "RISK_NAMES",
    "Cell",
    "Limits",
    "Loss",
    "LostReport",
    "Recorder",
    "Trace",
    "bin_names",
    "check_localization",
    "lost_tables",
    "summary_lines",
    "trace_episodes",
]
