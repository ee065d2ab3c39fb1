"""The mirror image of a state, held against the map it draws and a planner that sees it."""

from __future__ import annotations

import numpy as np
import pytest

from learner.ppo.example.mirror import mirror, mirrored_actions
from lndrl.config import load_config
from lndrl.navigation import Observation, VectorNavigation, action_table
from lndrl.navigation.pedestrian_map import draw_pedestrian_map
from lndrl.planners import PredictivePlanner

CONFIG = load_config("lndrl")
BEAMS = CONFIG.world.laser.beams


@pytest.fixture(scope="module")
def seen() -> Observation:
    """States that random driving meets, people among them."""
    worlds = VectorNavigation(CONFIG, 0, 16)
    rng = np.random.default_rng(1)
    for _ in range(12):
        worlds.step(rng.integers(0, 28, 16))
    assert worlds.observation.pedestrian_count.sum() > 8
    return worlds.observation.copy()


def test_twice_mirrored_is_as_before(seen: Observation) -> None:
    before = seen.copy()
    twice = mirror(mirror(seen, BEAMS), BEAMS)
    for name, array in vars(before).items():
        np.testing.assert_array_equal(getattr(twice, name), array)
        np.testing.assert_array_equal(getattr(seen, name), array)  # the given one is left alone


def test_actions_turn_the_other_way() -> None:
    actions, images = action_table(CONFIG.task), mirrored_actions(CONFIG)
    assert images is not None
    np.testing.assert_array_equal(actions[images], actions * [1.0, -1.0])
    np.testing.assert_array_equal(images[images], np.arange(28))


def test_an_action_without_an_image() -> None:
    task = CONFIG.task.model_copy(update={"angular_velocities": [-0.3, 0.0, 0.6]})
    assert mirrored_actions(CONFIG.model_copy(update={"task": task})) is None


def test_the_map_is_drawn_the_other_way_round(seen: Observation) -> None:
    """Up to people on the border of a cell, which belongs to one side."""
    one, two = (
        draw_pedestrian_map(each.pedestrians, each.pedestrian_count, CONFIG.task)
        for each in (seen, mirror(seen, BEAMS))
    )
    flipped = one[..., ::-1] * np.array([1.0, 1.0, -1.0], np.float32)[:, None, None]
    assert (np.abs(flipped - two) > 1e-6).mean() < 1e-3
    assert one.any()


def test_every_scan_is_mirrored_by_itself() -> None:
    made = Observation.zeros(1, beams=8)
    made.scan[0] = [9, 1, 2, 3, 8, 4, 5, 6]
    assert mirror(made, 4).scan[0].tolist() == [9, 3, 2, 1, 8, 6, 5, 4]


def test_a_planner_does_the_same_the_other_way_round(seen: Observation) -> None:
    planner, images = PredictivePlanner(CONFIG), mirrored_actions(CONFIG)
    rows = np.arange(16)
    one, two = planner.costs(seen, rows), planner.costs(mirror(seen, BEAMS), rows)
    assert images is not None
    apart = np.abs(one[:, images] - two)
    # A wall may be touched by a hair on one side alone: echoes are thinned from one end.
    assert np.median(apart) < 1e-3
    assert (one[:, images].argmin(axis=1) == two.argmin(axis=1)).mean() > 0.85


def test_a_run_that_cannot_be_mirrored_says_so() -> None:
    turns = "task.angular_velocities=[-0.3, 0.0, 0.6]"
    lame = load_config("lndrl", ["ppo.teacher=predictive", turns])
    assert "imitation.mirror needs task.angular_velocities" in str(lame.teacher_misfit())
    for mend in ("imitation.mirror=false", "ppo.teacher=null"):
        assert (
            load_config("lndrl", [turns, "ppo.teacher=predictive", mend]).teacher_misfit() is None
        )
