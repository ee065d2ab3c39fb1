from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from lndrl.errors import UserError
from lndrl.evaluation.metrics import Rate, Spread, metrics_of
from lndrl.evaluation.result import EvaluationResult, load_result
from lndrl.evaluation.tables import comparison_table, result_table
from lndrl.navigation import EpisodeRecord
from lndrl.navigation.reward import REWARD_PARTS


def record(k: int, outcome: str, time: float = 10.0, **changes: float) -> EpisodeRecord:
    values = {
        "distance": 8.0,
        "position_error": 0.1,
        "angle_error": 0.05,
        "variance_sum": 0.02,
        "episode_return": 100.0,
        **changes,
    }
    return EpisodeRecord(
        world=k,
        episode=0,
        outcome=outcome,  # type: ignore[arg-type]
        steps=25,
        time=time,
        reward_parts=dict.fromkeys(REWARD_PARTS, 0.0),
        **values,
    )


RECORDS = (
    record(0, "arrived", 20.0, distance=10.0, position_error=0.2, variance_sum=0.1),
    record(1, "collided", 3.0, distance=1.0, position_error=0.4, variance_sum=0.3),
    record(2, "arrived", 30.0, distance=14.0, position_error=0.3, angle_error=0.25),
    record(3, "lost", 40.0, distance=20.0, position_error=1.1, angle_error=0.65),
    record(4, "timeout", 60.0, distance=0.0, position_error=0.0, angle_error=0.0),
)


def result(records: tuple[EpisodeRecord, ...] = RECORDS, **changes: object) -> EvaluationResult:
    base = EvaluationResult(
        planner="straight",
        scenario="hybrid",
        localization="amcl",
        actions="sampled",
        seed=7,
        config_hash="0123456789ab",
        program_version="9.9.9",
        records=records,
    )
    return replace(base, **changes)  # type: ignore[arg-type]


def text(table: object) -> str:
    console = Console(width=200)
    with console.capture() as captured:
        console.print(table)
    return captured.get()


def test_rates_count_outcomes_and_sum_to_one() -> None:
    metrics = metrics_of(RECORDS)
    rates = [metrics.arrival, metrics.collision, metrics.lost, metrics.stuck]
    assert [rate.value for rate in rates] == [0.4, 0.2, 0.2, 0.2]
    assert sum(rate.value for rate in rates) == pytest.approx(1.0)
    assert metrics.arrival.interval == pytest.approx((0.1176, 0.7693), abs=1e-4)


def test_reach_time_and_distance_are_of_arrived_episodes_only() -> None:
    metrics = metrics_of(RECORDS)
    assert metrics.reach_time == Spread(25.0, 5.0, 2)
    assert metrics.distance == Spread(12.0, 2.0, 2)


def test_errors_are_over_all_episodes() -> None:
    metrics = metrics_of(RECORDS)
    errors = [0.2, 0.4, 0.3, 1.1, 0.0]
    assert metrics.position_error.mean == pytest.approx(np.mean(errors))
    assert metrics.position_error.deviation == pytest.approx(np.std(errors))
    assert metrics.angle_error.mean == pytest.approx(np.mean([0.05, 0.05, 0.25, 0.65, 0.0]))
    assert metrics.variance_sum.mean == pytest.approx(np.mean([0.1, 0.3, 0.02, 0.02, 0.02]))
    assert metrics.angle_error.episodes == metrics.variance_sum.episodes == 5


def test_without_arrivals_there_is_no_reach_time() -> None:
    metrics = metrics_of([record(0, "lost")])
    assert metrics.reach_time == Spread(None, None, 0)
    assert metrics.arrival.value == 0.0
    assert "–" in text(result_table(result((record(0, "lost"),))))


def test_no_episodes_at_all() -> None:
    assert metrics_of([]).lost == Rate(0, 0)
    assert metrics_of([]).lost.value == 0.0


def test_an_unknown_outcome_is_refused() -> None:
    with pytest.raises(ValueError, match="exploded"):
        metrics_of([record(0, "exploded")])


def test_json_holds_provenance_and_comes_back_equal(tmp_path) -> None:
    path = tmp_path / "result.json"
    path.write_text(result().to_json())
    data = json.loads(path.read_text())
    assert (data["program_version"], data["scenario"], data["seed"]) == ("9.9.9", "hybrid", 7)
    assert (data["config_hash"], data["episodes"]) == ("0123456789ab", 5)
    assert data["actions"] == "sampled"
    assert data["metrics"]["arrival"]["rate"] == 0.4
    assert data["metrics"]["reach_time"] == {"mean": 25.0, "deviation": 5.0, "episodes": 2}
    assert load_result(path) == result()


@pytest.mark.parametrize(
    ("content", "sentence"),
    [("{", "not a readable JSON"), ("[]", "not the JSON"), ('{"planner": "x"}', "scenario")],
)
def test_unusable_json_is_refused_with_the_file_name(tmp_path, content: str, sentence: str) -> None:
    path = tmp_path / "result.json"
    path.write_text(content)
    with pytest.raises(UserError, match=f"result.json.*{sentence}"):
        load_result(path)


def test_unknown_actions_are_refused() -> None:
    data = {**result().to_dict(), "actions": "guessed"}
    with pytest.raises(UserError, match="sampled, greedy, rule"):
        EvaluationResult.from_dict(data, "here")


def test_a_missing_result_is_named(tmp_path) -> None:
    with pytest.raises(UserError, match=r"none\.json: no such file"):
        load_result(tmp_path / "none.json")


def test_tables_show_what_was_computed() -> None:
    shown = text(result_table(result()))
    assert "straight on hybrid: 5 episodes, seed 7, amcl localization" in shown
    assert "0.400" in shown and "0.118 to 0.769" in shown and "2 of 5" in shown
    compared = text(comparison_table([result(), result(planner="mine", actions="greedy")]))
    assert "mine (greedy)" in compared and "25.000/5.000" in compared


def test_only_results_of_the_same_episodes_are_compared() -> None:
    for other in (result(seed=8), result(scenario="hall"), result(RECORDS[:4])):
        with pytest.raises(UserError, match="same episodes"):
            comparison_table([result(), other])


def test_no_number_is_infinite_in_json() -> None:
    values = json.dumps(result(()).to_dict(), allow_nan=False)
    assert math.isfinite(json.loads(values)["metrics"]["lost"]["rate"])
