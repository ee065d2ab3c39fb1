"""Policies in ``evaluate`` and ``play``: which one, how sampled, behind a shield or not."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import torch

from lndrl.cli.main import run
from lndrl.config import RunConfig, load_scenario
from lndrl.policy import TEMPERATURE_KEY, build_policy, policy_metadata, to_bytes

ROOM = """
name: room
size: [6, 4]
pedestrians: {count: [1, 1], routes: [{start: [3, 1, 4, 3], goal: [3, 1, 4, 3]}]}
robot: [{start: [1, 1, 2, 3], goal: [4, 1, 5, 3]}]
"""
NETWORK = {"map_channels": (2, 2, 2), "features": 8, "goal_features": 4}
TASK = {"time_limit": 4.0}
FILTER = {"min_particles": 100, "max_particles": 100}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """``run``: a run whose best checkpoint is meant to be sampled at 0.25, its newest is not."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "room.yaml").write_text(ROOM)
    config = RunConfig.model_validate(
        {
            "scenario": load_scenario("room.yaml").model_dump(),
            "network": NETWORK,
            "task": TASK,
            "localization": FILTER,
        }
    )
    for seed, (name, said) in enumerate(
        {"best": {TEMPERATURE_KEY: "0.25"}, "step-000000200": {}}.items()
    ):
        torch.manual_seed(seed)
        place = tmp_path / "run/checkpoints" / name
        place.mkdir(parents=True)
        metadata = {**policy_metadata(config, 1, 100 + 100 * seed), **said}
        (place / "policy.safetensors").write_bytes(to_bytes(build_policy(config), metadata))
    return "run"


def evaluated(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[dict[str, Any], str]:
    assert run(["evaluate", *arguments, "--episodes", "2", "--workers", "0", "--json"]) == 0
    out, err = capsys.readouterr()
    return json.loads(out), err


def test_checkpoint_temperature_and_shield_go_together(folder: str, capsys) -> None:
    data, err = evaluated(
        capsys, folder, "--shield", "--temperature", "0.5", "--checkpoint", "best"
    )
    assert (data["planner"], data["temperature"]) == ("run+shield", 0.5)
    assert data["vetoes"] >= 0 and data["actions"] == "sampled"
    assert "run: best checkpoint, step 100, sampled at temperature 0.5\n" in err


def test_a_policy_is_sampled_as_its_file_says_unless_told_otherwise(folder: str, capsys) -> None:
    data, err = evaluated(capsys, folder)
    assert data["temperature"] == 0.25
    assert "run: best checkpoint, step 100, sampled at temperature 0.25\n" in err
    for more in (["--temperature", "1"], ["--checkpoint", "newest"]):
        data, err = evaluated(capsys, folder, *more)
        assert "temperature" not in data and "sampled at" not in err and "checkpoint" in err
    data, err = evaluated(capsys, folder, "--greedy")
    assert "temperature" not in data and data["actions"] == "greedy" and "sampled at" not in err


def test_rules_beside_a_policy_go_without(folder: str, capsys) -> None:
    data, _ = evaluated(
        capsys, folder, "dwa", "--scenario", "room.yaml", "--shield", "--temperature", "0.5",
        "--checkpoint", "newest",
    )  # fmt: skip
    policy, rule = data["results"]
    assert (policy["planner"], policy["temperature"]) == ("run+shield", 0.5)
    assert rule["planner"] == "dwa" and not {"temperature", "vetoes"} & set(rule)


def test_shipped_says_where_it_comes_from(folder: str, capsys) -> None:
    data, err = evaluated(
        capsys, "shipped", "--scenario", "room.yaml", "--shield", "--temperature", "0.5"
    )
    assert (data["planner"], data["temperature"]) == ("shipped+shield", 0.5)
    assert "shipped: the policy that comes with lndrl " in err
    assert "sampled at temperature 0.5\n" in err


def test_play_takes_the_same(folder: str, capsys) -> None:
    assert run(["play", folder, "--out", "a.png", "--shield", "--temperature", "0.5",
                "--checkpoint", "best"]) == 0  # fmt: skip
    out, err = capsys.readouterr()
    assert out.startswith("a.png: ")
    assert "run: best checkpoint, step 100, sampled at temperature 0.5\n" in err


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["shipped", "--checkpoint", "best"], "goes with a run folder, and shipped is none"),
        (["shipped", "--temperature", "0"], "temperature 0 must be from 0.01 to 100"),
        (["shipped", "--temperature", "0.5", "--greedy"], "--greedy does not sample"),
        (["dwa", "--shield"], "dwa: ranks no actions that a shield could choose among"),
        (["shipped", "--shield-set", "horizon=1"], "--shield-set goes with --shield"),
    ],
)
@pytest.mark.parametrize("command", [["evaluate"], ["play", "--out", "a.png"]])
def test_bad_input_is_one_sentence(
    command: list[str], arguments: list[str], sentence: str, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    (tmp_path / "shipped/checkpoints").mkdir(parents=True)  # another thing of that name
    assert run([*command, *arguments]) == 2
    out, err = capsys.readouterr()
    assert sentence in err and len(err.strip().splitlines()) == 1 and out == ""
