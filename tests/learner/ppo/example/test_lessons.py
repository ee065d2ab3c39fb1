"""The memory of an imitation: what is kept, what is overwritten, what is drawn."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from learner.ppo.batch import Batch, assemble
from learner.ppo.example.lessons import Lessons
from learner.ppo.example.mirror import mirrored_actions
from lndrl.errors import UserError
from tests.learner.helpers_learner import random_trajectory, small_config

CONFIG = small_config(ppo={"teacher": "predictive"}, imitation={"memory": 40, "mirror": False})


def labelled(first: int, count: int, taught: bool = True) -> Batch:
    """``count`` states, marked by x of the goal and by the first action's cost."""
    trajectory = random_trajectory(CONFIG, 0, steps=count, worlds=1)
    numbers = np.arange(first, first + count)
    trajectory.observation.goal[:, 0, 0] = numbers
    costs = np.zeros((count if taught else 0, 1, 28), np.float16)
    if taught:
        costs[:, 0, 0] = numbers
    return assemble([replace(trajectory, teacher=costs)])


def drawn(lessons: Lessons, count: int) -> list[int]:
    batch = lessons.draw(count, np.random.default_rng(1))
    assert batch.teacher is not None and batch.taught is not None
    numbers = batch.observation.goal[:, 0]
    np.testing.assert_array_equal(batch.teacher[:, 0], numbers)  # a state keeps its label
    assert len(batch) == count and batch.taught.all()
    return [int(number) for number in numbers]


def test_every_state_is_drawn_as_often_as_any_other() -> None:
    lessons = Lessons(CONFIG)
    lessons.add(labelled(0, 10))
    assert set(Counter(drawn(lessons, 30)).values()) == {3}
    assert set(Counter(drawn(lessons, 25)).values()) == {2, 3}


def test_the_newest_states_are_kept() -> None:
    lessons = Lessons(CONFIG)
    for first in range(0, 75, 15):
        lessons.add(labelled(first, 15))
    assert len(lessons) == 40
    assert sorted(drawn(lessons, 40)) == list(range(35, 75))
    lessons.add(labelled(100, 64))  # more than there is room for
    assert sorted(drawn(lessons, 40)) == list(range(124, 164))


def test_states_without_a_label_are_left_out() -> None:
    lessons = Lessons(CONFIG)
    lessons.add(labelled(0, 8, taught=False))
    assert len(lessons) == 0
    lessons.add(labelled(8, 8))
    assert sorted(drawn(lessons, 8)) == list(range(8, 16))


def test_the_memory_is_given_back() -> None:
    lessons = Lessons(CONFIG)
    lessons.add(labelled(0, 8))
    lessons.forget()
    assert len(lessons) == 0 and lessons._seen.scan.nbytes == 0


def test_every_other_state_is_mirrored() -> None:
    """With its label: what costs nothing to the left costs nothing to the right."""
    config = small_config(ppo={"teacher": "predictive"})
    images = mirrored_actions(config)
    assert images is not None
    lessons, batch = Lessons(config), labelled(1, 10)
    assert batch.teacher is not None
    lessons.add(batch)
    drawn = lessons.draw(20, np.random.default_rng(1))
    assert drawn.teacher is not None
    for i in range(20):
        number = int(drawn.observation.goal[i, 0])
        rows = drawn.teacher[i], batch.teacher[number - 1]
        np.testing.assert_array_equal(rows[0], rows[1][images] if i % 2 == 0 else rows[1])
    np.testing.assert_array_equal(lessons.draw(4, np.random.default_rng(1)).taught, 1.0)


@pytest.mark.parametrize("memory", [10**11, 2**53])
def test_a_memory_beyond_that_of_any_machine_is_refused_in_a_sentence(memory: int) -> None:
    config = small_config(ppo={"teacher": "predictive"}, imitation={"memory": memory})
    with pytest.raises(UserError, match=r"imitation\.memory .*; lower it"):
        Lessons(config)
