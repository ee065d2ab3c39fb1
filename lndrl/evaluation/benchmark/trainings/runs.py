"""Training every learned method of the bench: which run each needs, and how far that is."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lndrl.config import RunConfig, flatten, load_config
from lndrl.config.shipped import SHIPPED_POLICIES
from lndrl.curve import Standstill, conditions, read_curve, standstill
from lndrl.errors import UserError
from lndrl.evaluation.benchmark.spec import BenchmarkSpec, choose, shown
from lndrl.evaluation.sweep import Run, RunsFolder, State
from lndrl.numbering import checkpoints_in, step_of
from lndrl.planners import is_rule

RUNS = "runs"

# Where and how long a run works, not what it learns.
_FREE: Any = {
    "actor": {"count", "worlds", "threads", "precision"},
    "learner": {
        "total_steps", "threads", "device", "precision", "cuda_graphs", "checkpoint_interval",
        "keep_checkpoints", "queue_chunks", "queue_megabytes", "validation_episodes",
        "validation_share", "patience",
    },
    "transport": True,
}  # fmt: skip
_LONGEST = 40  # characters of a value that a sentence can hold


@dataclass(frozen=True)
class MethodRun:
    """The run ``runs/NAME`` of a method, trained with what ``file`` says.

    ``settings`` (key=value) are the bench's, over those of the file.
    """

    name: str
    config: RunConfig
    file: Path
    settings: tuple[str, ...] = ()

    def origin(self, key: str) -> str:
        """Who says what ``key`` is: the bench, or the file as a user would write it."""
        keys = {setting.partition("=")[0] for setting in self.settings}
        return "the bench" if key in keys else shown(self.file)


class MethodsFolder(RunsFolder):
    """The runs of methods in ``path``/runs; what else is kept lies in runs/train-all."""

    WORK = "lndrl train-all", "wait for its end"

    def __init__(self, path: Path, runs: Sequence[MethodRun]) -> None:
        super().__init__(path, runs, path / RUNS / "train-all")
        self.methods = tuple(runs)

    def state(self, run: Run) -> State:
        """How far the run is: finished where it has its steps, or its curve stands still."""
        known = checkpoints_in(self.run_path(run) / "checkpoints")
        if not known:
            return "missing"
        if step_of(known[-1]) >= run.config.learner.total_steps:
            return "finished"
        return "begun" if self.standstill(run) is None else "finished"

    def standstill(self, run: Run) -> Standstill | None:
        """Where the run's validated arrivals stopped rising, as the learner itself concludes it."""
        config = self._resumed(run)
        curve = read_curve(self.run_path(run) / "metrics.jsonl")
        return standstill(curve, config, conditions(config))

    def _resumed(self, run: Run) -> RunConfig:
        """What the run would go on with: its own configuration, with the bench's settings."""
        kept = self.run_path(run) / "config.yaml"
        if not kept.is_file():
            return run.config
        settings = next((each.settings for each in self.methods if each.name == run.name), ())
        return load_config(kept, list(settings))

    def early(self, run: Run) -> str:
        """See ``RunsFolder``."""
        found = self.standstill(run)
        if found is None or self.steps(run) >= run.config.learner.total_steps:
            return ""
        return str(found)

    def newest(self, run: Run) -> Mapping[str, Any]:
        """The run's newest row of metrics, empty before its first update."""
        try:
            rows = self.rows(run)
        except UserError:  # its first line is being written
            return {}
        return rows[-1] if rows else {}

    def check(self) -> None:
        """Raise UserError for a run folder that was trained with something else, or is none."""
        for run in self.methods:
            folder = Path(RUNS, run.name)
            path = self.run_path(run)
            if self.state(run) == "missing":
                if path.exists() and not (path / "run.json").is_file():
                    raise UserError(f"{folder}: is no run folder of lndrl; move it away")
                continue
            difference = _difference(load_config(path / "config.yaml"), run.config)
            if difference is not None:
                key, kept, wanted = difference
                raise UserError(
                    f"{folder}: trained with {key} {kept}, {run.origin(key)} says {wanted}; "
                    "move the folder away or leave the method out with --methods"
                )


def method_runs(
    spec: BenchmarkSpec,
    configs: Path,
    wanted: Sequence[str] | None = None,
    steps: int | None = None,
    seed: int | None = None,
) -> list[MethodRun]:
    """Runs that the methods ``wanted`` need, by default all learned ones; each once.

    ``steps`` and ``seed`` replace those of the configurations in ``configs``; a seed that is not a
    method's own trains into ``runs/METHOD-seedN``. Raises UserError for an unknown method, one
    that is a rule, and one whose run or configuration cannot be told.
    """
    learned = [
        name
        for name, method in spec.methods.items()
        if not is_rule(method.planner) and method.planner not in SHIPPED_POLICIES
    ]
    if wanted is None:
        # Under another seed the rows of one seed are those of another's.
        chosen = [n for n in learned if seed is None or spec.seed_of(n, configs) in (None, seed)]
    else:
        chosen = choose(list(spec.methods), wanted, "method")
    runs: dict[str, MethodRun] = {}
    for name in chosen:
        if name not in learned:
            rule = is_rule(spec.methods[name].planner)
            what = "is a rule" if rule else "comes with the program"
            raise UserError(
                f"method {name} {what}, nothing to train; learned are: {', '.join(learned)}"
            )
        run = _method_run(spec, configs, name, steps, seed)
        if runs.setdefault(run.name, run).config != run.config:
            raise UserError(
                f"method {name}: another method is trained into {RUNS}/{run.name} with another "
                "configuration or seed; give it a run folder of its own"
            )
    if not runs:
        raise UserError("the bench has no learned method, nothing to train")
    return list(runs.values())


def _method_run(
    spec: BenchmarkSpec, configs: Path, name: str, steps: int | None, seed: int | None
) -> MethodRun:
    planner = Path(spec.methods[name].planner)
    if planner.parent != Path(RUNS) or planner.is_file():
        raise UserError(f"method {name}: planner {planner} is no folder {RUNS}/NAME to train into")
    try:
        file = spec.config_of(name, configs) or spec.config_of(name)  # else the program's own
    except UserError as error:
        raise UserError(f"method {name}: {error}") from None
    if file is None:
        raise UserError(f"method {name}: its configuration {configs / name}.yaml does not exist")
    row = spec.seed_of(name, configs)
    if seed is not None and row is not None and row != seed:
        raise UserError(f"method {name} is of seed {row}, not {seed}; leave out --seed")
    settings = [*spec.training, *([] if row is None else [f"seed={row}"])]
    count = [] if steps is None else [f"learner.total_steps={steps}"]
    own = load_config(file, [*settings, *count])
    if seed is None or seed == own.seed:
        return MethodRun(planner.name, own, file, tuple(settings))
    other = own.model_copy(update={"seed": seed})
    return MethodRun(f"{planner.name}-seed{seed}", other, file, tuple(settings))


def _difference(kept: RunConfig, wanted: RunConfig) -> tuple[str, str, str] | None:
    """The first key that decides what is learned and differs, with both values in words."""
    one, two = (flatten(each.model_dump(mode="json", exclude=_FREE)) for each in (kept, wanted))
    for key in {**one, **two}:
        if one.get(key) != two.get(key):
            return key, _words(one.get(key)), _words(two.get(key))
    return None


def _words(value: Any) -> str:
    words = json.dumps(value)
    return words if len(words) <= _LONGEST else "something else"
