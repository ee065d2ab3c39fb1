"""The command ``lndrl lost``: what it prints, draws and refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PIL import Image
from typer.testing import CliRunner

from lndrl.cli.main import app, run

ROOM = """
name: NAME
size: [7, 5]
obstacles: [{box: [3, 0.1, 3.4, 2]}]
pedestrians: {count: [1, 1], routes: [{start: [1, 4, 2, 4.5], goal: [5, 4, 6, 4.5]}]}
robot: [{start: [1, 1, 2, 3], goal: [4, 1, 5, 3]}]
"""
BENCH = """
scenarios: [room.yaml]
set: [world.odometry_deviation=1.0, localization.min_particles=100, localization.max_particles=300,
      task.time_limit=20]
methods: {told: {planner: random, localization: perfect}}
"""
TRY = ["--bench", "slippery.yaml", "--episodes", "9", "--workers", "0"]
KEYS = {
    "planner", "world", "program_version", "seed", "episodes", "definitions", "hazard",
    "scenarios", "foretold", "kinds", "limits_passed", "before", "not_lost", "hazard_by", "losses",
}  # fmt: skip


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("room", "other"):
        (tmp_path / f"{name}.yaml").write_text(ROOM.replace("NAME", name))
    (tmp_path / "slippery.yaml").write_text(BENCH)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_json_alone_on_stdout(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["lost", "random", *TRY, "--json"]) == 0
    out, err = capsys.readouterr()
    data = json.loads(out)
    assert set(data) == KEYS
    assert data["planner"] == "random" and "slippery.yaml" in data["world"]
    (place,) = data["scenarios"]
    assert place["scenario"] == "room" and len(place["hash"]) == 12
    lost = place["outcomes"]["lost"]
    assert lost == data["hazard"]["lost"] == len(data["losses"]) > 1
    assert sum(share["count"] for share in data["kinds"].values()) == lost
    assert data["definitions"]["jump_distance"] == 1.0
    assert [step["step"] for step in data["before"]] == list(range(-10, 1))
    assert sum(cell["steps"] for cell in place["cells"]) == data["hazard"]["steps"]
    assert sum(cell["lost"] for cell in place["cells"]) == lost
    assert "9 of 9 episodes" in err


def test_tables_and_picture(here: Path) -> None:
    picture = here / "lost.png"
    result = CliRunner().invoke(
        app, ["lost", "random", *TRY, "--scenario", "room.yaml,other.yaml", "--out", str(picture)]
    )
    assert result.exit_code == 0, result.output
    for words in ("random on the world of slippery.yaml", "before the loss: medians over",
                  "2nd cluster", "turned in the last 12 steps", "people ahead", "other",
                  "of 18 episodes were lost", "limits passed (2 m, 0.79 rad)"):  # fmt: skip
        assert words in result.output, words
    with Image.open(picture) as image:
        assert image.width > 1000 and image.height > 500


def test_nobody_lost_is_said_and_drawn(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "firm.yaml").write_text(BENCH.replace("deviation=1.0", "deviation=0.0"))
    picture = here / "lost.png"
    given = ["lost", "straight", "--bench", "firm.yaml", "--episodes", "2", "--workers", "0"]
    assert run([*given, "--out", str(picture)]) == 0
    out = capsys.readouterr().out
    assert "none of 2 episodes was lost in" in out and "between 0 and" in out
    assert "before the loss" not in out
    assert picture.stat().st_size > 10_000


def test_the_own_world_of_a_rule_is_the_default_configuration(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["lost", "straight", "--own-world", "--scenario", "room.yaml", "--episodes", "1",
             "--workers", "0", "--json"]  # fmt: skip
    assert run(given) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["world"] == "the world of lndrl.yaml"
    assert data["definitions"]["delay"] == 2


def test_a_method_of_the_bench_is_the_one_that_the_bench_tests(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    timid = BENCH.replace("told: {", "dwa: {planner: dwa, settings: {horizon: 3.0}}, told: {")
    (here / "timid.yaml").write_text(timid)
    found = []
    for more in ([], ["--planner-set", "horizon=3.0"], ["--planner-set", "horizon=1.6"]):
        given = ["lost", "dwa", *TRY, "--json", *more]
        given[given.index("slippery.yaml")] = "timid.yaml"
        assert run(given) == 0
        found.append(json.loads(capsys.readouterr().out))
    assert found[0] == found[1] != found[2]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["lost", "runs/none"], "runs/none: no such run folder or weights file"),
        (["lost", "told", "--bench", "slippery.yaml"], "nobody gets lost who is told the truth"),
        (
            ["lost", "dwa", "--scenario", "hybird"],
            "lndrl: scenario 'hybird' is unknown; did you mean",
        ),
        (["lost", "dwa", "--scenario", ","], "--scenario: name one or more"),
        (["lost", "dwa", "--scenario", "hall,hall"], "two scenarios are called hall"),
        (["lost", "dwa", "--bench", "benchmrk"], "did you mean"),
        (["lost", "dwa", "--own-world", "--bench", "slippery.yaml"], "one world or the other"),
        (["lost", "dwa", "--out", "lost.pdf"], "must end in .png"),
        (["lost", "dwa", "--out", "/no/where.png"], "/no does not exist"),
        (["lost", "dwa", "--episodes", "0"], "--episodes"),
        (["lost", "dwa", "--workers", "-1"], "--workers"),
        (["lost", "random", "--planner-set", "speed=1"], "random: takes no settings"),
        (["lost", "lndrl", "--planner-set", "speed=1"], "lndrl: takes no settings"),
    ],
)
def test_bad_input_is_one_sentence(
    here: Path, arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(arguments) == 2
    out, err = capsys.readouterr()
    assert sentence in err and len(err.strip().splitlines()) == 1
    assert out == ""
