from __future__ import annotations

import json
from dataclasses import replace

import pytest
from rich.console import Console

from lndrl.config import RunConfig
from lndrl.evaluation import EvaluationResult, evaluate, result_table
from lndrl.evaluation.tables import describe
from lndrl.planners import PlannerSource, ShieldConfig
from lndrl.policy import initial_weights

EPISODES = 10


@pytest.fixture(scope="module")
def config() -> RunConfig:
    """A small room in which three people stand about; a network of a few thousand weights."""
    scenario = {
        "name": "room",
        "size": [7, 5],
        "pedestrians": {
            "count": [3, 3],
            "routes": [{"start": [2, 1, 5, 4], "goal": [2, 1, 5, 4]}],
        },
        "robot": [{"start": [1, 1, 2, 4], "goal": [5, 1, 6, 4]}],
    }
    return RunConfig.model_validate(
        {
            "scenario": scenario,
            "task": {"time_limit": 12.0},
            "localization": {"min_particles": 100, "max_particles": 200},
            "network": {"map_channels": [2, 2, 2], "features": 8, "goal_features": 4},
        }
    )


@pytest.fixture(scope="module")
def alone(config: RunConfig) -> PlannerSource:
    return PlannerSource("learned", config, initial_weights(config))


@pytest.fixture(scope="module")
def shielded(config: RunConfig, alone: PlannerSource) -> EvaluationResult:
    return evaluate(replace(alone, shield=ShieldConfig()), config, EPISODES, seed=2)


def test_vetoes_are_counted_whoever_helps(
    config: RunConfig, alone: PlannerSource, shielded: EvaluationResult
) -> None:
    assert shielded.vetoes is not None and shielded.vetoes > 0
    assert shielded.vetoes <= sum(record.steps for record in shielded.records)
    source = replace(alone, shield=ShieldConfig())
    assert evaluate(source, config, EPISODES, seed=2, workers=2) == shielded


def test_without_a_shield_nothing_is_said_of_it(config: RunConfig, alone: PlannerSource) -> None:
    result = evaluate(alone, config, EPISODES, seed=2)
    assert result.vetoes is None and "vetoes" not in result.to_dict()
    assert result.planner == "learned"


def test_a_shield_that_vetoes_nothing_changes_nothing(
    config: RunConfig, alone: PlannerSource
) -> None:
    never = ShieldConfig(horizon=0.001, margin=0.0, person_radius=0.0)
    result = evaluate(replace(alone, shield=never), config, EPISODES, seed=2)
    assert result.records == evaluate(alone, config, EPISODES, seed=2).records
    assert result.vetoes == 0


def test_the_table_and_the_json_say_how_often_it_vetoed(shielded: EvaluationResult) -> None:
    assert shielded.planner == "learned+shield"
    console = Console(width=120)
    with console.capture() as said:
        console.print(result_table(shielded))
    steps = sum(record.steps for record in shielded.records)
    assert f"{shielded.vetoes:,} of {steps:,} steps" in said.get()
    assert EvaluationResult.from_dict(json.loads(shielded.to_json())) == shielded


def test_a_temperature_is_behind_the_shield_as_without_it(
    config: RunConfig, alone: PlannerSource, shielded: EvaluationResult
) -> None:
    never = ShieldConfig(horizon=0.001, margin=0.0, person_radius=0.0)
    cold = alone.at_temperature(0.05)
    result = evaluate(replace(cold, shield=never), config, EPISODES, seed=2)
    assert result.records == evaluate(cold, config, EPISODES, seed=2).records
    assert result.records != evaluate(alone, config, EPISODES, seed=2).records
    data = result.to_dict()
    assert (data["temperature"], data["vetoes"], data["planner"]) == (0.05, 0, "learned+shield")
    assert EvaluationResult.from_dict(data) == result
    assert "learned+shield (temperature 0.05)" in describe(result)
