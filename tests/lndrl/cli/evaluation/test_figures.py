"""``lndrl figures`` on the command line."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from lndrl.cli.main import run as lndrl
from lndrl.config import load_config
from lndrl.evaluation.benchmark import ResultsFolder
from lndrl.evaluation.runner import DEFAULT_CONFIG
from lndrl.policy import build_policy, policy_metadata, to_bytes

ROOM = """
name: room
size: [8.0, 6.0]
pedestrians:
  count: [1, 1]
  routes: [{start: [1, 4, 2, 5], goal: [6, 4, 7, 5]}]
robot: [{start: [1, 1, 2, 2], goal: [5, 1, 7, 3]}]
"""
BENCH = "scenarios: [room.yaml]\nmethods:\n  random: {planner: random}\n"
SMALL = ["task.map_cells=24", "network.features=8", "network.goal_features=4"]


@pytest.fixture(scope="module", autouse=True)
def room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The folder that all commands are called in."""
    folder = tmp_path_factory.mktemp("figures")
    (folder / "room.yaml").write_text(ROOM)
    (folder / "bench.yaml").write_text(BENCH)
    (folder / "two.yaml").write_text(BENCH.replace("random", "straight"))
    (folder / "many.yaml").write_text(BENCH.replace("room.yaml", "random"))
    (folder / "fresh").mkdir()
    config = load_config(DEFAULT_CONFIG, SMALL)
    blob = to_bytes(build_policy(config), policy_metadata(config, 0, 0))
    (folder / "fresh" / "policy.safetensors").write_bytes(blob)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield folder


MANY = ["--scenario", "random", "--spec", "many.yaml"]
HERE = ["--scenario", "room.yaml", "--spec", "bench.yaml"]


def test_trajectories_of_several_methods(room: Path, capsys: pytest.CaptureFixture[str]) -> None:
    methods = ["--methods", "random,straight,fresh", "--episode", "2"]
    assert lndrl(["figures", "trajectories", *methods, *HERE]) == 0
    printed = capsys.readouterr()
    assert printed.out.splitlines()[-2] == "trajectories-room-2.png"
    assert [line.split()[0] for line in printed.out.splitlines()[:3]] == [
        "random", "straight", "fresh",
    ]  # fmt: skip
    assert "3 of 3 episodes" in printed.err
    assert (room / "trajectories-room-2.png").stat().st_size > 5_000


def test_activations_of_a_run_folder(room: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert lndrl(["figures", "activations", "--method", "fresh", "--step", "1", *HERE]) == 0
    assert capsys.readouterr().out.splitlines()[-2] == "activations-fresh-room-0-1.png"
    assert (room / "activations-fresh-room-0-1.png").stat().st_size > 5_000


def test_the_worst_of_a_result_and_one_that_is_driven_otherwise(
    room: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fill = ["--spec", "bench.yaml", "--episodes", "3", "--workers", "0"]
    assert lndrl(["benchmark", *fill]) == 0
    command = ["figures", "worst", "--method", "random", "--count", "2"]
    capsys.readouterr()
    assert lndrl(command) == 0
    *told, file, following = capsys.readouterr().out.splitlines()
    assert following == "next: lndrl lost random  # why it gets lost"
    assert file == "results/benchmark/worst-random.png"
    assert (room / file).stat().st_size > 5_000
    assert len(told) == 2
    assert "recorded" not in told[0]
    # Somebody else's rows: the episode that is drawn is not the one that was recorded.
    rows = room / "results" / "benchmark" / "random-room.yaml.csv"
    first, second, *others = rows.read_text().splitlines()
    cells = second.split(",")
    cells[1:4] = ["lost", "7", "2.8"]
    rows.write_text("\n".join([first, ",".join(cells), *others, ""]))
    assert lndrl([*command, "--scenario", "room.yaml", "--out", "other.png"]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[0].startswith("room, episode 0: ")
    assert told[0].endswith("(recorded: lost after 2.8 s)")


def test_behaviour_of_two_in_the_same_episodes(
    room: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fill = ["--episodes", "9", "--workers", "0"]
    command = ["figures", "behaviour", "fresh", "straight", *fill]
    assert lndrl([*command, *HERE, "--json", "--out", "b.png"]) == 0
    printed = capsys.readouterr()
    assert "18 of 18 episodes" in printed.err and "drew b.png" in printed.err
    found = json.loads(printed.out)
    fresh, straight = found["methods"]
    assert (fresh["method"], straight["method"], straight["episodes"]) == ("fresh", "straight", 9)
    assert all(0 < each["turn"] < 0.4 and 0 < each["waiting"] < 1 for each in (fresh, straight))
    assert (room / "b.png").stat().st_size > 10_000
    # Each is the episode that the bench has.
    assert lndrl(["benchmark", "--spec", "two.yaml", "--name", "two", *fill]) == 0
    capsys.readouterr()
    rows = ResultsFolder(Path("results/two")).records("straight", "room.yaml")
    lost = sum(rows[k].outcome == "lost" for k in range(9))
    steps = sum(rows[k].steps for k in range(9))
    assert straight["hazard"] == pytest.approx(1000 * lost / steps)
    assert sum(rows[k].outcome == "arrived" for k in range(9)) / 9 == straight["arrived"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["behaviour", "dwa", "dwa"], "dwa and dwa are the same method; name two"),
        (["behaviour", "dwa", "carefull"], "did you mean careful"),
        (["behaviour", "dwa", "random", "--cell", "0.1"], "--cell 0.1: must be 0.25 to 5 metres"),
        (["behaviour", "dwa", "random", "--scenario", "hal"], "did you mean hall"),
        (["behaviour", "dwa", "random", "--out", "b.gif"], "--out b.gif: must end in .png"),
        (["behaviour", "dwa", "random", *MANY], "scenario random has many layouts and no map"),
        (["trajectories", "--methods", "dwaa"], "did you mean dwa"),
        (["trajectories", "--methods", ","], "no method is named"),
        (["trajectories", "--methods", "dwa", "--scenario", "hal"], "did you mean hall"),
        (["trajectories", "--methods", "dwa", "--episode", "-1"], "--episode -1: must be 0"),
        (["trajectories", "--methods", "dwa", "--out", "a.gif"], "--out a.gif: must end in .png"),
        (["trajectories", "--out", "away/a.png"], "folder away does not exist"),
        (["activations", "--method", "dwa"], "method dwa follows a rule"),
        (["activations", "--method", "fresh", "--step", "-2"], "--step -2: must be 0 or more"),
        (["activations", "--method", "fresh", "--step", "999", *HERE], "step 999: episode 0 ended"),
        (["worst", "--name", "nothing"], "holds no results"),
        (["worst", "--count", "0"], "--count 0: must be 1 to 50"),
        (["wurst"], "Did you mean 'worst'"),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert lndrl(["figures", *arguments]) == 2
    error = capsys.readouterr().err.strip().splitlines()
    assert sentence in error[-1]
    assert "Traceback" not in "\n".join(error)
