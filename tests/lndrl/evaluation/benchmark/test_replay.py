"""Driving again gives what the bench recorded; the worst episodes and why they ended."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lndrl.config import load_config
from lndrl.errors import UserError
from lndrl.evaluation.benchmark import (
    Contender,
    Drive,
    Plan,
    Replay,
    ResultsFolder,
    check_scenario,
    contender_named,
    contender_tested,
    contenders_named,
    difference,
    load_benchmark,
    worst_episodes,
)
from lndrl.evaluation.benchmark.moments import moment_of
from lndrl.evaluation.episodes import EpisodeRunner
from lndrl.evaluation.runner import BLOCK, DEFAULT_CONFIG
from lndrl.navigation import EpisodeRecord, Navigation
from lndrl.navigation.families import Family, episode_of
from lndrl.navigation.reward import REWARD_PARTS
from lndrl.planners import planner_source
from lndrl.policy import policy_metadata, to_bytes
from lndrl.policy.networks import build_policy

ROOM = """
name: room
size: [8.0, 6.0]
pedestrians:
  count: [2, 2]
  routes: [{start: [1, 4, 2, 5], goal: [6, 4, 7, 5]}]
robot: [{start: [1, 1, 2, 2], goal: [5, 1, 7, 3]}]
"""
BENCH = """
scenarios: [room.yaml]
seed: 3
methods:
  random: {planner: random}
  dwa: {planner: dwa}
  lndrl: {planner: runs/nowhere}
"""
SMALL = ["task.map_cells=24", "network.features=8", "network.goal_features=4"]
HERE = "room.yaml"


def record(k: int, outcome: str, error: float = 0.1, time: float = 20.0) -> EpisodeRecord:
    parts = dict.fromkeys(REWARD_PARTS, 0.0)
    values = (50, time, 9.0, error, 0.02, 0.3, -1.0, parts)
    return EpisodeRecord(Family.BENCH.world(k), 0, outcome, *values)  # type: ignore[arg-type]


@pytest.fixture(scope="module", autouse=True)
def room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Where all here happens: a folder with a small place, a bench and untrained weights."""
    folder = tmp_path_factory.mktemp("bench")
    (folder / HERE).write_text(ROOM)
    (folder / "bench.yaml").write_text(BENCH)
    (folder / "fresh").mkdir()
    config = load_config(DEFAULT_CONFIG, SMALL)
    blob = to_bytes(build_policy(config), policy_metadata(config, 0, 0))
    (folder / "fresh" / "policy.safetensors").write_bytes(blob)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield folder


@pytest.fixture(scope="module")
def result(room: Path) -> ResultsFolder:
    """What the bench makes of eight episodes of the random planner."""
    folder = ResultsFolder(room / "results" / "benchmark")
    Plan(folder, [Contender("random", planner_source("random"), "amcl")], [HERE], 8, 3).run(0)
    return folder


@pytest.fixture(scope="module")
def drive(result: ResultsFolder) -> Drive:
    """Episode 5 of it, driven again."""
    (found,) = Replay(contender_named(load_benchmark(Path("bench.yaml")), "random"), HERE, 3).drive(
        [5]
    )
    return found


# -- driving again --------------------------------------------------------------------------


def test_driven_again_is_what_was_recorded(result: ResultsFolder, drive: Drive) -> None:
    recorded = result.records("random", HERE)[5]
    assert drive.record == recorded
    assert drive.episode == 5
    assert difference(recorded, drive) == ""
    # The record has means over the steps, without the start.
    assert len(drive.time) == recorded.steps + 1
    assert drive.time[-1] == recorded.time
    assert drive.position_error[1:].mean() == pytest.approx(recorded.position_error)
    assert drive.angle_error[1:].mean() == pytest.approx(recorded.angle_error)
    steps = np.diff(drive.pose_true[:, :2], axis=0)
    assert np.hypot(*steps.T).sum() == pytest.approx(recorded.distance, rel=0.05)
    assert drive.people.shape == (recorded.steps + 1, 2, 2)
    assert drive.end.outcome == recorded.outcome


def test_drives_come_in_the_order_they_were_asked_for(result: ResultsFolder) -> None:
    contender, identity = contender_tested(result, "random")
    seen: list[int] = []
    drives = Replay(contender, HERE, identity.seed).drive([4, 1], lambda d: seen.append(d.episode))
    assert [d.episode for d in drives] == seen == [4, 1]
    kept = result.records("random", HERE)
    assert [d.record for d in drives] == [kept[4], kept[1]]


def test_a_policy_is_driven_in_the_block_of_the_bench() -> None:
    replay = Replay(contender_named(load_benchmark(Path("bench.yaml")), "fresh"), HERE, 3)
    blocks: list[list[int]] = []
    run = replay._runner

    def spy(episodes: range, watch: Any) -> Iterator[EpisodeRecord]:
        blocks.append(list(episodes))
        return run(episodes, watch)

    replay._runner = spy  # type: ignore[assignment]
    looked: list[int] = []

    def watch(world: Navigation) -> None:
        looked.append(episode_of(world.world_id))

    again = replay.drive([6, 2], watch=watch)
    assert blocks == [list(range(BLOCK))]
    assert set(looked) == {2, 6}
    contender = replay.contender
    runner = EpisodeRunner(contender.source, replay.config, family=Family.BENCH)
    bench = {episode_of(r.world): r for r in runner(range(BLOCK))}
    assert [d.record for d in again] == [bench[6], bench[2]]


@pytest.mark.parametrize(
    ("outcome", "hit", "position", "angle", "words"),
    [
        ("lost", "", 2.13, 0.1, "lost: 2.1 m off after 14.4 s"),
        ("lost", "", 0.4, 0.9, "lost: 52° off after 14.4 s"),
        ("collided", "pedestrian", 0.4, 0.1, "collided with a person after 14.4 s"),
        ("collided", "wall", 0.4, 0.1, "collided with a wall after 14.4 s"),
        ("timeout", "", 0.4, 0.1, "out of time 5.0 m from the goal"),
        ("arrived", "", 0.4, 0.1, "arrived after 14.4 s, 0.25 m off on average"),
    ],
)
def test_reasons(
    drive: Drive, outcome: str, hit: Any, position: float, angle: float, words: str
) -> None:
    end = dataclasses.replace(drive.end, goal=np.array([4.0, 5.0]))
    made = dataclasses.replace(
        drive,
        record=record(0, outcome, 0.25, 14.4),
        hit=hit,
        pose_true=np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 0.0]]),
        judged_error=(position, angle),
        end=end,
    )
    assert made.reason == words


@pytest.mark.parametrize("moment", ["report", "present"])
def test_who_was_lost_is_so_by_what_was_judged(moment: str) -> None:
    """Not by how far off an old report is from where the robot has got to since."""
    contender = contender_named(load_benchmark(Path("bench.yaml")), "random")
    changes = [f"task.judged_moment={moment}", "localization.delay=1", "task.lost_angle=0.4",
               "task.lost_distance=0.3"]  # fmt: skip
    replay = Replay(contender, HERE, 3, changes)
    drives = replay.drive(range(24))
    ends = {drive.record.outcome for drive in drives}
    assert "lost" in ends and len(ends) > 1
    for drive in drives:
        metres, radians = drive.judged_error
        passed = metres > 0.3 or radians > 0.4
        assert passed == (drive.record.outcome == "lost") or drive.hit, drive.episode
    now = [(d.position_error[-1], d.angle_error[-1]) for d in drives]
    assert ([d.judged_error for d in drives] == now) == (moment == "present")


# -- who drives -----------------------------------------------------------------------------


def test_methods_are_names_of_the_bench_rules_folders_and_files() -> None:
    bench = load_benchmark(Path("bench.yaml"))
    names = ["dwa", "straight", "fresh"]
    assert [c.name for c in contenders_named(bench, names)] == names
    assert contender_named(bench, "fresh/policy.safetensors").name == "fresh"
    with pytest.raises(UserError, match="two methods are called fresh"):
        contenders_named(bench, ["fresh", "fresh/policy.safetensors"])
    with pytest.raises(UserError, match="did you mean dwa"):
        contender_named(bench, "dwaa")
    with pytest.raises(UserError, match="method lndrl: runs/nowhere"):
        contender_named(bench, "lndrl")


def test_a_result_of_other_weights_or_another_place_is_not_drawn(
    result: ResultsFolder, tmp_path: Path
) -> None:
    data = json.loads((result.path / "benchmark.json").read_text())
    other = ResultsFolder(tmp_path)

    def write(**changes: Any) -> None:
        (tmp_path / "benchmark.json").write_text(json.dumps(data | changes))

    write(methods={"mine": {"planner": "fresh", "identity": "0"}})
    with pytest.raises(UserError, match="method mine has changed"):
        contender_tested(other, "mine")
    with pytest.raises(UserError, match="method mine has changed"):
        contender_tested(other, "fresh")  # by its folder
    write(scenarios={HERE: "0"})
    contender, identity = contender_tested(other, "random")
    with pytest.raises(UserError, match=r"scenario room\.yaml has changed"):
        check_scenario(other, identity, contender, HERE)
    check_scenario(result, contender_tested(result, "random")[1], contender, HERE)


def test_a_rule_is_driven_again_as_it_was_set(tmp_path: Path) -> None:
    folder = ResultsFolder(tmp_path)
    calm = Contender("calm", planner_source("dwa", {"heading_weight": 0.1}), "amcl")
    Plan(folder, [calm], [HERE], 1, 3).left()
    contender, _ = contender_tested(folder, "calm")
    assert contender == calm


# -- the worst ------------------------------------------------------------------------------


def test_the_worst_are_lost_then_collided_then_stuck_then_far_off(tmp_path: Path) -> None:
    folder = ResultsFolder(tmp_path)
    folder.keep(
        "m",
        "a",
        [
            record(0, "arrived", 0.9),
            record(1, "timeout", 0.9),
            record(2, "collided", 0.2),
            record(3, "lost", 0.1),
            record(4, "collided", 0.3),
        ],
    )
    folder.keep("m", "b", [record(0, "lost", 0.5), record(1, "arrived", 0.9, 30.0)])
    found = worst_episodes(folder, "m", ["a", "b"], 10)
    assert [(row.scenario, row.episode) for row in found] == [
        ("b", 0), ("a", 3), ("a", 4), ("a", 2), ("a", 1), ("b", 1), ("a", 0),
    ]  # fmt: skip
    assert worst_episodes(folder, "m", ["a"], 2)[0].record.outcome == "lost"
    assert len(worst_episodes(folder, "m", ["a", "b"], 2)) == 2
    with pytest.raises(UserError, match="holds no episode of n on a"):
        worst_episodes(folder, "n", ["a"], 2)


def test_another_end_than_recorded_is_said(drive: Drive) -> None:
    other = dataclasses.replace(drive.record, outcome="arrived", time=9.6, steps=24)
    assert difference(other, drive) == "recorded: arrived after 9.6 s"


# -- the network at one moment --------------------------------------------------------------


def test_a_moment_has_the_scan_of_its_step() -> None:
    replay = Replay(contender_named(load_benchmark(Path("bench.yaml")), "fresh"), HERE, 3)
    moment = moment_of(replay, 1, 2)
    assert moment.snapshot.steps == moment.step == 2
    np.testing.assert_array_equal(moment.scans[-1], moment.snapshot.scan)
    np.testing.assert_array_equal(moment.snapshot.pose_true, moment.drive.pose_true[2])
    assert moment.layer.values.shape == (32, 239)
    last = len(moment.drive.time) - 1
    with pytest.raises(UserError, match=rf"step {last + 1}: episode 1 ended after {last} steps"):
        moment_of(replay, 1, last + 1)
