"""A small run with real worlds, and a learner that only takes notes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.policy import initial_weights
from lndrl.transport import (
    Ack,
    ChunkHeader,
    EvaluatorHello,
    Hello,
    LearnerEndpoint,
    MemoryNetwork,
    Refusal,
    ValidationResult,
    ValidationTask,
    Welcome,
)

SMALL = {
    "seed": 3,
    "scenario": {
        "name": "room",
        "size": [10.0, 8.0],
        "resolution": 0.1,
        "obstacles": [{"box": [4.5, 3.5, 5.5, 4.5]}],
        "pedestrians": {
            "count": [1, 3],
            "routes": [{"start": [1.0, 6.0, 3.0, 7.0], "goal": [7.0, 1.0, 9.0, 2.0]}],
        },
        "robot": [{"start": [1.0, 1.0, 3.0, 3.0], "goal": [7.0, 5.0, 9.0, 7.0]}],
    },
    "localization": {"min_particles": 50, "max_particles": 100},
    "network": {"map_channels": [2, 2, 2], "features": 8, "goal_features": 4},
    "actor": {"worlds": 2, "horizon": 8},
}


def _merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    result = dict(base)
    for key, value in changes.items():
        old = result.get(key)
        result[key] = _merged(old, value) if isinstance(old, dict) else value
    return result


@pytest.fixture
def small_config() -> Callable[..., RunConfig]:
    """Builds the small run with the given sections changed."""
    return lambda **changes: RunConfig.model_validate(_merged(SMALL, changes))


class NotingLearner:
    """Answers like a learner and keeps what it was sent; ``answer`` decides about a chunk."""

    def __init__(self, config: RunConfig, endpoint: LearnerEndpoint) -> None:
        self.config = config
        self.endpoint = endpoint
        self.hellos: list[Hello] = []
        self.members: list[tuple[str, str, bool]] = []
        self.headers: list[ChunkHeader] = []
        self.arrays: list[dict[str, NDArray[Any]]] = []
        self.results: list[ValidationResult] = []
        self.refusal = ""
        self.answer: Callable[[ChunkHeader], str] = lambda header: "accepted"
        self.blobs: dict[int, bytes] = {}
        endpoint.start(self, self)

    def publish(self, version: int) -> None:
        """Offer other weights under ``version``."""
        seeded = self.config.model_copy(update={"seed": 1000 + version})
        self.blobs[version] = initial_weights(seeded)
        self.endpoint.publish_weights(version, self.blobs[version])

    def on_hello(self, hello: Hello) -> Welcome | Refusal:
        self.hellos.append(hello)
        if self.refusal:
            return Refusal(self.refusal)
        config = self.config.model_dump(mode="json")
        known = list(dict.fromkeys(h.actor_id for h in self.hellos))
        return Welcome("run-1", config, known.index(hello.actor_id))

    def on_chunk(self, header: ChunkHeader, arrays: dict[str, NDArray[Any]], size: int) -> Ack:
        status = self.answer(header)
        if status == "accepted":
            self.headers.append(header)
            self.arrays.append(arrays)
        return Ack(status, reason="" if status == "accepted" else "as the test wants")

    def on_evaluator(self, hello: EvaluatorHello) -> ValidationTask | Refusal:
        if self.refusal:
            return Refusal(self.refusal)
        return ValidationTask("run-1", self.config.model_dump(mode="json"), max(self.blobs))

    def on_validation(self, result: ValidationResult) -> Ack:
        self.results.append(result)
        return Ack("accepted")

    def on_malformed(self, reason: str) -> None:
        pass

    def on_member(self, actor_id: str, incarnation: str, alive: bool) -> None:
        self.members.append((actor_id, incarnation, alive))

    def versions(self) -> list[int]:
        """Weights version of every chunk taken; all samples of a chunk share it."""
        for arrays in self.arrays:
            assert (arrays["version"] == arrays["version"][0, 0]).all()
        return [int(arrays["version"][0, 0]) for arrays in self.arrays]


@pytest.fixture
def noting_learner() -> Iterator[Callable[..., NotingLearner]]:
    """Builds learners over one in-memory network, closed at the end."""
    made: list[NotingLearner] = []

    def build(config: RunConfig, endpoint: LearnerEndpoint | None = None) -> NotingLearner:
        learner = NotingLearner(config, endpoint or MemoryNetwork().learner())
        made.append(learner)
        return learner

    yield build
    for learner in made:
        learner.endpoint.close()
