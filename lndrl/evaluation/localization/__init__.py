"""How well the filter localizes: recorded drives, replayed under several settings."""

from lndrl.evaluation.localization.carmen import LaserLog, load_carmen
from lndrl.evaluation.localization.drives import Drive, record_drive
from lndrl.evaluation.localization.figures import Cell, Outcome, recovery_seconds
from lndrl.evaluation.localization.logs import (
    HEARD,
    LogOutcome,
    LogPlan,
    LogReport,
    log_markdown,
    log_table,
    measure_logs,
)
from lndrl.evaluation.localization.replay import Replayer
from lndrl.evaluation.localization.report import Plan, Report, measure_localization
from lndrl.evaluation.localization.settings import label_of, load_settings, scenarios_named
from lndrl.evaluation.localization.surveys import survey
from lndrl.evaluation.localization.tables import (
    LOGS_BEGIN,
    LOGS_END,
    check_document,
    report_markdown,
    report_tables,
    write_document,
)
from lndrl.evaluation.localization.tour import RouteMap, Tour

__all__ = [
    "HEARD",
    "LOGS_BEGIN",
    "LOGS_END",
    "Cell",
    "Drive",
    "LaserLog",
    "LogOutcome",
    "LogPlan",
    "LogReport",
    "Outcome",
    "Plan",
    "Replayer",
    "Report",
    "RouteMap",
    "Tour",
    "check_document",
    "label_of",
    "load_carmen",
    "load_settings",
    "log_markdown",
    "log_table",
    "measure_localization",
    "measure_logs",
    "record_drive",
    "recovery_seconds",
    "report_markdown",
    "report_tables",
    "scenarios_named",
    "survey",
    "write_document",
]
