"""Metrics of one's own: a number per planner, in tables and JSON."""

from __future__ import annotations

import json
from collections.abc import Callable
from io import StringIO

import pytest
from rich.console import Console

from lndrl.errors import UserError
from lndrl.evaluation import EvaluationResult, comparison_table, own_metrics, result_table
from lndrl.evaluation.own_metrics import add_metrics
from lndrl.navigation import EpisodeRecord
from lndrl.navigation.reward import REWARD_PARTS

Write = Callable[..., str]
TEXT = """
    class Longest:
        def __call__(self, records):
            return {answer}
"""
LONGEST = TEXT.format(answer="max(record.time for record in records)")


def made_result(planner: str, *times: float) -> EvaluationResult:
    parts = dict.fromkeys(REWARD_PARTS, 0.0)
    records = tuple(
        EpisodeRecord(k, 0, "arrived", 3, time, 2.0, 0.1, 0.1, 0.1, 1.0, parts)
        for k, time in enumerate(times)
    )
    return EvaluationResult(planner, "hall", "amcl", "rule", 0, "0", "0", records)


def shown(table: object) -> str:
    console = Console(file=StringIO(), width=250)
    console.print(table)
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_it_stands_beside_the_nine(own_module: Write) -> None:
    metrics = own_metrics([f"{own_module(LONGEST)}:Longest"])
    results = [add_metrics(made_result(name, 3.0, 7.5), metrics) for name in ("a", "b")]
    assert results[0].own_metrics == {"Longest": 7.5}
    row = next(line for line in shown(result_table(results[0])).splitlines() if "Longest" in line)
    assert "7.500" in row
    table = shown(comparison_table(results))
    assert "Longest" in table and table.count("7.500") == 2
    data = json.loads(results[0].to_json())
    assert data["own_metrics"] == {"Longest": 7.5}
    assert EvaluationResult.from_dict(data) == results[0]


def test_without_one_nothing_changes() -> None:
    result = add_metrics(made_result("a", 3.0), [])
    assert result == made_result("a", 3.0) and "own_metrics" not in result.to_dict()


def test_none_is_no_figure(own_module: Write) -> None:
    metrics = own_metrics([f"{own_module(TEXT.format(answer='None'))}:Longest"])
    result = add_metrics(made_result("a", 3.0), metrics)
    assert result.to_dict()["own_metrics"] == {"Longest": None}
    assert "–" in next(x for x in shown(result_table(result)).splitlines() if "Longest" in x)


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        ("float('nan')", "nan for a is no figure; return None"),
        ("'much'", "failed: ValueError: could not convert"),
        ("records[9]", "failed: IndexError"),
    ],
)
def test_a_wrong_figure_is_one_sentence(own_module: Write, answer: str, sentence: str) -> None:
    name = f"{own_module(TEXT.format(answer=answer))}:Longest"
    with pytest.raises(UserError, match=f"metric {name}.*{sentence}"):
        add_metrics(made_result("a", 3.0), own_metrics([name]))


def test_two_of_one_name_are_refused(own_module: Write) -> None:
    names = [f"{own_module(LONGEST)}:Longest" for _ in range(2)]
    with pytest.raises(UserError, match="another one is called Longest, too"):
        own_metrics(names)
    assert len(own_metrics([names[0], names[0]])) == 1
