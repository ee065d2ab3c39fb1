"""The configurations of the table's rows differ in what their rows say, and in nothing else."""

from __future__ import annotations

from typing import Any

import pytest

from lndrl.config import load_config


@pytest.mark.parametrize(
    ("name", "differs"),
    [
        (
            "drl_laser",
            {
                "task.scan_frames": 3,
                "task.reward.pose": 0.0,
                "task.reward.lost": 0.0,
                "replicas.count": 0,
                "replicas.lost": 0.0,
                "network.scan_encoder": "fan",
                "network.pedestrian_map": False,
                "network.variances": False,
            },
        ),
        (
            "drl_laser_ped",
            {
                "task.scan_frames": 3,
                "task.reward.pose": 0.0,
                "task.reward.lost": 0.0,
                "replicas.count": 0,
                "replicas.lost": 0.0,
                "network.scan_encoder": "fan",
                "network.variances": False,
            },
        ),
        ("no_variance", {"network.variances": False}),
        ("no_reward", {"task.reward.pose": 0.0}),
    ],
)
def test_each_baseline_differs_in_what_it_ablates_alone(
    name: str, differs: dict[str, object]
) -> None:
    assert difference("table-lndrl", name) == differs


def test_the_row_taught_by_careful_differs_in_who_teaches_it() -> None:
    assert difference("table-lndrl", "table-careful") == {"ppo.teacher": "careful"}
    table, careful = load_config("table-lndrl"), load_config("table-careful")
    assert table.ppo.teacher == "predictive" and table.imitation.settings == {}
    assert careful.imitation.settings == load_config("lndrl").imitation.settings != {}


def test_the_table_s_own_trains_in_the_world_of_lndrl_with_its_networks() -> None:
    table, ours = load_config("table-lndrl"), load_config("lndrl")
    for part in ("scenario", "world", "localization", "randomize", "network", "actor"):
        assert getattr(table, part) == getattr(ours, part)
    priced = ours.task.reward.model_copy(update={"pose_limit": 200.0, "collide": -2400.0})
    assert table.task == ours.task.model_copy(update={"reward": priced})


@pytest.mark.parametrize("name", ["drl_laser", "drl_laser_ped"])
def test_who_trusts_its_localization_may_in_training(name: str) -> None:
    may = {"localization.kind": "perfect", "localization.late_truth": True}
    assert difference(name, f"{name}-trusting") == may
    assert load_config(f"{name}-trusting").localization.heard_delay == 2


def test_alone_means_the_same_for_all_rows_that_are() -> None:
    """Of a teacher that there is not nothing matters."""
    for row in ("no_variance", "no_reward", "drl_laser_ped"):
        assert difference(row, f"{row}-alone") == {"ppo.teacher": None}
    assert difference("table-lndrl", "table-alone") == {"ppo.teacher": None}
    alone = {"ppo.teacher": None, "ppo.actor_learning_rate": 3e-4}
    assert difference("lndrl", "reward_alone") == alone


def difference(name: str, other: str) -> dict[str, Any]:
    """What ``other`` says where both have a key and differ; a teacher's parameters aside."""
    ours, theirs = (flat(load_config(each).model_dump()) for each in (name, other))
    return {key: theirs[key] for key in ours if key in theirs and ours[key] != theirs[key]}


def flat(data: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in data.items():
        inner = isinstance(value, dict)
        found |= flat(value, f"{prefix}{key}.") if inner else {f"{prefix}{key}": value}
    return found
