"""The actor against a learner that only takes notes, over the in-memory transport."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
import torch

from actors.actor import Actor
from actors.laps import Laps
from lndrl.errors import UserError
from lndrl.machine.threads import kept_threads, set_threads
from lndrl.navigation import EpisodeRecord, Observation, Trajectory
from lndrl.policy import PolicyRunner
from lndrl.transport import MemoryNetwork
from lndrl.transport.status import ACTOR_ACTIVITIES
from tests.lndrl.machine.blas import blas_threads

PATIENCE = 60.0  # s, for machines with much else to do


class TickingLaps(Laps):
    """A stopwatch whose clock moves by 1 with each reading, and by hand; ``taken_at``: its time."""

    def __init__(self) -> None:
        self.now = self.taken_at = 0.0
        super().__init__(self._tick)

    def take(self) -> dict[str, float]:
        seconds = super().take()
        self.taken_at = self.now
        return seconds

    def _tick(self) -> float:
        self.now += 1.0
        return self.now


@pytest.fixture
def network():
    return MemoryNetwork()


@pytest.fixture
def joined(small_config, noting_learner, network):
    """A learner and an actor of the given mode; weights version 0 is out."""

    def build(mode: str, **options):
        config = small_config(learner={"mode": mode})
        learner = noting_learner(config, network.learner())
        learner.publish(0)
        return learner, Actor(network.actor(), actor_id="a", incarnation="i", **options)

    return build


def test_uploads_are_numbered_and_complete(joined):
    learner, actor = joined("async")
    for _ in range(3):
        assert actor.run_chunk()
    actor.endpoint.flush(PATIENCE)
    assert [h.sequence for h in learner.headers] == [1, 2, 3]
    for header, arrays in zip(learner.headers, learner.arrays, strict=True):
        assert (header.run_id, header.actor_id, header.incarnation) == ("run-1", "a", "i")
        assert (header.steps, header.worlds) == (8, 2)
        assert set(header.timing) == set(ACTOR_ACTIVITIES)
        assert min(header.timing.values()) >= 0
        trajectory = Trajectory.from_arrays(arrays, learner.config)
        ended = int(trajectory.terminated.sum() + trajectory.truncated.sum())
        assert len([EpisodeRecord.from_dict(e) for e in header.episodes]) == ended
    assert learner.headers[0].timing["fetch"] > 0
    assert learner.headers[1].timing["fetch"] == 0, "the weights had not changed"
    assert learner.headers[1].timing["upload"] > 0, "the upload before"


@pytest.mark.parametrize("alone", [False, True])
def test_only_a_process_of_its_own_gets_the_configured_threads(
    small_config, noting_learner, network, alone
):
    noting_learner(small_config(actor={"threads": 3}), network.learner())
    with kept_threads():
        set_threads(1)
        Actor(network.actor(), alone=alone).join()
        assert {torch.get_num_threads()} == blas_threads() == {1 + 2 * alone}


def test_actions_come_from_the_weights_that_the_chunk_names(joined):
    learner, actor = joined("async")
    actor.run_chunk()
    learner.publish(5)
    actor.run_chunk()
    actor.endpoint.flush(PATIENCE)
    assert learner.versions() == [0, 5]
    runner = PolicyRunner(learner.config)
    for version, arrays in zip((0, 5), learner.arrays, strict=True):
        trajectory = Trajectory.from_arrays(arrays, learner.config)
        rows: Observation = trajectory.observation.flatten()
        errors = {}
        for candidate in (0, 5):
            runner.load(learner.blobs[candidate])
            table = runner.log_probabilities(rows)
            chosen = table[np.arange(len(rows)), trajectory.action.reshape(-1)]
            errors[candidate] = np.abs(chosen - trajectory.log_prob.reshape(-1)).max()
        assert errors[version] < 1e-5 < errors[5 - version]


def test_async_takes_the_newest_at_every_boundary(joined):
    learner, actor = joined("async")
    for newest in (0, 1, 4, 4, 9):
        if newest not in learner.blobs:
            learner.publish(newest)
        assert actor.ready() and actor.run_chunk()
    actor.endpoint.flush(PATIENCE)
    assert learner.versions() == [0, 1, 4, 4, 9]


@pytest.mark.parametrize("base", [0, 12])
def test_lockstep_acts_one_update_behind(joined, base):
    """Chunk n on version max(0, n - 1), from the version at the first hello on."""
    learner, actor = joined("lockstep")
    if base:
        learner.publish(base)
    for version in range(1, 5):
        assert actor.ready() and actor.run_chunk()
        if version == 1:
            assert actor.ready() and actor.run_chunk()
        assert not actor.ready()
        assert not actor.run_chunk(), "there is nothing to do before the next version"
        learner.publish(base + version)
    assert actor.run_chunk()
    actor.endpoint.flush(PATIENCE)
    assert learner.versions() == [base + n for n in (0, 0, 1, 2, 3, 4)]


def test_lockstep_ignores_weights_ahead_of_its_turn(joined):
    learner, actor = joined("lockstep")
    actor.run_chunk()
    learner.publish(1)
    actor.run_chunk()
    actor.endpoint.flush(PATIENCE)
    assert learner.versions() == [0, 0]


def test_lockstep_collects_again_for_a_dropped_chunk(joined):
    """A chunk the learner did not take must not leave both waiting for each other."""
    learner, actor = joined("lockstep")
    learner.answer = lambda header: "stale" if header.sequence == 2 else "accepted"
    for _ in range(2):
        actor.run_chunk()
    actor.endpoint.flush(PATIENCE)
    actor.run_chunk()
    actor.endpoint.flush(PATIENCE)
    assert learner.versions() == [0, 0]
    assert [h.sequence for h in learner.headers] == [1, 3]


def test_lockstep_falls_in_where_the_learner_is(joined):
    """The wanted version is gone (the learner keeps two): go on from the newest."""
    learner, actor = joined("lockstep")
    for _ in range(2):
        actor.run_chunk()
    for version in (1, 2, 3):
        learner.publish(version)
    assert not actor.run_chunk()
    assert actor.run_chunk()
    actor.endpoint.flush(PATIENCE)
    assert learner.versions() == [0, 0, 3]


def arrays_of(small_config, noting_learner, mode, incarnation, base=0):
    """Two chunks of a fresh actor in a fresh run."""
    network = MemoryNetwork()
    learner = noting_learner(small_config(learner={"mode": mode}), network.learner())
    learner.publish(base)
    actor = Actor(network.actor(), actor_id="a", incarnation=incarnation)
    for _ in range(2):
        actor.run_chunk()
    actor.endpoint.flush(PATIENCE)
    return [arrays["scan"] for arrays in learner.arrays]


def test_lockstep_repeats_whatever_the_incarnation(small_config, noting_learner):
    first = arrays_of(small_config, noting_learner, "lockstep", "one")
    second = arrays_of(small_config, noting_learner, "lockstep", "two")
    np.testing.assert_array_equal(first, second)
    resumed = arrays_of(small_config, noting_learner, "lockstep", "one", base=3)
    assert not np.array_equal(first, resumed), "a resumed run plays other episodes"


def test_async_incarnations_play_other_episodes(small_config, noting_learner):
    first = arrays_of(small_config, noting_learner, "async", "one")
    again = arrays_of(small_config, noting_learner, "async", "one")
    other = arrays_of(small_config, noting_learner, "async", "two")
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_before_the_first_weights_there_is_nothing_to_do(small_config, noting_learner, network):
    learner = noting_learner(small_config(), network.learner())
    actor = Actor(network.actor())
    assert not actor.run_chunk()
    assert not actor.ready()
    learner.publish(0)
    assert actor.ready() and actor.run_chunk()


def test_done_ends_the_run(joined):
    learner, actor = joined("async")
    stop = threading.Event()
    thread = threading.Thread(target=actor.run, args=(stop,))
    thread.start()
    learner.endpoint.finish()
    thread.join(PATIENCE)
    assert not thread.is_alive()
    assert actor.done and not actor.ready() and not actor.run_chunk()


def test_stop_ends_the_run_in_mid_chunk(joined):
    learner, actor = joined("async")
    stop = threading.Event()
    actor.join()
    act = actor.rollout.runner.act

    def act_and_stop(*arguments, **named):
        stop.set()
        return act(*arguments, **named)

    actor.rollout.runner.act = act_and_stop
    actor.run(stop)
    assert learner.headers == [] and not actor.done


def test_same_version_of_another_learner_is_other_weights(joined, noting_learner, network):
    learner, actor = joined("async")
    actor.run_chunk()
    learner.endpoint.close()
    second = noting_learner(learner.config, network.learner())
    second.publish(0)
    actor.run_chunk()
    actor.endpoint.flush(PATIENCE)
    assert second.versions() == [0]
    assert second.headers[0].timing["fetch"] > 0


@pytest.mark.parametrize("mode", ["async", "lockstep"])
def test_restarted_learner_gets_the_kept_chunk_and_the_next(joined, noting_learner, network, mode):
    told = []
    learner, actor = joined(mode, on_event=lambda *event: told.append(event[0]))
    actor.run_chunk()
    worlds = actor.rollout
    learner.endpoint.close()
    actor.run_chunk()
    assert actor.endpoint.pending() == 1
    second = noting_learner(learner.config, network.learner())
    second.publish(6)

    def collect(chunks: int) -> None:
        """A quick world is done before its last chunk is acknowledged, and must wait for that."""
        deadline = time.monotonic() + PATIENCE
        for _ in range(chunks):
            while not actor.run_chunk():
                assert time.monotonic() < deadline
                time.sleep(0.001)

    # In lock-step the kept chunk is the learner's first, so one more may be collected on 6.
    collect(3 if mode == "async" else 1)
    if mode == "lockstep":
        assert not actor.run_chunk() and not actor.run_chunk()
    second.publish(7)
    collect(1)
    actor.endpoint.flush(PATIENCE)
    assert told == ["joined", "joined again"]
    assert actor.rollout is worlds, "the episodes go on"
    expected = [0, 6, 6, 6, 7] if mode == "async" else [0, 6, 7]
    assert second.versions() == expected
    assert [h.sequence for h in second.headers] == list(range(2, 2 + len(expected)))


def test_full_window_is_not_ready_and_is_sent_again(joined):
    """In one thread, a learner that pauses must not make the upload wait for ever."""
    learner, actor = joined("async")
    learner.answer = lambda header: "pause"
    assert actor.run_chunk() and actor.run_chunk()
    assert not actor.ready() and not actor.run_chunk()
    learner.answer = lambda header: "accepted"
    deadline = time.monotonic() + PATIENCE
    while not actor.ready() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert [h.sequence for h in learner.headers] == [1, 2]


def test_refused_chunks_are_told(joined):
    told = []
    learner, actor = joined("async", on_event=lambda *event: told.append(event))
    learner.answer = lambda header: "refused"
    actor.run_chunk()
    actor.endpoint.flush(PATIENCE)
    actor.run_chunk()
    assert told[0][0] == "joined"
    assert ("refused", "as the test wants") in told


def test_refused_actor_is_a_user_error(joined):
    learner, actor = joined("async")
    learner.refusal = "another version"
    with pytest.raises(UserError, match="another version"):
        actor.run(threading.Event())


def test_worlds_override_the_configuration(joined):
    learner, actor = joined("async", worlds=1)
    actor.run_chunk()
    actor.endpoint.flush(PATIENCE)
    assert learner.headers[0].worlds == 1
    assert learner.arrays[0]["action"].shape == (8, 1)


def test_timing_accounts_for_all_wall_time(joined):
    """Whatever an actor does between two headers, the second one has told it all."""
    learner, actor = joined("async")
    actor.laps = laps = TickingLaps()
    assert actor.run_chunk()
    begun = laps.taken_at
    learner.publish(1)
    laps.now += 1000.0  # nothing to do: the service would wait here
    for _ in range(3):
        assert actor.run_chunk()
    actor.endpoint.flush(PATIENCE)
    told = [header.timing for header in learner.headers[1:]]
    assert sum(sum(timing.values()) for timing in told) == laps.taken_at - begun > 1000.0
    assert 1000.0 < sum(timing["wait"] for timing in told) < 1010.0
    assert told[0]["fetch"] > 0 and told[0]["infer"] > 0 and told[0]["simulate"] > 0


def test_joining_is_no_part_of_a_chunk(joined):
    """Compiling and building worlds takes seconds that say nothing about the balance."""
    learner, actor = joined("async")
    actor.laps = laps = TickingLaps()
    welcome = learner.on_hello

    def late(hello):
        laps.now += 1000.0
        return welcome(hello)

    learner.on_hello = late
    actor.join()
    begun = laps.now
    assert begun > 1000.0
    actor.run_chunk()
    actor.endpoint.flush(PATIENCE)
    assert sum(learner.headers[0].timing.values()) == laps.taken_at - begun < 1000.0


@pytest.mark.parametrize(("siblings", "worlds"), [(1, 4), (4, 2), (16, 1)])
def test_auto_worlds_depend_on_the_fleet(small_config, noting_learner, network, siblings, worlds):
    changes = {"ppo": {"batch_size": 64, "minibatch_size": 32}, "learner": {"max_lag": 2}}
    learner = noting_learner(small_config(actor={"worlds": "auto"}, **changes), network.learner())
    learner.publish(0)
    actor = Actor(network.actor(), siblings=siblings)
    actor.run_chunk()
    actor.endpoint.flush(PATIENCE)
    assert learner.headers[0].worlds == worlds
