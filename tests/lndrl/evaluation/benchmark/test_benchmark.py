from __future__ import annotations

import dataclasses
import itertools
import json
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lndrl.cli.main import run as lndrl
from lndrl.config import load_config
from lndrl.errors import UserError
from lndrl.evaluation.benchmark import (
    ALIKE,
    PAPER,
    Contender,
    Identity,
    Plan,
    ResultsFolder,
    Row,
    bench_config,
    bench_hash,
    choose,
    contenders,
    load_benchmark,
    mcnemar,
    rows_of,
)
from lndrl.evaluation.episodes import EpisodeRunner
from lndrl.evaluation.runner import DEFAULT_CONFIG
from lndrl.navigation import EpisodeRecord
from lndrl.navigation.episode import OUTCOMES
from lndrl.navigation.families import Family, episode_of
from lndrl.navigation.reward import REWARD_PARTS
from lndrl.planners import PlannerSource, planner_source

SPEC = """
scenarios: [hybrid, sparse]
seed: 3
methods:
  straight: {planner: straight}
  random: {planner: random}
  lndrl: {planner: runs/nowhere}
"""


def record(episode: int, outcome: str = "arrived", time: float = 20.0) -> EpisodeRecord:
    return EpisodeRecord(
        world=Family.BENCH.world(episode),
        episode=0,
        outcome=outcome,  # type: ignore[arg-type]
        steps=50,
        time=time,
        distance=11.123456789,
        position_error=0.1,
        angle_error=0.02,
        variance_sum=0.3,
        episode_return=-1.5,
        reward_parts=dict.fromkeys(REWARD_PARTS, 0.1),
    )


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    path = tmp_path / "bench.yaml"
    path.write_text(SPEC)
    return path


def plan_of(folder: Path, episodes: int, methods: tuple[str, ...] = ("straight",)) -> Plan:
    found = [Contender(name, planner_source(name), "amcl") for name in methods]
    return Plan(ResultsFolder(folder), found, ["sparse"], episodes, seed=3)


# -- the bench itself -----------------------------------------------------------------------


def test_the_bench_of_the_repository_is_the_papers() -> None:
    bench = load_benchmark()
    assert len(bench.scenarios) == 5
    assert set(PAPER) < set(bench.methods)
    assert set(ALIKE) < set(bench.methods) and set(ALIKE.values()) < set(PAPER)
    for row in PAPER.values():
        assert row.ar + row.cr + row.lr + row.sr == pytest.approx(1.0, abs=0.0015)


def test_the_hash_names_the_bench_and_not_the_method() -> None:
    rule = Contender("dwa", planner_source("dwa"), "amcl")
    plain = bench_hash(bench_config(rule, "hybrid", 0))
    truth = Contender("dwa", planner_source("dwa"), "perfect")
    assert bench_hash(bench_config(truth, "hybrid", 5)) == plain
    assert bench_hash(bench_config(rule, "sparse", 0)) != plain
    trained = load_config(DEFAULT_CONFIG, ["ppo.gamma=0.5", "task.reward.pose=0"])
    policy = Contender("lndrl", PlannerSource("run", trained, b"weights"), "amcl")
    assert bench_hash(bench_config(policy, "hybrid", 0)) == plain


def test_a_policy_is_tested_in_the_worlds_of_the_bench_whatever_it_was_trained_in() -> None:
    trained = load_config(
        DEFAULT_CONFIG, ["world.robot_radius=0.05", "localization.max_particles=1000",
                         "task.lost_distance=9", "task.map_cells=24"]
    )  # fmt: skip
    policy = Contender("lndrl", PlannerSource("run", trained, b"weights"), "amcl")
    base, config = load_config(DEFAULT_CONFIG), bench_config(policy, "hall", 0)
    assert config.world == base.world
    assert config.localization == base.localization
    assert config.task.lost_distance == base.task.lost_distance
    assert config.task.map_cells == 24  # what it sees stays what it was trained to see


def test_unknown_names_are_met_with_near_ones(spec: Path) -> None:
    with pytest.raises(UserError, match=r"'stright' is unknown; did you mean straight"):
        contenders(load_benchmark(spec), ["stright"])
    with pytest.raises(UserError, match=r"scenario 'hybird' is unknown; did you mean hybrid"):
        choose(["hybrid", "sparse"], ["hybird"], "scenario")
    with pytest.raises(UserError, match="no method is named"):
        contenders(load_benchmark(spec), [])


def test_methods_without_weights_are_left_out_unless_they_are_named(spec: Path) -> None:
    found, missing = contenders(load_benchmark(spec))
    assert [c.name for c in found] == ["straight", "random"]
    assert missing == ["lndrl"]
    with pytest.raises(UserError, match="method lndrl: runs/nowhere"):
        contenders(load_benchmark(spec), ["lndrl"])


# -- the folder -----------------------------------------------------------------------------


@settings(max_examples=50, deadline=None)
@given(
    numbers=st.lists(
        st.tuples(
            st.integers(0, 10_000),
            st.sampled_from(OUTCOMES),
            st.floats(0, 1e6, allow_subnormal=True),
        ),
        unique_by=lambda item: item[0],
    )
)
def test_rows_are_read_back_as_they_were(
    tmp_path_factory: pytest.TempPathFactory, numbers: list[tuple[int, str, float]]
) -> None:
    folder = ResultsFolder(tmp_path_factory.mktemp("results"))
    records = {k: record(k, outcome, time) for k, outcome, time in numbers}
    folder.keep("m", "s", [])
    for each in records.values():
        folder.add("m", "s", each)
    assert folder.records("m", "s") == records


def test_a_row_that_was_cut_off_is_left_out_and_damage_is_named(tmp_path: Path) -> None:
    folder = ResultsFolder(tmp_path)
    folder.keep("m", "s", [record(0), record(1)])
    path = folder.file("m", "s")
    whole = path.read_text()
    path.write_text(whole[:-20])
    assert list(folder.records("m", "s")) == [0]
    path.write_text(whole.replace("arrived", "flown", 1))
    with pytest.raises(UserError, match=r"m-s\.csv: is damaged"):
        folder.records("m", "s")


def test_results_of_another_bench_seed_or_weights_are_refused(tmp_path: Path) -> None:
    folder = ResultsFolder(tmp_path / "a")
    first = Identity(1, "0", {"hybrid": "abc"}, {"lndrl": {"identity": "w1"}})
    folder.claim(first)
    folder.claim(Identity(1, "0", {"sparse": "def"}, {"dwa": {"identity": "dwa"}}))
    for other, text in (
        (dataclasses.replace(first, seed=2), "seed 1, not 2"),
        (dataclasses.replace(first, scenarios={"hybrid": "abd"}), "scenario hybrid has changed"),
        (dataclasses.replace(first, methods={"lndrl": {"identity": "w2"}}), "method lndrl has"),
    ):
        with pytest.raises(UserError, match=text):
            folder.claim(other)
    kept = Identity.read(folder.path / "benchmark.json")
    assert set(kept.scenarios) == {"hybrid", "sparse"}
    assert set(kept.methods) == {"lndrl", "dwa"}


# -- running --------------------------------------------------------------------------------


def test_an_interrupted_benchmark_ends_like_one_that_was_not(tmp_path: Path) -> None:
    whole, cut = plan_of(tmp_path / "whole", 12), plan_of(tmp_path / "cut", 12)
    whole.run(0)
    seen = itertools.count()

    class StoppedError(Exception):
        pass

    def stop(*_: object) -> None:
        if next(seen) == 10:
            raise StoppedError

    with pytest.raises(StoppedError):
        cut.run(0, stop)
    assert plan_of(tmp_path / "cut", 12).left() == 5  # 16 in blocks, of which 11 are written
    again: list[int] = []
    plan_of(tmp_path / "cut", 12).run(0, lambda _, record: again.append(episode_of(record.world)))
    assert len(again) == 5
    files = [p.name for p in sorted((tmp_path / "whole").iterdir())]
    assert files == ["benchmark.json", "straight-sparse.csv"]
    for name in files:
        assert (tmp_path / "cut" / name).read_text() == (tmp_path / "whole" / name).read_text()


def test_more_episodes_add_to_those_that_are_there(tmp_path: Path) -> None:
    plan_of(tmp_path, 3).run(0)
    before = ResultsFolder(tmp_path).records("straight", "sparse")
    assert plan_of(tmp_path, 8).left() == 0  # blocks are whole
    longer = plan_of(tmp_path, 9)
    assert longer.left() == 8
    longer.run(0)
    after = ResultsFolder(tmp_path).records("straight", "sparse")
    assert {k: after[k] for k in before} == before
    assert plan_of(tmp_path, 3).left() == 0
    (row,) = rows_of(ResultsFolder(tmp_path), episodes=3)
    assert len(row.records) == 3


def test_it_finds_the_same_with_any_number_of_workers(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, 16, ("straight", "random"))
    plan.run(2)
    cell = plan.cells[1]
    runner = EpisodeRunner(cell.contender.source, cell.config, family=Family.BENCH)
    found = ResultsFolder(tmp_path).records("random", "sparse")
    alone = [record for k in range(16) for record in runner([k])]
    assert [found[k] for k in sorted(found)] == alone


# -- figures --------------------------------------------------------------------------------


def row(method: str, outcomes: str) -> Row:
    names = {"a": "arrived", "c": "collided", "l": "lost", "t": "timeout"}
    return Row(method, ("s",), {("s", k): record(k, names[o]) for k, o in enumerate(outcomes)})


def test_mcnemar_is_the_sign_test_of_the_episodes_that_differ() -> None:
    pair = mcnemar(row("x", "aaaaaaccca"), row("y", "ccccccccaa"))
    assert (pair.only_first, pair.only_second) == (6, 1)
    # Two-sided exact: 2 * (C(7,0) + C(7,1)) / 2^7
    assert pair.p == pytest.approx(2 * (1 + 7) / 128)
    assert mcnemar(row("x", "ac"), row("y", "ac")).p == 1.0


def test_only_episodes_that_both_have_driven_are_compared() -> None:
    pair = mcnemar(row("x", "aaaa"), row("y", "cc"))
    assert (pair.only_first, pair.only_second) == (2, 0)


def test_rates_sum_to_one_and_means_are_of_the_episodes() -> None:
    data = row("x", "aaclt").to_dict()
    assert (data["ar"], data["cr"], data["lr"], data["sr"]) == (0.4, 0.2, 0.2, 0.2)
    assert data["episodes"] == 5
    assert data["reach_time"] == 20.0


# -- the command ----------------------------------------------------------------------------


def test_the_command_fills_a_folder_and_shows_it(
    tmp_path: Path, spec: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    common = ["benchmark", "--spec", str(spec), "--episodes", "2", "--workers", "0"]
    assert lndrl([*common, "--scenarios", "sparse", "--json"]) == 0
    printed = capsys.readouterr()
    rows = json.loads(printed.out)
    assert [r["method"] for r in rows] == ["straight", "random"]
    assert all(r["episodes"] == 2 for r in rows)
    assert "left out: lndrl" in printed.err
    summary = json.loads((tmp_path / "results/benchmark/summary.json").read_text())
    assert summary["results"] == rows
    assert summary["seed"] == 3
    assert lndrl(["benchmark", "--spec", str(spec), "--table"]) == 0
    assert "straight" in capsys.readouterr().out


def test_a_rule_that_refuses_the_world_is_told_before_anything_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = "methods: {straight: {planner: straight}, careful: {planner: careful}}\n"
    Path("rules.yaml").write_text(f"scenarios: [hall]\n{rows}")
    common = ["benchmark", "--spec", "rules.yaml", "--episodes", "1", "--workers", "0"]
    assert lndrl([*common, "--localization", "perfect"]) == 2
    assert "careful: localization perfect has no variances" in capsys.readouterr().err
    assert not Path("results").exists()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--episodes", "0"], "--episodes 0: must be 1 or more"),
        (["--methods", "dwaa"], "did you mean dwa"),
        (["--scenarios", "hal"], "did you mean hall"),
        (["--name", "nothing", "--table"], "holds no results"),
        (["--workers", "-1"], "--workers -1"),
        (["--spec", "odd.yaml"], "odd.yaml: only names hal, none of the scenarios hall"),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: list[str],
    sentence: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    only = "only: {hal: [localization.delay=1]}\nmethods: {dwa: {planner: dwa}}\n"
    Path("odd.yaml").write_text(f"scenarios: [hall]\n{only}")
    assert lndrl(["benchmark", *arguments]) == 2
    error = capsys.readouterr().err.strip()
    assert sentence in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "results").exists()
