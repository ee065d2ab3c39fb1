"""How many actors a learner carries: what is sent, what is counted, and a small bench whole."""

from __future__ import annotations

import json
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
import pytest

from lndrl.bench.fleet.chunk import Template
from lndrl.bench.fleet.model import ChunkCost, fitted
from lndrl.bench.fleet.plan import Plan, plan_of
from lndrl.bench.fleet.row import SilentError, _process, measure, quantile, shares_of
from lndrl.bench.fleet.scene import fleet_config
from lndrl.bench.fleet.table import table, with_efficiency
from lndrl.bench.scene import with_settings
from lndrl.chaos.forged import forged_arrays
from lndrl.cli.main import run
from lndrl.errors import UserError
from lndrl.navigation import Trajectory
from lndrl.transport import ChunkHeader, Hello
from lndrl.transport.messages import decode

SMALL = [
    *("network.map_channels=[2,2,2]", "network.features=4", "network.goal_features=2"),
    *("ppo.batch_size=64", "ppo.minibatch_size=64", "learner.threads=1", "ppo.epochs=1"),
    *("actor.worlds=2", "actor.horizon=16", "scenario=sparse"),
    *("localization.min_particles=50", "localization.max_particles=100"),
]
HELLO = Hello("synthetic-0000", "life", "bench", 1, 2, "0.1")


def test_a_template_is_a_valid_chunk_under_any_number_and_version() -> None:
    config = fleet_config(SMALL)
    arrays = forged_arrays(config, np.random.default_rng(1), 2)
    template = Template("run", HELLO, arrays)
    for sequence, version in ((1, 0), (70_000, 12), (2**31 - 1, 2**31)):
        template.hold(version)
        header, found = decode(template.chunk(sequence), ChunkHeader)
        assert (header.sequence, header.run_id, header.worlds) == (sequence, "run", 2)
        trajectory = Trajectory.from_arrays(found, config)
        assert (trajectory.version == version).all()
        assert all((found[name] == arrays[name]).all() for name in arrays if name != "version")


def test_actors_are_shared_among_processes() -> None:
    assert shares_of(1, 4) == [(0, 1)]
    assert shares_of(10, 4) == [(0, 2), (2, 3), (5, 2), (7, 3)]
    assert sum(count for _, count in shares_of(1000, 4)) == 1000


def test_quantiles_are_of_what_was_seen() -> None:
    assert quantile([], 0.99) is None
    assert quantile([3.0], 0.5) == 3.0
    assert quantile([float(n) for n in range(1, 101)], 0.99) == 99.0
    assert quantile([float(n) for n in range(1, 101)], 0.5) == 50.0


def test_efficiency_is_that_of_an_actor_beside_the_smallest_row() -> None:
    rows: list[dict[str, Any]] = [
        {"actors": 8, "steps_per_second": 2280.0},
        {"actors": 1, "steps_per_second": 300.0},
    ]
    assert [row["efficiency"] for row in with_efficiency(rows)] == [0.95, 1.0]


def test_the_model_finds_the_costs_behind_two_full_doors_and_what_lies_between() -> None:
    true = ChunkCost(each=0.4e-3, step=1e-6)
    found = fitted(*((n, 1.0 / (true.each + true.step * n)) for n in (32, 1024)))
    assert found.each == pytest.approx(true.each) and found.step == pytest.approx(true.step)
    assert found.steps_per_second(1e9, 128) == pytest.approx(128 / 0.528e-3)
    assert found.steps_per_second(300.0, 128) == 300.0  # no more than is offered
    assert fitted((32, 100.0), (1024, 200.0)).step == 0.0  # a machine that got faster meanwhile
    assert plan_of("8").model and not plan_of("8", site=True).model
    assert not plan_of("8", link="100,0.01").model and not plan_of("8", "real").model


def test_a_span_holds_whole_periods_of_every_actor() -> None:
    plan = Plan((1,), seconds=10.0)
    assert plan.period(1024) == pytest.approx(1024 / 300)
    assert plan.span(1024) == pytest.approx(3 * 1024 / 300)
    assert Plan((1,), every=10.0, seconds=5.0).span(1024) == 20.0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--actors 1,no", "'no' is not a number of actors"),
        ("--actors 0", "'0' is not a number of actors from 1 to 2048"),
        ("--actors 1,", "'nothing' is not a number"),
        ("--update sometimes", "--update sometimes: must be drain or real"),
        ("--every 0", "--every 0: must be above 0"),
        ("--seconds -1", "--seconds -1: must be above 0"),
        ("--peers", "--peers does not go with fleet"),
    ],
)
def test_what_cannot_be_measured_is_said(
    words: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["bench", "fleet", *words.split()]) == 2
    assert said in capsys.readouterr().err


def say_nothing(channel: Connection) -> None:
    channel.poll(60.0)


def test_a_process_that_says_nothing_ends_the_bench_in_a_sentence() -> None:
    with _process("learner", say_nothing) as child:
        with pytest.raises(SilentError, match=r"the learner did not say ready within 0\.1 s; try"):
            child.wait_for("ready", 0.1)
        child.tell("stop")
    assert issubclass(SilentError, UserError), "which the command line shows as a sentence"


def test_fleet_options_go_with_fleet(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["bench", "laser", "--actors", "1"]) == 2
    assert "--actors goes with fleet, not with laser" in capsys.readouterr().err
    with pytest.raises(UserError, match="from 1 to 2048"):
        plan_of("4000")


def test_a_small_fleet_is_measured_and_loses_nothing() -> None:
    with with_settings(SMALL):
        rows = list(measure(Plan((2,), seconds=1.0)))
    for row in rows:
        assert row["lost"] == row["duplicated"] == row["unanswered"] == 0, row
        assert row["steps_per_second"] > 0 and row["ack_p50_ms"] <= row["ack_p99_ms"]
        assert row["weights_seconds"] is not None and row["learner_rss_mb"] > 50
        assert row["worlds"] == 2 and row["offered_steps_per_second"] == row["actors"] * 300
        assert row["predicted_steps_per_second"] is None
    assert json.loads(json.dumps(rows)) == rows
    assert table(rows, "drain").row_count == 1
