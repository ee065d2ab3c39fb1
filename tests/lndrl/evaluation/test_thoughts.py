"""What a planner thought of, beside what became of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lndrl.evaluation import EpisodeRunner, settings_for
from lndrl.evaluation.thoughts import with_thoughts
from lndrl.navigation import Navigation, WorldSnapshot
from lndrl.planners import planner_source

ROOM = """
name: room
size: [6, 4]
pedestrians: {count: [0, 0]}
robot: [{start: [1, 1, 2, 3], goal: [2.2, 1, 2.6, 3]}]
"""


@pytest.mark.parametrize("guarded", [False, True])
def test_a_policy_says_what_it_drew_from(tmp_path: Path, guarded: bool) -> None:
    from lndrl.planners import GuardConfig

    file = tmp_path / "room.yaml"
    file.write_text(ROOM)
    source = planner_source("shipped", guard=GuardConfig() if guarded else None)
    runner = EpisodeRunner(source, settings_for(source, str(file)))
    seen: list[WorldSnapshot] = []

    def watch(world: Navigation) -> None:
        seen.append(with_thoughts(world, runner.planner))

    (record,) = runner([0], watch)
    first, *later = seen
    assert first.action == -1 and len(first.probabilities) == 0
    assert len(later) == record.steps > 1
    for moment in later:
        assert moment.probabilities.sum() == pytest.approx(1.0, abs=1e-5)
        assert moment.actions[moment.action].tolist() == pytest.approx(moment.command.tolist())
        assert guarded or moment.probabilities[moment.action] > 1e-4
        share, x, y = moment.clusters[0]
        assert 0.3 < share <= 1.0
        assert [x, y] == pytest.approx(moment.pose_estimated[:2].tolist(), abs=1e-6)
    total = float(np.sum([moment.parts for moment in later]))
    assert total == pytest.approx(record.episode_return)
    assert seen[-1].outcome == record.outcome


def test_a_rule_has_no_probabilities(tmp_path: Path) -> None:
    file = tmp_path / "room.yaml"
    file.write_text(ROOM)
    source = planner_source("straight")
    runner = EpisodeRunner(source, settings_for(source, str(file)))
    seen: list[WorldSnapshot] = []
    list(runner([0], lambda world: seen.append(with_thoughts(world, runner.planner))))
    assert all(len(moment.probabilities) == 0 for moment in seen)
