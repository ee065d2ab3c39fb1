"""A learner whose versions are published, and validated, as a test wants."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from learner.learner import Learner
from learner.run.best import read_best
from lndrl.config import RunConfig
from lndrl.transport import (
    COUNTS,
    EvaluatorHello,
    MemoryNetwork,
    ValidationResult,
    ValidationTask,
)
from lndrl.version import VERSION
from tests.learner.helpers_learner import small_config

HELLO = EvaluatorHello("evaluator-0", "first", "here", 1, VERSION)
EPISODES = 20


def counts(arrived: int, episodes: int = EPISODES) -> dict[str, int]:
    """Episodes of ten steps, of which the others collided."""
    return dict(
        zip(COUNTS, (episodes, arrived, episodes - arrived, 0, 0, 10 * episodes), strict=True)
    )


def small(**changes: Any) -> RunConfig:
    return small_config(learner={"validation_episodes": EPISODES, "keep_checkpoints": 2, **changes})


class Trained:
    """A learner that never trains: versions are published as a test wants."""

    def __init__(self, path: Path, config: RunConfig | None = None, **options: Any) -> None:
        self.network = MemoryNetwork()
        config = config or small()
        self.learner = Learner(config, path, self.network.learner(), quiet=True, **options)
        self.learner.begin()
        self.evaluator = self.network.evaluator()
        self.validation = self.learner.validation

    def publish(self, version: int) -> None:
        counters = self.learner.counters
        counters.updates, counters.steps = version, version * 1000
        self.learner._publish()

    def ask(self, hello: EvaluatorHello = HELLO) -> ValidationTask:
        return self.evaluator.ask(hello)

    def result(self, task: ValidationTask, arrived: int, greedy: int = 0) -> ValidationResult:
        return ValidationResult(
            *(task.run_id, "evaluator-0", "first", task.learner_incarnation, task.version, 3.0),
            *(counts(arrived), counts(greedy)),
        )

    def tell(self, result: ValidationResult) -> str:
        ack = self.evaluator.report(result)
        assert ack is not None
        self.validation.turn(self.learner.recorder, self.learner.counters.updates)
        return ack.status

    def validate(self, version: int, arrived: int) -> str:
        self.publish(version)
        task = self.ask()
        assert task.version == version
        return self.tell(self.result(task, arrived))

    def best(self) -> int | None:
        """Version of the policy that is kept as the best."""
        found = read_best(self.learner.folder.checkpoints)
        return None if found is None else found["version"]
