"""``lndrl returns``: what it prints, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from lndrl.cli.main import run

ROOM = """
name: room
size: [6, 4]
pedestrians: {count: [0, 0]}
robot: [{start: [1, 1, 2, 3], goal: [4, 1, 5, 3]}]
"""
PARTS = {"approach", "pose", "arrive", "collide", "lost", "step"}
FEW = ["--scenario", "room.yaml", "--episodes", "2", "--workers", "0"]


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("room.yaml").write_text(ROOM)


def printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert run(["returns", *arguments, *FEW, "--json"]) == 0
    data: dict[str, Any] = json.loads(capsys.readouterr().out)
    return data


def test_json_has_everything(capsys: pytest.CaptureFixture[str]) -> None:
    data = printed(capsys, "straight", "random", "--discount", "1", "--discount", "0.9")
    assert set(data) == {
        "program_version", "scenario", "localization", "seed", "episodes", "reward", "discounts",
        "planners",
    }  # fmt: skip
    assert (data["scenario"], data["episodes"], data["discounts"]) == ("room", 2, [1.0, 0.9])
    assert (data["reward"]["of"], data["reward"]["reward_scale"]) == ("lndrl", 0.01)
    first, second = data["planners"]
    for planner in (first, second):
        assert set(planner) == {
            "planner", "actions", "config_hash", "arrival", "collision", "lost", "stuck", "steps",
            "limited_steps", "discounted", "episodes",
        }  # fmt: skip
        assert [each["episode"] for each in planner["episodes"]] == [0, 1]
        for k, row in enumerate(planner["discounted"]):
            assert set(row["parts"]) == PARTS
            assert sum(row["parts"].values()) == pytest.approx(row["return"]["mean"])
            mean = sum(each["returns"][k] for each in planner["episodes"]) / 2
            assert row["return"]["mean"] == pytest.approx(mean)
    assert first["planner"] == "straight" and first["arrival"]["rate"] == 1.0
    for one, other in zip(first["discounted"], second["discounted"], strict=True):
        assert set(one) == {"discount", "return", "parts"}
        assert other["difference"]["mean"] == pytest.approx(
            other["return"]["mean"] - one["return"]["mean"]
        )
        assert {"interval", "clear", "standard_error"} <= set(other["difference"])


def test_what_is_set_of_the_reward_is_paid(capsys: pytest.CaptureFixture[str]) -> None:
    plain = printed(capsys, "straight", "--discount", "1")
    data = printed(capsys, "straight", "--discount", "1", "--set", "task.reward.step=-50")
    assert data["reward"]["of"] == "lndrl task.reward.step=-50"
    (before,), (after,) = (each["planners"][0]["discounted"] for each in (plain, data))
    assert after["parts"]["step"] < 8.0 * before["parts"]["step"] < 0.0
    scaled = printed(capsys, "straight", "--discount", "1", "--config", "paper")
    assert scaled["reward"]["reward_scale"] == 1.0 and scaled["reward"]["reward_limit"] is None


def test_tables_have_a_row_per_planner_and_discount(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["returns", "straight", "random", *FEW]) == 0
    out, err = capsys.readouterr()
    said = " ".join(out.split())
    assert "Δ: above straight" in said and "reward of lndrl, × 0.01, limited to ±5" in said
    assert "straight on room" in err
    assert out.count("│ straight ") == 5 + 1 + 1 == out.count("│ random ")
    assert run(["returns", "straight", "random", *FEW, "--parts"]) == 0
    assert capsys.readouterr().out.count("│ straight ") == 5 + 1 + 5


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["straight", "--discount", "1.2"], "--discount 1.2: must be above 0 and at most 1"),
        (["straight", "--discount", "0"], "--discount 0: must be above 0"),
        (["straight", "--discount", "nan"], "--discount nan: must be above 0"),
        (["straight", "--episodes", "0"], "--episodes 0: must be 1 or more"),
        (["straight", "--seed", "-1"], "--seed -1: must be 0 or more"),
        (["straight", "--workers", "-1"], "--workers -1"),
        (["strait"], "strait: no such run folder or weights file"),
        (["straight", "--config", "lndlr"], "did you mean lndrl?"),
        (["straight", "--set", "task.reward.lots=1"], "task.reward.lots"),
        (["straight", "--scenario", "hybird"], "did you mean hybrid?"),
        (["straight", "--scenario", "hall", "--set", "scenario=hybrid"], "one or the other"),
        (["straight", "--temperature", "0.5"], "rules do not sample"),
        (["straight", "--planner-set", "speed=1"], "--planner-set goes with a planner of your own"),
        (["dwa", "--checkpoint", "best"], "goes with a run folder, and dwa is none"),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["returns", *arguments]) == 2
    out, err = capsys.readouterr()
    assert sentence in err and len(err.strip().splitlines()) == 1
    assert out == ""
