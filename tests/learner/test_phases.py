"""A run with a teacher: its phases as the log, the metrics, the actors and viewers see them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from actors.actor import Actor
from learner.learner import Learner
from learner.status import snapshot
from lndrl.errors import UserError
from lndrl.policy import Guidance
from lndrl.transport import MemoryNetwork
from lndrl.transport.status import parse_status
from lndrl.view.dashboard.screen import plain_line
from tests.learner.helpers_learner import small_config

PLAN = {"steps": 64, "drive_steps": 32, "kl_steps": 64}


@pytest.fixture
def config():
    return small_config(ppo={"teacher": "predictive"}, imitation=PLAN, learner={"total_steps": 160})


def play(learner: Learner, network: MemoryNetwork, until: int) -> list[Guidance]:
    """Real actors, until so many steps are trained; what they were told before each update."""
    life = f"life-{learner.counters.updates}"
    actor = Actor(network.actor(), actor_id="a", incarnation=life)
    told = []
    while learner.counters.steps < until:
        if actor.ready():
            actor.run_chunk()
        if learner.advance(timeout=0.0):
            assert actor.rollout is not None
            told.append(actor.rollout.guidance)
    return told


def rows_of(folder: Path) -> list[dict]:
    return [json.loads(line) for line in (folder / "metrics.jsonl").read_text().splitlines()]


def test_imitation_then_guided_then_reward_alone(config, tmp_path: Path) -> None:
    network = MemoryNetwork()
    learner = Learner(config, tmp_path / "run", network.learner(), quiet=True)
    try:
        learner.begin()
        assert parse_status(snapshot(learner)).phase == "imitation"
        told = play(learner, network, 160)
        status = parse_status(snapshot(learner))
        learner.end()
    finally:
        learner.close()
    rows = rows_of(tmp_path / "run")
    assert [row["phase"] for row in rows] == ["imitation"] * 2 + ["guided"] * 2 + ["reinforcement"]
    assert all(0.0 <= row["ppo"]["teacher_agreement"] <= 1.0 for row in rows)
    assert told[0] == Guidance(True, 1.0) and told[-1].labels is False
    phases = [event["text"] for event in learner.events.recent() if event["kind"] == "phase"]
    assert phases == [
        "imitation of predictive until step 64",
        "PPO, held to predictive by a divergence that fades until step 128",
        "PPO",
    ]
    assert (status.phase, status.phase_until) == ("reinforcement", None)
    assert "  reinforcement  " in plain_line(status)


def test_a_resumed_run_goes_on_in_its_phase(config, tmp_path: Path) -> None:
    network = MemoryNetwork()
    learner = Learner(config, tmp_path / "run", network.learner(), quiet=True)
    learner.begin()
    play(learner, network, 32)
    learner.end()
    learner.close()
    network = MemoryNetwork()
    learner = Learner(config, tmp_path / "run", network.learner(), resume=True, quiet=True)
    try:
        learner.begin()
        assert parse_status(snapshot(learner)).phase_until == 64
        told = play(learner, network, 96)
        learner.end()
    finally:
        learner.close()
    assert told[0] == Guidance(True, 0.0)
    assert [row["phase"] for row in rows_of(tmp_path / "run")] == ["imitation"] * 2 + ["guided"]


def test_a_run_without_a_teacher_speaks_of_no_phase(tmp_path: Path) -> None:
    network = MemoryNetwork()
    learner = Learner(small_config(), tmp_path / "run", network.learner(), quiet=True)
    try:
        learner.begin()
        status = parse_status(snapshot(learner))
        assert (status.phase, status.phase_until) == ("", None)
        assert not [event for event in learner.events.recent() if event["kind"] == "phase"]
    finally:
        learner.close()


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"speed": 3}, r"imitation\.settings of the teacher predictive.*speed"),
        ({"goal_weight": "much"}, r"imitation\.settings of the teacher predictive.*goal_weight"),
    ],
)
def test_a_teacher_with_settings_that_it_does_not_have_leaves_no_folder(
    config, tmp_path: Path, settings: dict, sentence: str
) -> None:
    wrong = config.imitation.model_copy(update={"settings": settings})
    with pytest.raises(UserError, match=sentence):
        Learner(
            config.model_copy(update={"imitation": wrong}),
            tmp_path / "run",
            MemoryNetwork().learner(),
            quiet=True,
        )
    assert not (tmp_path / "run").exists()


def test_a_teacher_that_cannot_teach_the_task_leaves_no_folder(config, tmp_path: Path) -> None:
    blind = config.model_copy(
        update={
            "ppo": config.ppo.model_copy(update={"teacher": "careful"}),
            "localization": config.localization.model_copy(update={"kind": "perfect"}),
        }
    )
    with pytest.raises(UserError, match="careful goes by the belief's variances"):
        Learner(blind, tmp_path / "run", MemoryNetwork().learner(), quiet=True)
    assert not (tmp_path / "run").exists()
