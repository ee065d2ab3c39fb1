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
from lndrl.evaluation.benchmark.handing import (
    SHIPPED,
    check_bench,
    pack,
    pack_trainings,
    shipped_results,
    trainings_of,
)
from lndrl.evaluation.benchmark.paper import ALIKE, EPISODES, PAPER
from lndrl.evaluation.benchmark.replay import (
    Drive,
    Replay,
    contender_named,
    contenders_named,
)
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
from lndrl.evaluation.benchmark.trainings import (
    MethodRun,
    MethodsFolder,
    Training,
    kept_trainings,
    method_runs,
)
from lndrl.evaluation.benchmark.worst import (
    Recorded,
    badness,
    check_scenario,
    contender_tested,
    difference,
    drive_again,
    worst_episodes,
)

__all__ = [
    "ALIKE",
    "BENCHMARK",
    "CALIBRATION",
    "EPISODES",
    "IDENTITY",
    "METHOD",
    "PAPER",
    "SHIPPED",
    "BenchVariant",
    "BenchmarkSpec",
    "CalibrationSpec",
    "Cell",
    "Contender",
    "Drive",
    "Identity",
    "MethodRun",
    "MethodsFolder",
    "Paired",
    "Plan",
    "Recorded",
    "Replay",
    "ResultsFolder",
    "Row",
    "Training",
    "badness",
    "bench_config",
    "bench_hash",
    "benchmark_table",
    "calibration_table",
    "check_bench",
    "check_frozen",
    "check_scenario",
    "choose",
    "contender_named",
    "contenders",
    "contenders_named",
    "difference",
    "drive_again",
    "kept_trainings",
    "load_benchmark",
    "load_calibration",
    "mcnemar",
    "method_runs",
    "pack",
    "pack_trainings",
    "rows_of",
    "shipped_results",
    "summary_of",
    "targets",
    "trainings_of",
    "contender_tested",
    "worst_episodes",
]
