"""What the bench says of how its rows are trained."""

from __future__ import annotations

from pathlib import Path

import pytest

from lndrl.errors import UserError
from lndrl.evaluation.benchmark import load_benchmark


def test_a_methods_configuration_is_named_by_it_or_like_it_or_by_who_shares_its_run() -> None:
    bench = load_benchmark()
    files = {name: bench.config_of(name) for name in bench.methods}
    named = {name: file.stem for name, file in files.items() if file is not None}
    assert named == {
        **{name: name for name in ("drl_laser", "drl_laser_ped", "no_variance", "no_reward")},
        **{name: name for name in ("drl_laser_ped-alone", "paper")},
        **{name: name for name in ("no_variance-alone", "no_reward-alone")},
        **{name: name for name in ("drl_laser-trusting", "drl_laser_ped-trusting")},
        **{name: "table-lndrl" for name in ("lndrl", "lndrl+shield", "lndrl+guard", "oracle")},
        **{name: "table-lndrl" for name in ("lndrl-seed2", "lndrl-seed3")},
        "lndrl-alone": "table-alone",
        "lndrl-careful": "table-careful",
    }
    seeds = {name: bench.seed_of(name) for name in bench.methods}
    assert {name: seed for name, seed in seeds.items() if seed is not None} == {
        "lndrl-seed2": 2,
        "lndrl-seed3": 3,
    }


def test_no_run_of_the_bench_is_a_user_s_own() -> None:
    """``lndrl train lndrl --run lndrl`` is trained otherwise than the bench's row of that name."""
    bench = load_benchmark()
    for name, method in bench.methods.items():
        if bench.sharing(name) and method.planner != "shipped":
            assert method.planner.startswith("runs/table-"), name


@pytest.mark.parametrize(
    ("row", "sentence"),
    [
        ("{planner: dwa, config: lndrl}", "methods.one.config: dwa is a rule, nothing to train"),
        ("{planner: dwa, seed: 2}", "methods.one.seed: dwa is a rule, nothing to train"),
        ("{planner: runs/a, seed: -1}", "methods.one.seed = -1"),
        ("{planner: runs/a, config: 3}", "methods.one.config = 3"),
    ],
)
def test_how_a_row_is_trained_is_checked(tmp_path: Path, row: str, sentence: str) -> None:
    spec = tmp_path / "bench.yaml"
    spec.write_text(f"scenarios: [sparse]\nmethods:\n  one: {row}\n")
    with pytest.raises(UserError) as caught:
        load_benchmark(spec)
    assert sentence in str(caught.value)
