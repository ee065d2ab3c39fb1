"""Ablations of training settings: variants over seeds, run by ``lndrl train``, and figures."""

from lndrl.evaluation.estimate import Estimate
from lndrl.evaluation.sweep.figures import (
    RunFigures,
    SweepFigures,
    VariantFigures,
    sweep_figures,
)
from lndrl.evaluation.sweep.folder import Run, RunsFolder, State, SweepFolder
from lndrl.evaluation.sweep.processes import Launcher, Trainer
from lndrl.evaluation.sweep.runs import Job, Process, Progress, Work, next_job
from lndrl.evaluation.sweep.spec import PlannedRun, Sweep, SweepSpec, Variant, load_sweep

__all__ = [
    "Estimate",
    "Job",
    "Launcher",
    "PlannedRun",
    "Process",
    "Progress",
    "Run",
    "RunFigures",
    "RunsFolder",
    "State",
    "Sweep",
    "SweepFigures",
    "SweepFolder",
    "SweepSpec",
    "Trainer",
    "Variant",
    "VariantFigures",
    "Work",
    "load_sweep",
    "next_job",
    "sweep_figures",
]
