"""The test bench: methods x scenarios x episodes, resumable, paired, with provenance."""

from lndrl.evaluation.benchmark.figures import Paired, Row, mcnemar, rows_of, summary_of
from lndrl.evaluation.benchmark.paper import PAPER
from lndrl.evaluation.benchmark.run import Cell, Plan
from lndrl.evaluation.benchmark.spec import (
    BENCHMARK,
    BenchmarkSpec,
    Contender,
    bench_config,
    bench_hash,
    choose,
    contenders,
    load_benchmark,
)
from lndrl.evaluation.benchmark.store import IDENTITY, Identity, ResultsFolder
from lndrl.evaluation.benchmark.table import benchmark_table
from lndrl.evaluation.benchmark.training import MethodRun, MethodsFolder, method_runs

__all__ = [
    "BENCHMARK",
    "IDENTITY",
    "PAPER",
    "BenchmarkSpec",
    "Cell",
    "Contender",
    "Identity",
    "MethodRun",
    "MethodsFolder",
    "Paired",
    "Plan",
    "ResultsFolder",
    "Row",
    "bench_config",
    "bench_hash",
    "benchmark_table",
    "choose",
    "contenders",
    "load_benchmark",
    "mcnemar",
    "method_runs",
    "rows_of",
    "summary_of",
]
