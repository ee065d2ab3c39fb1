"""Second tries: where they begin, what they share with the failed episode; tests have none."""

from __future__ import annotations

import pickle
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pytest

from lndrl.config import RetryConfig, RunConfig, load_config, parse_config
from lndrl.errors import UserError
from lndrl.models import effective
from lndrl.navigation import StepResult, VectorNavigation
from lndrl.navigation.terms import as_tested

SCENARIO = {
    "name": "small",
    "size": [6.0, 6.0],
    "pedestrians": {
        "count": [2, 2],
        "routes": [{"start": [1, 3, 2, 5], "goal": [4, 3, 5, 5]}],
    },
    "robot": [{"start": [1, 1, 2, 2], "goal": [4, 4, 5, 5]}],
}
TRIES, BACK, PAST = 3, (3, 8), 4


def made_config(**retry: Any) -> RunConfig:
    data = {
        "scenario": SCENARIO,
        "seed": 5,
        "localization": {"min_particles": 60, "max_particles": 100},
        "retry": retry,
    }
    return parse_config(data, "test")


def made(worlds: int = 4, first: int = 0) -> VectorNavigation:
    retry = {"most": TRIES, "back": BACK, "past": PAST, "every": 2}
    return VectorNavigation(made_config(**retry), first, worlds, privileged=True)


class Step(NamedTuple):
    """A control step of world 0."""

    before: int  # steps of the episode when it began
    tried: bool
    start: np.ndarray  # pose in which its episode began
    pose_before: np.ndarray
    pose: np.ndarray  # after it, or in which the next episode begins
    ended: bool
    failed: bool
    result: StepResult


def driven(vector: VectorNavigation, steps: int) -> list[Step]:
    """Straight on with a swing: into walls and people."""
    seen = []
    for t in range(steps):
        world = vector.worlds[0]
        before = world.steps
        tried = vector._retries is not None and vector._retries.trying(0)
        start, pose = world.world.start_pose.copy(), world.world.pose_true.copy()
        velocities = np.tile([0.6, 0.3 * np.sin(0.2 * t)], (len(vector), 1))
        result = vector.step_velocities(velocities)
        ended = bool(result.terminated[0] or result.truncated[0])
        failed = bool(result.terminated[0]) and result.parts[0].min() <= -500.0
        seen.append(
            Step(before, tried, start, pose, world.world.pose_true.copy(), ended, failed, result)
        )
    return seen


def test_a_failure_is_tried_again_from_before_it_so_often_and_no_longer() -> None:
    steps = driven(made(), 700)
    begun = [0, *(i + 1 for i, step in enumerate(steps) if step.ended)]
    plays = [steps[i:j] for i, j in pairwise(begun)]
    failures = 0
    for k, play in enumerate(plays[: -TRIES - 1]):
        if play[0].tried:
            continue
        end = play[-1].before + 1
        tried = [other[0].tried for other in plays[k + 1 : k + 2 + TRIES]]
        if not play[-1].failed or end < BACK[0]:
            assert not tried[0]
            continue
        if end < BACK[0] + 2:  # where the very first episode has no moment yet
            continue
        failures += 1
        assert tried == [True] * TRIES + [False]
        for other in plays[k + 1 : k + 1 + TRIES]:
            assert BACK[0] <= end - other[0].before <= BACK[1]
            np.testing.assert_array_equal(other[0].start, play[0].start)
            then = play[other[0].before]
            np.testing.assert_array_equal(then.pose_before, other[0].pose_before)
            assert other[-1].before + 1 <= end + PAST
            assert other[-1].result.terminated[0] or other[-1].before + 1 == end + PAST
    assert failures >= 10


def test_only_episodes_from_their_start_are_written_down() -> None:
    vector = made(1)
    written = ends = tries = 0
    for step in driven(vector, 400):
        ends += step.ended
        tries += step.ended and step.tried
        written += len(step.result.episodes)
    assert tries > 10 and written == ends - tries


def test_every_try_meets_other_noise() -> None:
    tracks: dict[int, list[np.ndarray]] = {}
    for step in driven(made(1), 400):
        if step.tried and not step.ended:
            tracks.setdefault(step.before, []).append(step.pose)
    same = [len({tuple(pose) for pose in poses}) == len(poses) for poses in tracks.values()]
    assert len(same) > 5 and all(same)


def test_worlds_do_not_depend_on_one_another_and_repeat() -> None:
    def rewards(vector: VectorNavigation, world: int) -> list[float]:
        return [float(step.result.reward[world]) for step in driven(vector, 150)]

    assert rewards(made(3, first=2), 1) == rewards(made(1, first=3), 0)


def test_a_copy_goes_on_the_same() -> None:
    vector = made(2)
    driven(vector, 60)
    copy = pickle.loads(pickle.dumps(vector))
    for ours, theirs in zip(driven(vector, 80), driven(copy, 80), strict=True):
        np.testing.assert_array_equal(ours.result.reward, theirs.result.reward)
        np.testing.assert_array_equal(ours.pose, theirs.pose)


def test_tests_have_none_and_the_default_neither() -> None:
    assert as_tested(made_config(most=2)).retry == RetryConfig()
    assert "retry" not in effective(load_config("lndrl"))
    assert VectorNavigation(made_config(), 0, 1)._retries is None


@pytest.mark.parametrize(
    ("retry", "sentence"),
    [
        ({"back": [5, 6], "every": 4}, r"back \[5, 6\] must span retry.every \(4\)"),
        ({"back": [30, 6]}, "least first"),
        ({"most": -1}, "greater than or equal to 0"),
    ],
)
def test_what_cannot_be_gone_back_to_is_refused(retry: dict[str, Any], sentence: str) -> None:
    with pytest.raises(UserError, match=sentence):
        made_config(**retry)
