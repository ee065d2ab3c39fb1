from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from lndrl.cli.main import run
from lndrl.config import RunConfig, load_scenario
from lndrl.errors import UserError
from lndrl.evaluation.benchmark import BenchmarkSpec
from lndrl.planners import planner_source
from lndrl.policy import build_policy, load_policy, policy_metadata, read_policy, to_bytes

ROOM = """
name: room
size: [6, 4]
pedestrians: {count: [0, 0]}
robot: [{start: [1, 1, 2, 3], goal: [2.2, 1, 2.6, 3]}]
"""
PAGE = """# Card
<!-- lndrl ship: weights -->
<!-- end -->
<!-- lndrl ship: results -->
<!-- end -->
<!-- lndrl ship: precision -->
<!-- end -->
"""


@pytest.fixture
def policy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A policy of a small network, and a bench of two small rooms to test it in."""
    places = []
    for name in ("one", "two"):
        file = tmp_path / f"{name}.yaml"
        file.write_text(ROOM.replace("room", name))
        places.append(str(file))
    settings = ["task.time_limit=4.0", "localization.max_particles=200",
                "localization.min_particles=100"]  # fmt: skip
    methods = {"dwa": {"planner": "dwa"}}
    spec = BenchmarkSpec.model_validate({"scenarios": places, "set": settings, "methods": methods})
    monkeypatch.setattr("lndrl.evaluation.benchmark.load_benchmark", lambda: spec)
    network = {"map_channels": (2, 2, 2), "features": 8, "goal_features": 4}
    scenario = load_scenario(places[0])
    config = RunConfig.model_validate({"scenario": scenario.model_dump(), "network": network})
    torch.manual_seed(0)
    weights = tmp_path / "mine.safetensors"
    weights.write_bytes(to_bytes(build_policy(config), policy_metadata(config, 3, 4096)))
    (tmp_path / "model-card.md").write_text(PAGE)
    return str(weights)


def ship(policy: str, out: Path, *more: str) -> int:
    return run(["ship", "weights", policy, "--out", str(out), "--docs", str(out.parent),
                "--observations", "20", "--episodes", "3", "--workers", "0", *more])  # fmt: skip


def test_weights_are_written_in_half_precision_with_their_card(
    policy: str, tmp_path: Path, capsys
) -> None:
    out = tmp_path / "half.safetensors"
    assert ship(policy, out) == 0
    said = capsys.readouterr().out
    assert "20 observations: log-probabilities differ by 0.0" in said and "6 episodes:" in said
    assert out.stat().st_size < 0.8 * Path(policy).stat().st_size
    assert load_policy(out)[0] == load_policy(policy)[0]
    data = json.loads((tmp_path / "model-card.json").read_text())
    assert data["trained"]["steps"] == 4096 and data["half_precision"]["observations"] == 20
    assert "one, 4,096 control steps, 3 updates" in (tmp_path / "model-card.md").read_text()


def test_what_it_is_meant_to_be_sampled_at_is_in_the_file_and_on_the_card(
    policy: str, tmp_path: Path, capsys
) -> None:
    out = tmp_path / "half.safetensors"
    assert ship(policy, out, "--temperature", "0.5") == 0
    assert f"{policy}: sampled at temperature 0.5" in capsys.readouterr().err
    assert read_policy(out).temperature == 0.5
    assert json.loads((tmp_path / "model-card.json").read_text())["weights"]["temperature"] == 0.5
    assert "| sampled at temperature | 0.5 |" in (tmp_path / "model-card.md").read_text()
    # Shipped again it keeps it, unless told otherwise.
    again = tmp_path / "again.safetensors"
    assert ship(str(out), again) == 0 and read_policy(again).temperature == 0.5
    assert ship(str(out), again, "--temperature", "1") == 0
    assert read_policy(again).temperature == 1.0
    assert "| sampled at temperature | 1 |" in (tmp_path / "model-card.md").read_text()
    assert ship(policy, tmp_path / "x", "--temperature", "0") == 2
    assert "temperature 0 must be from 0.01 to 100" in capsys.readouterr().err


def test_the_policy_for_robots_has_a_card_of_its_own(
    policy: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    out = tmp_path / "robot.safetensors"
    monkeypatch.setattr("lndrl.policy.weights.ROBOT_FILE", out)
    with pytest.raises(UserError, match="shipped-robot: this build comes without it; train it by"):
        read_policy("shipped-robot")
    (tmp_path / "model-card-robot.md").write_text(PAGE)
    assert ship(policy, out, "--as", "shipped-robot", "--temperature", "0.3") == 0
    assert "next: lndrl benchmark --spec benchmark-robot" in capsys.readouterr().out
    assert "| sampled at temperature | 0.3 |" in (tmp_path / "model-card-robot.md").read_text()
    assert not (tmp_path / "model-card.json").exists() and not (tmp_path / "walk.npz").exists()
    found = read_policy("shipped-robot")
    assert found.temperature == 0.3 and found.origin.startswith("the policy that comes with lndrl")
    assert planner_source("shipped-robot").label == "shipped-robot"
    assert run(["ship", "card", "--docs", str(tmp_path)]) == 0


def test_nothing_is_written_where_decisions_change(
    policy: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.setattr("lndrl.evaluation.shipping.agreement.MOST_CHANGED", -1.0)
    out = tmp_path / "half.safetensors"
    assert ship(policy, out) == 1
    assert "nothing was written: 0.00 % of greedy decisions are others" in capsys.readouterr().err
    assert not out.exists() and not (tmp_path / "model-card.json").exists()


def test_results_are_measured_once_and_kept(
    policy: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    out = tmp_path / "half.safetensors"
    for where in ("lndrl.policy.weights.SHIPPED_FILE", "lndrl.policy.shipped.SHIPPED_FILE"):
        monkeypatch.setattr(where, out)
    assert ship(policy, out) == 0
    arguments = ["ship", "results", "--docs", str(tmp_path), "--episodes", "3", "--workers", "0"]
    assert run(arguments) == 0
    rows = json.loads((tmp_path / "model-card.json").read_text())["results"]
    assert [(row["scenario"], row["shield"]) for row in rows] == [
        ("one", False), ("two", False), ("one", True), ("two", True)
    ]  # fmt: skip
    page = (tmp_path / "model-card.md").read_text()
    assert "| one | no |" in page and "| **all** | yes |" in page

    def again(*arguments: object, **named: object) -> None:
        raise AssertionError("measured again")

    monkeypatch.setattr("lndrl.evaluation.evaluate", again)
    assert run(arguments) == 0
    assert (tmp_path / "model-card.md").read_text() == page
    # Other weights in the package: nothing of the card is theirs.
    out.write_bytes(out.read_bytes()[:-1] + b"\0")
    capsys.readouterr()
    assert run(arguments) == 2
    assert "model-card.json is of other weights" in capsys.readouterr().err


def test_what_has_no_weights_cannot_be_shipped(policy: str, tmp_path: Path, capsys) -> None:
    assert ship("dwa", tmp_path / "x") == 2
    assert "dwa: has no weights to ship" in capsys.readouterr().err


def test_the_card_is_written_anew_from_its_data(policy: str, tmp_path: Path) -> None:
    assert ship(policy, tmp_path / "half.safetensors") == 0
    written = (tmp_path / "model-card.md").read_text()
    (tmp_path / "model-card.md").write_text(PAGE)
    assert run(["ship", "card", "--docs", str(tmp_path)]) == 0
    assert (tmp_path / "model-card.md").read_text() == written
