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


def test_the_table_s_own_differs_from_lndrl_in_who_teaches_it() -> None:
    taught = {"ppo.teacher": "predictive", "imitation.vary": 0.5}
    assert difference("lndrl", "table-lndrl") == taught
    ours, table = load_config("lndrl"), load_config("table-lndrl")
    assert ours.ppo.teacher == "careful" and ours.imitation.settings
    assert table.imitation.settings == {} and table.imitation.steps == ours.imitation.steps


def test_alone_means_the_same_for_both_rows_that_are() -> None:
    """Of a teacher that there is not nothing matters."""
    alone = {"ppo.teacher": None, "ppo.actor_learning_rate": 3e-4}
    assert difference("drl_laser_ped", "drl_laser_ped-alone") == alone
    assert difference("lndrl", "reward_alone") == alone
    one = difference("table-lndrl", "drl_laser_ped")
    both = difference("reward_alone", "drl_laser_ped-alone")
    assert {k: v for k, v in both.items() if not k.startswith("imitation.")} == one


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
