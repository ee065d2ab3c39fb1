"""A run that goes on repeats nothing that was written, and ends like one that ran through."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from lndrl.config import load_config
from lndrl.evaluation import BLOCK
from lndrl.evaluation.benchmark import Contender, Plan, ResultsFolder
from lndrl.evaluation.runner import DEFAULT_CONFIG
from lndrl.navigation import EpisodeRecord
from lndrl.navigation.families import episode_of
from lndrl.planners import PlannerSource, planner_source
from lndrl.policy import initial_weights

ROOM = """
name: room
size: [6, 4]
pedestrians: {count: [1, 1], routes: [{start: [3, 1, 4, 1.5], goal: [3, 2.5, 4, 3]}]}
robot: [{start: [1, 1, 1.5, 3], goal: [4.5, 1, 5, 3]}]
"""
SMALL = ["network.map_channels=[2,2,2]", "network.features=8", "network.goal_features=4"]
CHANGES = {"room.yaml": ["task.time_limit=4"]}
EPISODES = 2 * BLOCK + 1


class StoppedError(Exception):
    pass


@pytest.fixture(scope="module", autouse=True)
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("bench")
    (folder / "room.yaml").write_text(ROOM)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield folder


@pytest.fixture(scope="module")
def contenders() -> dict[str, Contender]:
    config = load_config(DEFAULT_CONFIG, [*SMALL, "scenario=room.yaml"])
    policy = PlannerSource("small", config, initial_weights(config))
    found = {"rule": planner_source("random"), "policy": policy}
    return {name: Contender(name, source, "amcl") for name, source in found.items()}


def plan_of(contender: Contender, folder: Path) -> Plan:
    return Plan(ResultsFolder(folder), [contender], ["room.yaml"], EPISODES, 3, CHANGES)


def run(plan: Plan, stop_after: int | None = None) -> list[int]:
    """Runs until so many episodes have been told; returns which those were."""
    told: list[int] = []

    def note(_: object, record: EpisodeRecord) -> None:
        told.append(episode_of(record.world))
        if len(told) == stop_after:
            raise StoppedError

    try:
        plan.run(0, note)
    except StoppedError:
        assert len(told) == stop_after
    return told


def kept(plan: Plan) -> set[int]:
    return set(plan.folder.records(plan.cells[0].contender.name, "room.yaml"))


def content(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


@pytest.mark.parametrize("name", ["rule", "policy"])
def test_what_was_written_is_never_run_again(
    name: str, contenders: dict[str, Contender], tmp_path: Path
) -> None:
    whole, cut = (plan_of(contenders[name], tmp_path / folder) for folder in ("whole", "cut"))
    assert sorted(run(whole)) == list(range(3 * BLOCK))
    for stop_after in (3, BLOCK + 1, None):
        before = kept(cut)
        told = run(cut, stop_after)
        assert not before & set(told) and len(told) == len(set(told))
        assert before | set(told) <= kept(cut)
    assert kept(cut) == set(range(3 * BLOCK))
    assert cut.left() == 0 and run(cut) == []
    assert content(tmp_path / "cut") == content(tmp_path / "whole")


def test_a_policys_block_is_written_at_once(
    contenders: dict[str, Contender], tmp_path: Path
) -> None:
    plan = plan_of(contenders["policy"], tmp_path)
    run(plan, 1)
    assert kept(plan) == set(range(BLOCK))
    assert plan.left() == 2 * BLOCK


def test_of_a_rule_the_missing_alone_are_run(
    contenders: dict[str, Contender], tmp_path: Path
) -> None:
    plan = plan_of(contenders["rule"], tmp_path)
    run(plan)
    whole = content(tmp_path)
    records = plan.folder.records("rule", "room.yaml")
    lacking = {1, 2, 5, 11, 12, 13, 14, 15, 16, 17}
    plan.folder.keep("rule", "room.yaml", [r for k, r in records.items() if k not in lacking])
    assert [len(task.episodes) for task in plan.missing()] == [BLOCK, 2]
    assert set(run(plan)) == lacking
    assert content(tmp_path) == whole


def test_a_policys_block_that_is_not_whole_is_run_anew(
    contenders: dict[str, Contender], tmp_path: Path
) -> None:
    plan = plan_of(contenders["policy"], tmp_path)
    run(plan)
    whole = content(tmp_path)
    file = plan.folder.file("policy", "room.yaml")
    lines = file.read_text().splitlines(keepends=True)
    file.write_text("".join(lines[: BLOCK + 3]) + lines[BLOCK + 3][:-9])  # as a write that was cut
    assert set(run(plan)) == set(range(BLOCK, 3 * BLOCK))
    assert content(tmp_path) == whole
