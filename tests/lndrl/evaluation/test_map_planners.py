"""Planners that know the map are shown the place and told the pose that the robot hears."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from lndrl.config import RunConfig, load_scenario
from lndrl.errors import UserError
from lndrl.evaluation import EpisodeRunner
from lndrl.navigation import Navigation
from lndrl.planners import MapPlanner, StraightPlanner, planner_source
from lndrl.world import Place


@pytest.fixture(scope="module")
def config() -> RunConfig:
    return RunConfig.model_validate(
        {
            "scenario": {
                "name": "room",
                "size": [9, 6],
                "pedestrians": {"count": [0, 0]},
                "robot": [{"start": [1, 1, 2, 5], "goal": [7, 1, 8, 5]}],
            },
            "task": {"time_limit": 8.0},
            "localization": {"min_particles": 100, "max_particles": 300, "delay": 1},
        }
    )


@dataclass
class Spy(StraightPlanner):
    """Goes straight, and keeps what it is told."""

    config: RunConfig
    places: list[Place] = field(default_factory=list)
    poses: list[dict[int, np.ndarray]] = field(default_factory=list)
    calls: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__(self.config)

    def build(self, config: RunConfig, greedy: bool = False) -> Spy:
        return self

    def reset(self, seed, worlds) -> None:
        self.calls.append("reset")

    def enter(self, places) -> None:
        self.calls.append("enter")
        self.places = list(places)

    def hear(self, poses, rows) -> None:
        self.calls.append("hear")
        self.poses.append(dict(zip(rows.tolist(), poses.copy(), strict=True)))

    def act(self, observation, rows):
        self.calls.append("act")
        assert sorted(self.poses[-1]) == rows.tolist()
        return super().act(observation, rows)


def test_it_is_told_before_every_act(config: RunConfig) -> None:
    spy = Spy(config)
    assert isinstance(spy, MapPlanner) and not isinstance(StraightPlanner(config), MapPlanner)
    estimates: dict[int, list[np.ndarray]] = {}
    truths: dict[int, list[np.ndarray]] = {}

    def watch(world: Navigation) -> None:
        estimates.setdefault(world.world_id, []).append(world.localization.pose_estimated.copy())
        truths.setdefault(world.world_id, []).append(world.world.pose_true.copy())

    records = list(EpisodeRunner(spy, config)(range(3), watch))  # type: ignore[arg-type]
    assert spy.calls[:2] == ["reset", "enter"]
    assert spy.calls[2:] == ["hear", "act"] * (len(spy.calls) // 2 - 1)
    assert [place.scenario.name for place in spy.places] == ["room"] * 3
    for row, world in enumerate(sorted(estimates)):
        heard = np.array([poses[row] for poses in spy.poses if row in poses])
        said = np.array(estimates[world])
        steps = next(record.steps for record in records if record.world == world)
        assert len(heard) == steps
        # One control step old, but for the start; and the filter's, not the truth.
        assert (heard[0] == said[0]).all() and (heard[1:] == said[: steps - 1]).all()
        assert (np.abs(heard[1:] - np.array(truths[world])[: steps - 1]) > 1e-9).all(axis=1).any()


def test_in_a_random_scenario_every_world_has_its_own_place() -> None:
    config = RunConfig.model_validate(
        {"scenario": load_scenario("random"), "task": {"time_limit": 1.0}}
    )
    spy = Spy(config)
    list(EpisodeRunner(spy, config)(range(2)))  # type: ignore[arg-type]
    first, second = spy.places
    assert first.grid.occupied.shape != second.grid.occupied.shape or bool(
        (first.grid.occupied != second.grid.occupied).any()
    )


TEXT = """
    import numpy as np

    class Knows:
        def __init__(self, config):
            pass
        def reset(self, seed, worlds):
            pass
        def enter(self, places):
            self.widths = [place.grid.size[0] for place in places]
        def hear(self, poses, rows):
            self.poses = {answer}
        def act(self, observation, rows):
            assert self.widths == [9.0, 9.0] and self.poses.shape == (len(rows), 3)
            return np.tile([0.6, 0.0], (len(rows), 1))
"""


def test_a_class_of_ones_own_is_told_as_well(
    config: RunConfig, own_module: Callable[..., Any]
) -> None:
    name = f"{own_module(TEXT.format(answer='poses'))}:Knows"
    assert len(list(EpisodeRunner(planner_source(name), config)(range(2)))) == 2
    name = f"{own_module(TEXT.format(answer='1 / 0'))}:Knows"
    with pytest.raises(UserError, match=r"Knows.*division by zero"):
        list(EpisodeRunner(planner_source(name), config)(range(2)))
