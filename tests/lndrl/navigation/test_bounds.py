"""No kernel of a control step writes outside of its arrays, however it is misused.

All arrays that a step may write to are moved between fences; what the state says is spoilt.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest

from lndrl.config import RunConfig
from lndrl.navigation.batch import NavigationBatch
from lndrl.navigation.navigation import Navigation, build_surroundings
from lndrl.navigation.observation import Observation, pedestrians_in_view, push_scan
from lndrl.navigation.step import drive_worlds, judge_worlds

_BYTE, _FENCE = 0xA5, 1 << 16
CONFIG = RunConfig.model_validate(
    {
        "scenario": {
            "name": "small",
            "size": [12.0, 8.0],
            "pedestrians": {
                "count": [3, 5],
                "routes": [{"start": [3, 5, 5, 7], "goal": [9, 5, 11, 7]}],
            },
            "robot": [{"start": [1, 1, 2, 2], "goal": [9, 1, 10, 2]}],
        },
        "localization": {"min_particles": 50, "max_particles": 100, "delay": 2},
        "task": {"time_limit": 2.0},
    }
)
SURROUNDINGS = build_surroundings(CONFIG)
WORLDS = 3


class Fences:
    """Moves arrays between bytes that nobody may change."""

    def __init__(self) -> None:
        self._memory: list[tuple[np.ndarray, int]] = []

    def around(self, thing: Any) -> Any:
        """``thing`` with its arrays, those of NamedTuples included, moved."""
        if isinstance(thing, np.ndarray):
            size = thing.nbytes
            memory = np.full(size + 2 * _FENCE, _BYTE, np.uint8)
            moved = memory[_FENCE : _FENCE + size].view(thing.dtype).reshape(thing.shape)
            moved[...] = thing
            self._memory.append((memory, size))
            return moved
        if isinstance(thing, tuple):
            parts = map(self.around, thing)
            return type(thing)(*parts) if hasattr(thing, "_fields") else tuple(parts)
        return thing

    def stand(self) -> bool:
        return all(
            (memory[:_FENCE] == _BYTE).all() and (memory[_FENCE + size :] == _BYTE).all()
            for memory, size in self._memory
        )


class Fenced(NamedTuple):
    batch: NavigationBatch
    worlds: list[Navigation]
    fences: Fences


@pytest.fixture
def fenced() -> Iterator[Fenced]:
    fences = Fences()
    shown = Observation.zeros_for(WORLDS, CONFIG)
    batch = NavigationBatch(*SURROUNDINGS, CONFIG, WORLDS, shown)
    world, shared = batch.world, batch.shared
    world.robots, world.people = fences.around(world.robots), fences.around(world.people)
    world.scratch = fences.around(world.scratch)
    batch.beliefs, batch.tracks = fences.around(batch.beliefs), fences.around(batch.tracks)
    batch.shared = shared._replace(
        scratch=fences.around(shared.scratch),
        bins=fences.around(shared.bins),
        ranges=fences.around(shared.ranges),
    )
    batch.show_in(Observation(**{k: fences.around(v) for k, v in vars(shown).items()}))
    worlds = [Navigation(*SURROUNDINGS, CONFIG, i, batch=batch, index=i) for i in range(WORLDS)]
    for each in worlds:
        each.reset(0)
    yield Fenced(batch, worlds, fences)
    assert fences.stand()


def go_on(fenced: Fenced, steps: int = 20) -> None:
    commands = np.full((WORLDS, 2), 0.3)
    for _ in range(steps):
        fenced.batch.drive(commands)
        fenced.batch.judge()
        assert fenced.fences.stand()


def test_the_fences_see_a_byte(fenced: Fenced) -> None:
    memory, size = fenced.fences._memory[0]
    memory[_FENCE + size] = 0
    assert not fenced.fences.stand()
    memory[_FENCE + size] = _BYTE


def test_driving_on_after_the_end(fenced: Fenced) -> None:
    limit = fenced.batch.task.steps_limit
    go_on(fenced, 40 * limit)
    assert (fenced.batch.tracks.steps == 40 * limit).all()
    for each in fenced.worlds:  # the last point that there is room for, in the world's own path
        assert (
            fenced.batch.tracks.path[each.index, -1].tolist() == each.world.pose_true[:2].tolist()
        )


@pytest.mark.parametrize("number", [10**9, -(10**9)])
@pytest.mark.parametrize(
    "name", ["steps", "people", "target", "route_length", "direction", "count", "current", "used"]
)
def test_numbers_of_the_state_that_say_nonsense(fenced: Fenced, name: str, number: int) -> None:
    batch = fenced.batch
    spoilt: dict[str, np.ndarray] = {
        "steps": batch.tracks.steps,
        "people": batch.world.people.count,
        "target": batch.world.people.target,
        "route_length": batch.world.people.route_length,
        "direction": batch.world.people.direction,
        "count": batch.beliefs.numbers[:, 0],
        "current": batch.beliefs.numbers[:, 1],
        "used": batch.shared.bins.used,
    }
    spoilt[name][...] = number
    go_on(fenced)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300])
@pytest.mark.parametrize("name", ["command", "robot", "people", "particles", "travelled"])
def test_places_that_are_none(fenced: Fenced, name: str, value: float) -> None:
    batch = fenced.batch
    if name == "command":
        for _ in range(5):
            batch.drive(np.full((WORLDS, 2), value))
            batch.judge()
    else:
        spoilt = {
            "robot": batch.world.robots.pose,
            "people": batch.world.people.position,
            "particles": batch.beliefs.particles,
            "travelled": batch.world.people.travelled,
        }[name]
        spoilt[...] = value
    go_on(fenced)


def test_worlds_that_are_not_there(fenced: Fenced) -> None:
    batch = fenced.batch
    for first, commands in ((0, np.zeros((4, 2))), (-1, np.zeros((1, 2))), (3, np.zeros((1, 2)))):
        with pytest.raises(ValueError, match="are not among 3"):
            batch.drive(commands, first)
        with pytest.raises(ValueError, match="are not among 3"):
            batch.judge(first, len(commands))
        drive_worlds(batch._packed, first, commands, 4)
        judge_worlds(batch._packed, first, len(commands), False)
    with pytest.raises(ValueError, match=r"commands must be \(n, 2\)"):
        batch.drive(np.zeros((3, 1)))
    with pytest.raises(ValueError, match="are not among 3"):
        batch.observe(3)


@pytest.mark.parametrize(
    "shown",
    [
        Observation.zeros(WORLDS, 24, 360),
        Observation.zeros(WORLDS, 3, 720),
        Observation.zeros(WORLDS - 1, 24, 720),
    ],
)
def test_observations_of_another_size_are_refused(shown: Observation) -> None:
    with pytest.raises(ValueError, match=r"observation\.\w+ must be"):
        NavigationBatch(*SURROUNDINGS, CONFIG, WORLDS, shown)


def test_small_kernels_of_the_observation() -> None:
    fences = Fences()
    out = fences.around(np.zeros(5, np.uint16))
    push_scan(np.ones(720, np.float32), 100.0, True, out)
    assert out.tolist() == [100] * 5
    nobody = fences.around(np.zeros((0, 4), np.float32))
    assert pedestrians_in_view(np.zeros(3), np.ones((2, 2)), np.ones((2, 2)), 6.0, nobody) == 0
    assert fences.stand()
