"""Every command runs episodes of its own family, and only ``benchmark`` those of the bench."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from lndrl.cli.main import run
from lndrl.evaluation.benchmark import (
    Contender,
    Plan,
    Replay,
    ResultsFolder,
    bench_config,
    load_benchmark,
)
from lndrl.evaluation.episodes import EpisodeRunner
from lndrl.navigation.families import Family
from lndrl.planners import planner_source

ROOM = """
name: room
size: [6, 4]
pedestrians: {count: [0, 0]}
robot: [{start: [1, 1, 2, 3], goal: [4, 1, 5, 3]}]
"""
BENCH = """
scenarios: [room.yaml]
set: [task.time_limit=1.6, localization.delay=1]
methods: {straight: {planner: straight}}
"""
VARIANTS = "scenarios: [room.yaml]\nvariants: {plain: {why: it is}}\n"
EPISODES = ["--episodes", "2", "--workers", "0"]
EVALUATE = ["evaluate", "straight", *EPISODES, "--json"]


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name, text in (("room", ROOM), ("bench", BENCH), ("variants", VARIANTS)):
        Path(f"{name}.yaml").write_text(text)
    return tmp_path


def printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert run(list(arguments)) == 0
    data: dict[str, Any] = json.loads(capsys.readouterr().out)
    return data


def worlds(folder: ResultsFolder, method: str) -> list[int]:
    return [record.world for record in folder.records(method, "room.yaml").values()]


def test_evaluate_runs_validation_in_the_benchs_world_too(
    capsys: pytest.CaptureFixture[str],
) -> None:
    plain = printed(capsys, *EVALUATE, "--scenario", "room.yaml")
    bench = printed(capsys, *EVALUATE, "--bench", "--spec", "bench.yaml")
    wanted = [Family.VALIDATION.world(k) for k in range(2)]
    for data in (plain, bench):
        assert [record["world"] for record in data["records"]] == wanted
    # What makes the bench's world another: its limits, filter and delay.
    straight = Contender("straight", planner_source("straight"), "amcl")
    config = bench_config(straight, "room.yaml", 0, load_benchmark(Path("bench.yaml")).set)
    assert bench["config_hash"] == config.content_hash() != plain["config_hash"]
    runner = EpisodeRunner(straight.source, config)
    assert bench["records"] == [record.to_dict() for record in runner([0, 1])]
    assert max(record["time"] for record in bench["records"]) <= 1.6 + 1e-9
    assert min(record["time"] for record in plain["records"]) > 1.6
    truth = printed(
        capsys, *EVALUATE, "--bench", "--spec", "bench.yaml", "--localization", "perfect"
    )
    assert truth["localization"] == "perfect" and truth["scenario"] == "room"
    hall = printed(capsys, *EVALUATE, "--bench", "--spec", "bench.yaml", "--scenario", "hall")
    assert hall["scenario"] == "hall"
    assert max(record["time"] for record in hall["records"]) <= 1.6 + 1e-9


def test_the_bench_and_its_pictures_run_the_benchs(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["benchmark", "--spec", "bench.yaml", *EPISODES]) == 0
    folder = ResultsFolder(Path("results/benchmark"))
    kept = folder.records("straight", "room.yaml")
    assert worlds(folder, "straight") == [Family.BENCH.world(k) for k in range(8)]
    data = json.loads(Path("results/benchmark/benchmark.json").read_text())
    assert data["family"] == "bench"
    straight = Contender("straight", planner_source("straight"), "amcl")
    replay = Replay(straight, "room.yaml", 0, load_benchmark(Path("bench.yaml")).set)
    assert [drive.record for drive in replay.drive([0, 3])] == [kept[0], kept[3]]
    capsys.readouterr()


def test_calibration_has_episodes_of_its_own_and_draws_them_again(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(["calibrate", "variants.yaml", *EPISODES]) == 0
    folder = ResultsFolder(Path("results/calibration/plain"))
    assert worlds(folder, "dwa") == [Family.CALIBRATION.world(k) for k in range(8)]
    capsys.readouterr()
    arguments = ["--name", "calibration/plain", "--method", "dwa", "--count", "1"]
    assert run(["figures", "worst", *arguments, "--out", "worst.png"]) == 0
    # The episode as it was recorded: it would say so if it had ended otherwise.
    assert "recorded" not in capsys.readouterr().out


def test_a_folder_of_the_benchs_episodes_takes_no_others() -> None:
    straight = Contender("straight", planner_source("straight"), "amcl")
    folder = ResultsFolder(Path("results/old"))
    Plan(folder, [straight], ["room.yaml"], 1, 0).left()
    other = Plan(folder, [straight], ["room.yaml"], 1, 0, family=Family.CALIBRATION)
    with pytest.raises(Exception, match="episodes of bench, not of calibration"):
        other.left()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--spec", "bench.yaml"], "--spec bench.yaml names a bench; it goes with --bench"),
        (["--bench", "--spec", "no.yaml"], "no.yaml: no such file"),
        (["--bench", "--scenario", "hybird"], "scenario 'hybird' is unknown; did you mean hybrid?"),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*EVALUATE, *arguments]) == 2
    out, err = capsys.readouterr()
    assert sentence in err and len(err.strip().splitlines()) == 1
    assert out == ""
