"""An actor's world is shown to whoever asks, seldom enough, and to nobody else."""

from __future__ import annotations

import time

import numpy as np
import pytest

from actors import showing
from actors.rollout import Rollout
from actors.showing import Showing
from lndrl.policy import initial_weights
from lndrl.transport.frames import decode_frame


class Audience:
    """An actor's endpoint that says whether somebody watches, and keeps what is shown."""

    def __init__(self) -> None:
        self.there = False
        self.shown: list[tuple[float, bytes]] = []

    def watched(self) -> bool:
        return self.there

    def show(self, frame: bytes) -> None:
        self.shown.append((time.monotonic(), frame))


@pytest.fixture
def audience() -> Audience:
    return Audience()


def rollout_for(config, audience: Audience) -> Rollout:
    rollout = Rollout(config, 0)
    rollout.load(7, initial_weights(config))
    rollout.show_on(Showing(audience, "run-1", "actor-0"))  # type: ignore[arg-type]
    return rollout


def test_nothing_is_made_while_nobody_watches_and_nothing_else_changes(
    small_config, audience: Audience, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(showing, "MOST_CPU", float("inf"))
    monkeypatch.setattr(showing, "_PAUSE", 0.0)
    config = small_config(task={"time_limit": 1.2})
    rollout = rollout_for(config, audience)
    chunk = rollout.collect(0)
    assert audience.shown == [] and rollout.showing is not None and rollout.showing.frames == 0
    watched = rollout_for(config, audience)
    audience.there = True
    same = watched.collect(0)
    assert chunk is not None and same is not None
    for name, array in chunk.trajectory.to_arrays().items():
        np.testing.assert_array_equal(same.trajectory.to_arrays()[name], array, err_msg=name)
    frames = [decode_frame(data) for _, data in audience.shown]
    assert len(frames) >= 6, "each step, where pause and share allow it"
    assert {frame.world for frame, _ in frames} == {rollout.environment.worlds[0].world_id}
    assert any(frame.outcome == "timeout" for frame, _ in frames), "the end is never left out"
    frame, arrays = next(each for each in frames if each[0].steps == 1)
    assert frame.weights_version == 7 and arrays["probabilities"].sum() == pytest.approx(1.0)
    action = int(same.trajectory.action[frame.steps - 1, 0])
    assert frame.action == action


def test_frames_are_few_and_cost_next_to_nothing(small_config, audience: Audience) -> None:
    rollout = rollout_for(small_config(), audience)
    audience.there = True
    rollout.collect(0)
    began, before = time.monotonic(), time.process_time()
    shown = rollout.showing
    assert shown is not None
    taken = shown.seconds
    number = 1
    while time.monotonic() - began < 1.5:
        rollout.collect(number)
        number += 1
    times = np.array([when for when, _ in audience.shown])
    assert len(times) >= 2
    assert np.diff(times).min() >= 0.099
    spent = time.process_time() - before
    assert shown.seconds - taken <= 2 * showing.MOST_CPU * spent


def test_whoever_comes_while_it_waits_sees_where_it_stands(
    small_config, audience: Audience
) -> None:
    rollout = rollout_for(small_config(), audience)
    rollout.collect(0)
    assert audience.shown == []
    audience.there = True
    rollout.show()
    (frame, arrays) = decode_frame(audience.shown[0][1])
    assert frame.steps > 0 and len(arrays["grid"]) > 0
    assert arrays["probabilities"].sum() == pytest.approx(1.0)
