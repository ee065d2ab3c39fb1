"""Whatever a sender does costs the sender."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from learner.intake.ingest import Ingest
from learner.intake.roster import _LIVES, _REMEMBERED, Roster
from learner.intake.sequences import _WINDOW, Sequences
from learner.ppo.batch import assemble
from learner.ppo.update import PPO
from lndrl.navigation import Trajectory
from lndrl.navigation.reward import REWARD_PARTS
from lndrl.navigation.trajectory import final_indices
from lndrl.transport import MessageError, Refusal
from lndrl.transport.desk import LearnerDesk
from lndrl.transport.messages import Ack, Limits, decode, encode
from tests.learner.helpers_learner import random_trajectory, small_config
from tests.learner.intake.test_ingest import header, hello, make_ingest, send

EPISODE = {
    "world": 0,
    "episode": 0,
    "outcome": "arrived",
    "steps": 8,
    "time": 3.2,
    "distance": 2.0,
    "position_error": 0.1,
    "angle_error": 0.1,
    "variance_sum": 0.1,
    "episode_return": 1.0,
    "reward_parts": dict.fromkeys(REWARD_PARTS, 1.0),
}


def refusal(ingest: Ingest, arrays: dict | None = None, **fields) -> str:
    """Why a chunk is refused; it must leave no trace but a count and an event."""
    before = ingest.accounts.totals()
    if arrays is None:
        arrays = random_trajectory(ingest.config, 1).to_arrays()
    ack = ingest.on_chunk(header(**fields), arrays, 1000)
    assert ack.status == "refused" and 10 < len(ack.reason) <= 500
    assert ingest.accounts.totals() == before and ingest.waiting()["chunks"] == 0
    assert ingest.events.recent()[-1]["kind"] == "refused"
    return ack.reason


@pytest.mark.parametrize(
    "fields, why",
    [
        ({"steps": 7}, "8 steps"),
        ({"steps": 0}, "8 steps"),
        ({"steps": 2**53 - 1}, "8 steps"),
        ({"worlds": 3}, "header"),
        ({"worlds": 2**53 - 1}, "at most"),
        ({"sequence": 0}, "counts from 1"),
        ({"sequence": 2**53 - 1}, "counts from 1"),
        ({"run_id": "x" * 2000}, "is not this run"),
        ({"episodes": [EPISODE] * 100}, "cannot have ended"),
        ({"episodes": [{"world": 1}]}, "keys"),
        ({"episodes": [{**EPISODE, "episode_return": 1e308}]}, "finite"),
        ({"episodes": [{**EPISODE, "steps": 2**63}]}, "whole number"),
        ({"episodes": [{**EPISODE, "time": float("nan")}]}, "finite"),
        ({"episodes": [{**EPISODE, "outcome": "won"}]}, "outcome"),
    ],
)
def test_headers_that_do_not_fit_are_refused(fields, why: str) -> None:
    assert why in refusal(make_ingest(), **fields)


def test_only_the_parts_of_the_run_s_own_reward_are_taken() -> None:
    parts = dict.fromkeys((*REWARD_PARTS, "bonus"), 1.0)
    made = {**EPISODE, "reward_parts": parts}
    assert "reward_parts needs the keys" in refusal(make_ingest(), episodes=[made])
    terms = {"bonus": {"use": "not_even_here:Bonus"}}  # the learner only names it
    ingest = make_ingest(task={"reward": {"terms": terms}})
    assert "reward_parts needs the keys" in refusal(ingest, episodes=[EPISODE])
    arrays = random_trajectory(ingest.config, 1).to_arrays()
    assert ingest.on_chunk(header(episodes=[made]), arrays, 1000).status == "accepted"


def test_arrays_must_be_of_the_size_that_the_header_tells() -> None:
    ingest = make_ingest()
    for steps, worlds in ((9, 2), (8, 3), (1, 2)):
        arrays = random_trajectory(ingest.config, 1, steps=steps, worlds=worlds).to_arrays()
        assert "header" in refusal(ingest, arrays)
    assert "header" in refusal(ingest, {})
    assert refusal(ingest, {"action": np.zeros((8, 2), np.uint8)})
    assert send(ingest).status == "accepted"


def test_weights_that_were_never_published_are_refused() -> None:
    ingest = make_ingest()
    ingest.weights_version = 5
    for version in (6, 2**31, 2**32 - 1):
        arrays = random_trajectory(ingest.config, 1, version=version).to_arrays()
        assert "never published" in refusal(ingest, arrays)
    assert send(ingest, version=5).status == "accepted"


def test_weights_of_updates_that_a_crash_undid_are_still_taken() -> None:
    ingest = make_ingest()
    ingest.weights_version, ingest.newest_version = 20, 37
    assert send(ingest, version=37).status == "accepted"
    assert send(ingest, version=38, sequence=2).status == "refused"


@pytest.mark.parametrize(
    "timing",
    [{"x": math.nan}, {"x": math.inf}, {"x": 1e300}, {"x": "1"}, {str(n): 1.0 for n in range(99)}],
)
def test_timings_that_no_clock_shows_are_no_message(timing) -> None:
    with pytest.raises(MessageError, match="timing"):
        header(timing=timing)


def test_a_liar_about_time_does_not_change_what_is_shown_of_all() -> None:
    ingest = make_ingest(ppo={"batch_size": 1024, "minibatch_size": 16})
    send(ingest, actor="honest", timing={"infer": 10.0})
    send(ingest, actor="liar", timing={"wait": 9e8})
    assert ingest.roster.totals()["wait"] < 100.0
    assert ingest.roster.shares()["infer"] > 0.1


def test_jumping_sequences_cost_nothing_and_only_their_own_life() -> None:
    known, before = Sequences(), 1
    for n in range(100):
        lost = known.add(2**31 - 1000 + 7 * n)
        assert lost < 2**31
        before += lost
    assert len(known.beyond) <= _WINDOW and known.next > 2**30
    ingest = make_ingest(ppo={"batch_size": 10**6, "minibatch_size": 16})
    for n in range(_WINDOW + 5):
        send(ingest, actor="liar", sequence=2**31 - 100 + n)
        send(ingest, actor="honest", sequence=n + 1)
    assert not ingest.roster.is_known("liar", "x", 5)
    assert not ingest.roster.is_known("honest", "x", _WINDOW + 6)


@settings(max_examples=100, deadline=None)
@given(
    numbers=st.lists(st.integers(1, 90), min_size=25, max_size=80),
    excused=st.sets(st.integers(1, 40)),
)
def test_sequences_agree_with_sets(numbers: list[int], excused: set[int]) -> None:
    """Known is what came and nothing else; what is missing up to ``next`` was counted as lost."""
    known, came, lost = Sequences(), set(), 0
    for n in excused:
        known.excuse(n)
    for n in numbers:
        if n in known:
            continue
        assert n not in came
        came.add(n)
        late = n < known.next and n not in excused
        lost += known.add(n) - late
        assert len(known.beyond) <= _WINDOW
        assert {k for k in range(1, 91) if k in known} == came
    passed = set(range(1, known.next))
    assert lost == len(passed - came - excused)


def test_two_actors_of_one_name_do_no_harm() -> None:
    """They alternate; each chunk is trained on once, and it is not a restart per chunk."""
    ingest = make_ingest(ppo={"batch_size": 10**6, "minibatch_size": 16})
    for n in range(1, 30):
        for life in ("x", "y"):
            assert send(ingest, sequence=n, incarnation=life).status == "accepted"
            assert send(ingest, sequence=n, incarnation=life).status == "duplicate"
    (row,) = ingest.roster.rows(0)
    assert (row["restarts"], row["state"], ingest.gaps) == (1, "active", 0)
    ingest.on_member("a", "x", False)
    assert send(ingest, sequence=30, incarnation="y").status == "accepted"
    assert ingest.roster.rows(0)[0]["state"] == "active"


def test_hellos_in_an_actors_name_do_not_make_it_forget() -> None:
    ingest = make_ingest()
    send(ingest, sequence=1)
    for n in range(100):
        ingest.on_hello(hello(incarnation=f"liar-{n}"))
    assert send(ingest, sequence=1).status == "duplicate"


def test_who_leaves_without_delivering_is_forgotten_after_a_while(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Crowds that come and go must not fill the memory, nor the dashboard's table."""
    now = [1000.0]
    monkeypatch.setattr("learner.intake.roster.time.monotonic", lambda: now[0])
    roster = Roster()

    def crowd(name: str) -> None:
        for number in range(20):
            roster.join(f"{name}-{number}", "life", "host", 1, 1)

    roster.join("honest", "life", "host", 1, 1)
    roster.accepted("honest", "life", 1, steps=4, version=0, timing={})
    crowd("first")
    for number in range(1, 20):
        roster.gone(f"first-{number}", "life", False)
    roster.gone("honest", "life", False)
    crowd("second")
    assert roster.counts() == (21, 41)
    now[0] += _REMEMBERED - 1.0
    roster.gone("first-0", "life", False)
    now[0] += 2.0
    roster.join("newcomer", "life", "host", 1, 1)
    here = {row["id"] for row in roster.rows(0)}
    assert here == {"honest", "first-0", "newcomer", *(f"second-{n}" for n in range(20))}
    assert roster.is_known("honest", "life", 1)


def test_memory_of_lives_and_actors_is_bounded() -> None:
    roster = Roster(most=10)
    for n in range(100):
        member = roster.join("a", f"life-{n}", "h", 1, 1)
        roster.accepted("a", f"life-{n}", 1, 16, 0, {})
        assert member is not None and len(member.lives) <= _LIVES >= len(member.seen)
    for n in range(1000):
        assert roster.join(f"ghost-{n}", "x", "h", 1, 1) is not None
    assert roster.counts()[1] == 10
    assert roster.is_known("a", "life-99", 1), "ghosts that deliver nothing go first"
    for n in range(9):
        assert roster.join(f"real-{n}", "x", "h", 1, 1) is not None
        roster.accepted(f"real-{n}", "x", 1, 16, 0, {})
    assert roster.join("one too many", "x", "h", 1, 1) is None
    roster.gone("real-3", "x", False)
    newcomer = roster.join("newcomer", "x", "h", 1, 1)
    assert newcomer is not None and newcomer.index > 1000, "an index is never given twice"
    assert not roster.is_known("real-3", "x", 1)


def test_a_full_house_is_said_to_whoever_knocks() -> None:
    ingest = make_ingest()
    ingest.roster._most = 1
    send(ingest, actor="a")
    answer = ingest.on_hello(hello(actor_id="b"))
    assert isinstance(answer, Refusal) and "serve" in answer.reason
    assert send(ingest, actor="b").status == "refused"


def test_one_flooding_actor_does_not_fill_a_lockstep_round() -> None:
    ingest = make_ingest(learner={"mode": "lockstep"}, transport={"upload_timeout": 60.0})
    statuses = [send(ingest, actor="liar", sequence=n).status for n in range(1, 10)]
    assert statuses.count("accepted") == 3 and statuses[-1] == "pause"
    assert send(ingest, actor="honest").status == "accepted"
    chunks = ingest.take_round(2, timeout=0.0)
    assert chunks is not None and [c.actor_id for c in chunks] == ["liar", "honest"]


def test_waiting_memory_counts_people_unpacked() -> None:
    ingest = make_ingest()
    send(ingest)
    assert ingest.waiting()["megabytes"] > 16 * ingest.config.task.max_pedestrians * 16 / 1e6


def test_long_words_in_a_hello_become_a_refusal() -> None:
    answer = make_ingest().on_hello(hello(program_version="9" * 2000, host="x\n" * 900))
    assert isinstance(answer, Refusal)
    ingest = make_ingest()
    ingest.on_hello(hello(host="evil\nhost\x1b[2J" + "x" * 1000))
    assert ingest.roster.rows(0)[0]["host"].startswith("evil?host?")
    assert len(ingest.roster.rows(0)[0]["host"]) == 64


@settings(max_examples=150, deadline=None)
@given(data=st.binary(max_size=200), cut=st.integers(0, 3000), seed=st.integers(0, 3))
def test_malformed_uploads_are_counted_and_answered(data: bytes, cut: int, seed: int) -> None:
    ingest = DESK[0]
    before = ingest.answers["refused"]
    good = bytearray(encode(header(), random_trajectory(ingest.config, seed).to_arrays()))
    at = cut % len(good)
    broken = bytes(good[:at]) + data
    ack, _ = decode(encode(DESK[1].answer_chunk(broken)), Ack)
    assert ack.status == "refused" and ack.reason != "learner_error"
    assert ingest.answers["refused"] == before + 1
    assert len(ingest.events.recent()) <= 50


def _desk() -> tuple[Ingest, LearnerDesk]:
    ingest, desk = make_ingest(), LearnerDesk(Limits())
    desk.handlers = ingest
    return ingest, desk


DESK = _desk()


# -- arrays that pass the checks must be arrays that can be learned from -----------------------

FLOATS = st.one_of(
    st.sampled_from(
        [0.0, -0.0, 1e-45, -1e-45, 1e-38, 1e9, -1e9, 1e6, -1e6, 104.0, -104.0, 3.4e38, -3.4e38]
    ),
    st.floats(width=32),
)
NAMES = ("goal", "log_prob", "reward", "pedestrian_rows", "final_goal", "final_pedestrian_rows")


@pytest.fixture(scope="module")
def trainer():
    ppo = PPO(small_config(ppo={"epochs": 1, "minibatch_size": None}))
    yield ppo
    ppo.close()


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_what_passes_the_checks_can_be_learned_from(trainer: PPO, data: st.DataObject) -> None:
    """Extreme values are refused, or the update stays finite."""
    arrays = random_trajectory(trainer.config, data.draw(st.integers(0, 9))).to_arrays()
    for _ in range(data.draw(st.integers(1, 6))):
        array = arrays[data.draw(st.sampled_from(NAMES))]
        if array.size:
            places = slice(None) if data.draw(st.booleans()) else slice(0, 1)
            array.reshape(-1)[places] = data.draw(FLOATS)
    try:
        trajectory = Trajectory.from_arrays(arrays, trainer.config)
    except ValueError as error:
        assert "trajectory" in str(error)
        return
    trainer.update(assemble([trajectory]), 0.0)


def test_the_most_extreme_that_passes_can_be_learned_from(trainer: PPO) -> None:
    made = random_trajectory(trainer.config, 1)
    rng = np.random.default_rng(0)
    sign = rng.choice([-1.0, 1.0], made.reward.shape).astype(np.float32)
    goal = made.observation.goal
    goal[..., :2], goal[..., 2] = 1e6, -math.pi
    goal[..., 3:] = trainer.config.task.variance_limit
    none = np.zeros_like(made.terminated)
    index = final_indices(none, none)
    extreme = replace(
        made,
        reward=np.float32(1e9) * sign,
        log_prob=np.full_like(made.log_prob, -104.0),
        terminated=none,
        truncated=none,
        final_index=index,
        final_observation=made.observation.take(-1),
    )
    checked = Trajectory.from_arrays(extreme.to_arrays(), trainer.config)
    for _ in range(3):
        figures = trainer.update(assemble([checked, random_trajectory(trainer.config, 2)]), 0.0)
        assert math.isfinite(figures["value_loss"])
    assert all(torch.isfinite(p).all() for p in trainer.policy.parameters())


def test_everything_here_is_about_a_chunk_header() -> None:
    """The fields that a liar fills; a new one needs a check and a test here."""
    assert set(header().to_dict()) == {
        *("run_id", "actor_id", "incarnation", "sequence", "steps", "worlds"),
        *("episodes", "timing", "host", "pid", "machine"),
    }


@pytest.mark.parametrize(
    "machine",
    [None, [], {"cpu": 1.5}, {"gpu": -0.1}, {"memory": float("nan")}, {"cpu": "1"}, {"fan": 0.5}],
)
def test_machines_that_cannot_be_are_no_message(machine) -> None:
    with pytest.raises(MessageError, match="machine"):
        header(machine=machine)
