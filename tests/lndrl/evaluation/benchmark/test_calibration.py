"""Variants of the bench against the paper's DWA row, and the one that was frozen."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from lndrl.cli.main import run as lndrl
from lndrl.config import find, load_config, load_scenario, shipped
from lndrl.config.shipped import ROBOT_POLICY
from lndrl.errors import UserError
from lndrl.evaluation.benchmark import (
    PAPER,
    Contender,
    bench_config,
    bench_hash,
    calibration_table,
    check_frozen,
    load_benchmark,
    load_calibration,
    targets,
)
from lndrl.evaluation.runner import DEFAULT_CONFIG
from lndrl.planners import planner_source

STRAIGHT = Contender("straight", planner_source("straight"), "amcl")
SPEC = """
scenarios: [sparse]
seed: 3
variants:
  as_is: {why: nothing changes}
  alone: {why: nobody walks, only: {sparse: ["scenario.pedestrians.count=[0, 0]"]}}
"""


def hashes() -> dict[str, str]:
    bench = load_benchmark()
    return {
        scenario: bench_hash(bench_config(STRAIGHT, scenario, 0, bench.changes_in(scenario)))
        for scenario in bench.scenarios
    }


def test_the_bench_is_the_one_that_was_frozen() -> None:
    """Red: a place, the world, the filter or a limit has changed, and old results with it.

    If only a key is new whose default changes nothing, freeze the new hashes. Otherwise raise the
    version in the scenario's file as well and test every method anew (docs/bench.md).
    """
    bench = load_benchmark()
    assert hashes() == bench.frozen
    assert all(load_scenario(name).version == 1 for name in bench.scenarios)


@pytest.mark.parametrize(
    "name", [name for name in shipped("configuration") if name != ROBOT_POLICY]
)  # whose velocities take time: benchmark-robot.yaml is its bench
def test_methods_are_trained_in_the_world_that_they_are_tested_in(name: str) -> None:
    """The bench names every reading by itself; whoever changes one changes these files as well.

    Who may trust its localization is told the truth in training: its filter alone differs.
    """
    bench = load_benchmark()
    for scenario in bench.scenarios:
        same = [f"scenario={scenario}"]
        same += ["localization.late_truth=false"] * name.endswith("-trusting")
        trained = load_config(find("configuration", name), same)
        assert bench_hash(trained) == bench.frozen[scenario], scenario


def test_another_bench_than_the_frozen_is_refused() -> None:
    bench = load_benchmark()
    check_frozen(bench, hashes())
    with pytest.raises(UserError, match="scenario hall is not the bench's: its hash is 0123"):
        check_frozen(bench, {**hashes(), "hall": "0123"})
    check_frozen(bench.model_copy(update={"frozen": {}}), {"hall": "0123"})


def test_a_change_reaches_the_bench_and_its_hash() -> None:
    plain = bench_config(STRAIGHT, "hybrid", 0)
    changed = bench_config(
        STRAIGHT, "hybrid", 0, ["scenario.pedestrians.orca=1", "localization.delay=3"]
    )
    assert changed.scenario.pedestrians.orca == 1.0
    assert changed.localization.delay == 3
    assert changed.scenario.robot == plain.scenario.robot
    assert bench_hash(changed) != bench_hash(plain)


def test_a_key_of_a_named_scenario_can_be_set() -> None:
    config = load_config(
        DEFAULT_CONFIG, ["scenario=hall", "scenario.pedestrians.count=[2, 3]", "seed=7"]
    )
    assert config.scenario.name == "hall"
    assert config.scenario.pedestrians.count == (2, 3)
    with pytest.raises(UserError, match="scenario 'hal' is unknown"):
        load_config(DEFAULT_CONFIG, ["scenario=hal", "scenario.pedestrians.count=[2, 3]"])


def test_targets_are_those_of_the_papers_row() -> None:
    bounds = {target.name: (target.least, target.most) for target in targets()}
    assert bounds["ar"] == pytest.approx((0.581, 0.681))
    assert bounds["lr"] == pytest.approx((0.0175, 0.07))
    assert bounds["distance"] == pytest.approx((10.071, 12.309))
    assert bounds["variance_sum"] == pytest.approx((0.3429, 0.7716), abs=1e-4)
    row = PAPER["dwa"]
    for target in targets():
        assert target.met(getattr(row, target.name))
        assert not target.met(target.most * 1.001)
        assert not target.met(None)
        assert not target.met(math.nan)


def test_the_repositorys_variants_can_be_built() -> None:
    spec = load_calibration()
    assert set(spec.scenarios) == set(load_benchmark().scenarios)
    assert spec.seed != load_benchmark().seed
    seen = set()
    for variant in spec.variants.values():
        for scenario in spec.scenarios:
            seen.add(bench_hash(bench_config(STRAIGHT, scenario, 0, variant.changes(scenario))))
    assert len(seen) > len(spec.variants)


def test_the_command_tries_variants_and_keeps_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("variants.yaml").write_text(SPEC)
    common = ["calibrate", "variants.yaml", "--episodes", "8", "--workers", "0"]
    assert lndrl([*common, "--json"]) == 0
    printed = capsys.readouterr()
    rows = json.loads(printed.out)
    assert [row["variant"] for row in rows] == ["as_is", "alone"]
    assert rows[1]["cr"] == 0.0  # there is nobody to collide with
    assert "16 episodes" in printed.err
    assert lndrl([*common, "--by-scenario", "--table"]) == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    assert shown.out.count("sparse") == 3
    assert lndrl(["calibrate", "variants.yaml", "--variants", "asis"]) == 2
    assert "did you mean as_is" in capsys.readouterr().err
    assert lndrl(["calibrate", "variants.yaml", "--table", "--name", "other"]) == 2
    assert "holds no finished episode" in capsys.readouterr().err


def test_figures_off_target_are_marked() -> None:
    table = calibration_table([], "nothing yet")
    assert table.row_count == 2
