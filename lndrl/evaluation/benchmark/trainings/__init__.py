"""How the bench's learned methods come to be: their runs, and what is kept of these."""

from lndrl.evaluation.benchmark.trainings.kept import (
    Training,
    kept_trainings,
    read_training,
    training_file,
    training_of,
    write_training,
)
from lndrl.evaluation.benchmark.trainings.runs import RUNS, MethodRun, MethodsFolder, method_runs

__all__ = [
    "RUNS",
    "MethodRun",
    "MethodsFolder",
    "Training",
    "kept_trainings",
    "method_runs",
    "read_training",
    "training_file",
    "training_of",
    "write_training",
]
