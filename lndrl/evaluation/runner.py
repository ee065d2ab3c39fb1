"""Evaluating a planner on many episodes in parallel, with the same result however many help."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from typing import Any, Literal

from lndrl.config import (
    REPOSITORY_CONFIGS,
    RunConfig,
    load_config,
    load_scenario,
)
from lndrl.errors import UserError
from lndrl.evaluation.episodes import EpisodeRunner
from lndrl.evaluation.pool import Work, run_tasks
from lndrl.evaluation.result import EvaluationResult
from lndrl.machine.threads import kept_threads
from lndrl.navigation import EpisodeRecord
from lndrl.navigation.families import Family
from lndrl.navigation.terms import as_settled
from lndrl.planners import GuardedPlanner, PlannerSource, ShieldedPlanner, planner_source
from lndrl.policy import act_on_one_thread, load_engine
from lndrl.version import VERSION

BLOCK = 8
"""Episodes side by side in one worker. Fixed, and blocks never mix: rounding in a network
depends on the size of its batch, so the episodes of a batch must not depend on the workers."""

DEFAULT_CONFIG = REPOSITORY_CONFIGS / "lndrl.yaml"


def settings_for(
    source: PlannerSource,
    scenario: str | None = None,
    localization: Literal["amcl", "perfect"] | None = None,
) -> RunConfig:
    """Configuration to test ``source`` under: its own, or ``configs/lndrl.yaml`` for a rule.

    ``scenario`` (name or YAML file) and ``localization`` replace those inside. Raises UserError
    for an unknown scenario.
    """
    config = source.config or load_config(DEFAULT_CONFIG)
    changes: dict[str, object] = {}
    if scenario is not None:
        changes["scenario"] = load_scenario(scenario)
    if localization is not None:
        changes["localization"] = config.localization.model_copy(update={"kind": localization})
    return config.model_copy(update=changes)


def evaluate(
    planner: PlannerSource | str,
    config: RunConfig,
    episodes: int,
    seed: int = 0,
    workers: int = 0,
    greedy: bool = False,
    progress: Callable[[EpisodeRecord], None] | None = None,
) -> EvaluationResult:
    """Run validation episodes 0 to ``episodes`` - 1 of ``seed``; gathers their records in order.

    ``workers`` processes share the work, 0 keeps it in this one; the result is the same.
    ``progress`` gets each record as its episode ends, in any order. Ctrl-C leaves no process.

    Raises UserError when ``episodes`` is below 1, ``workers`` below 0, the planner cannot be
    found or built, the scenario is impossible, or a worker dies.
    """
    source = planner_source(planner) if isinstance(planner, str) else planner
    config = config.model_copy(update={"seed": seed})
    records: list[EpisodeRecord] = []
    vetoes: dict[int, int] = {}
    with driving(_make_work, (source, config, greedy), episodes, workers) as results:
        for record, vetoed in results:
            records.append(record)
            vetoes[record.world] = vetoed
            if progress is not None:
                progress(record)
    check_complete(records, episodes)
    return result_of(source, config, greedy, records, sum(vetoes.values()))


@contextmanager
def driving(
    make_work: Callable[..., Work],
    arguments: tuple[PlannerSource, RunConfig, *tuple[Any, ...]],
    episodes: int,
    workers: int,
) -> Iterator[Iterator[Any]]:
    """What ``make_work(*arguments)`` yields for validation episodes 0 to ``episodes`` - 1, which it
    gets in ranges of BLOCK; in any order, but the same whatever ``workers`` is.

    ``arguments`` begin with the planner and the configuration. No process is left behind, however
    it ends. Raises UserError as ``evaluate`` does.
    """
    if episodes < 1:
        raise UserError(f"{episodes} episodes cannot be evaluated; give 1 or more")
    if workers < 0:
        raise UserError(f"{workers} workers cannot work; give 0 (none but this process) or more")
    source, config, *_ = arguments
    blocks = [range(first, min(first + BLOCK, episodes)) for first in range(0, episodes, BLOCK)]
    results = run_tasks(make_work, arguments, blocks, min(workers, len(blocks)), config)
    with _same_threads_after(source, config), closing(results):
        yield results


def check_complete(records: Iterable[EpisodeRecord], episodes: int) -> None:
    """Assert that ``records``, in any order, are of validation episodes 0 to ``episodes`` - 1."""
    found = sorted(Family.VALIDATION.episode(record.world) for record in records)
    assert found == list(range(episodes))


def in_world_of(base: RunConfig, config: RunConfig) -> RunConfig:
    """What a policy of ``config`` is tested under in the world of ``base``.

    Scenario, world, filter, seed and the task's limits are those of ``base``; what the policy sees
    and does, its reward and its networks those of ``config``.
    """
    limits = ("arrive_distance", "lost_distance", "lost_angle", "time_limit", "judged_moment")
    kept = {name: getattr(base.task, name) for name in limits}
    return as_settled(config).model_copy(
        update={
            "seed": base.seed,
            "scenario": base.scenario,
            "world": base.world,
            "localization": base.localization,
            "task": config.task.model_copy(update=kept),
        }
    )


def result_of(
    source: PlannerSource,
    config: RunConfig,
    greedy: bool,
    records: Sequence[EpisodeRecord],
    vetoes: int | None = None,
) -> EvaluationResult:
    """The result of ``records``, which may be some of those that were asked for.

    ``config`` has the seed of the episodes; ``vetoes`` are those of shield and guard.
    """
    return EvaluationResult(
        planner=source.title,
        scenario=config.scenario.name,
        localization=config.localization.kind,
        actions="rule" if source.weights is None else "greedy" if greedy else "sampled",
        seed=config.seed,
        config_hash=config.content_hash(),
        program_version=VERSION,
        records=tuple(sorted(records, key=lambda record: record.world)),
        temperature=1.0 if greedy else source.temperature,
        vetoes=None if source.shield is None and source.guard is None else vetoes,
    )


def _make_work(source: PlannerSource, config: RunConfig, greedy: bool) -> Work:
    if source.weights is not None:
        act_on_one_thread(config)
    return _Counting(EpisodeRunner(source, config, greedy, Family.VALIDATION))


class _Counting:
    """Runs episodes; with each record comes in how many steps shield or guard vetoed."""

    def __init__(self, runner: EpisodeRunner) -> None:
        self._runner = runner

    def __call__(self, episodes: Sequence[int]) -> Iterator[tuple[EpisodeRecord, int]]:
        planner, family = self._runner.planner, self._runner.family
        rows = {family.world(k): row for row, k in enumerate(episodes)}
        for record in self._runner(episodes):
            row = rows[record.world]
            counting = ShieldedPlanner | GuardedPlanner
            yield record, int(planner.vetoes[row]) if isinstance(planner, counting) else 0


@contextmanager
def _same_threads_after(source: PlannerSource, config: RunConfig) -> Iterator[None]:
    """Give this process its threads back, should ``_make_work`` have run in it."""
    if source.weights is not None:
        load_engine(config)
    with kept_threads():
        yield
