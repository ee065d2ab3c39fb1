"""The test bench: methods x scenarios x episodes, resumable, paired, with provenance."""

from lndrl.evaluation.benchmark.calibration import (
    CALIBRATION,
    METHOD,
    BenchVariant,
    CalibrationSpec,
    calibration_table,
    load_calibration,
    targets,
)
from lndrl.evaluation.benchmark.figures import Paired, Row, mcnemar, rows_of, summary_of
from lndrl.evaluation.benchmark.paper import PAPER
from lndrl.evaluation.benchmark.run import Cell, Plan
from lndrl.evaluation.benchmark.spec import (
    BENCHMARK,
    BenchmarkSpec,
    Contender,
    bench_config,
    bench_hash,
    check_frozen,
    choose,
    contenders,
    load_benchmark,
)
from lndrl.evaluation.benchmark.store import IDENTITY, Identity, ResultsFolder
from lndrl.evaluation.benchmark.table import benchmark_table

__all__ = [
    "BENCHMARK",
    "CALIBRATION",
    "IDENTITY",
    "METHOD",
    "PAPER",
    "BenchVariant",
    "BenchmarkSpec",
    "CalibrationSpec",
    "Cell",
    "Contender",
    "Identity",
    "Paired",
    "Plan",
    "ResultsFolder",
    "Row",
    "bench_config",
    "bench_hash",
    "benchmark_table",
    "calibration_table",
    "check_frozen",
    "choose",
    "contenders",
    "load_benchmark",
    "load_calibration",
    "mcnemar",
    "rows_of",
    "summary_of",
    "targets",
]
