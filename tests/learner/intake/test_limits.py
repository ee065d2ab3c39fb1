"""Limits that one side alone knows are found at the start, or told in the welcome."""

from __future__ import annotations

import base64
import random
from pathlib import Path
from threading import Event
from typing import Any

import pytest

from learner.intake.chunks import memory_of
from learner.intake.ingest import Ingest
from learner.intake.limits import check_messages, check_queue, chunk_too_large
from learner.intake.roster import Roster
from learner.run.events import EventLog
from learner.service import run_learner
from lndrl.config import MOST_WORLDS_PER_ACTOR, RunConfig, parse_config
from lndrl.errors import UserError
from lndrl.navigation.trajectory import most_bytes
from lndrl.transport import ChunkHeader, Hello, Refusal, Welcome, free_endpoint
from lndrl.transport.messages import encode
from lndrl.version import VERSION
from tests.learner.helpers_learner import random_trajectory, small_config


def test_what_a_chunk_takes_at_most_is_just_above_what_a_full_one_takes() -> None:
    config = small_config()
    trajectory = random_trajectory(config, 0, steps=8, worlds=5)
    for observation in (trajectory.observation, trajectory.final_observation):
        observation.pedestrian_count[:] = config.task.max_pedestrians
        observation.pedestrians[:] = 0.1
    header = ChunkHeader("run", "actor", "life", 1, 8, 5)
    size = len(encode(header, trajectory.to_arrays()))
    # Random ends come more often than any task lets episodes time out.
    finals = len(trajectory.final_index) - 2 * 5
    each = 2 * config.world.laser.beams + 16 * config.task.max_pedestrians + 29
    assert 0 <= most_bytes(config, 5) - (size - finals * each) < 40_000


def test_a_run_whose_chunks_would_never_arrive_is_refused_at_the_start(tmp_path: Path) -> None:
    config = small_config(
        transport={"max_message_megabytes": 1, "endpoint": free_endpoint()},
        actor={"worlds": 20, "horizon": 64},
    )
    folder = tmp_path / "run"
    stop = Event()
    stop.set()  # a learner that does not look would wait for such chunks for ever
    with pytest.raises(UserError) as caught:
        run_learner(config, folder, resume=False, stop=stop)
    sentence = str(caught.value)
    assert "20 worlds and 64 steps" in sentence and "max_message_megabytes 1 " in sentence
    assert not folder.exists()


def test_what_the_operators_file_lets_in_counts_too() -> None:
    config = small_config()
    assert chunk_too_large(config, 2, 2**28) == ""
    assert "max_message_size 1000 in the zenoh settings" in chunk_too_large(config, 2, 1000)


def test_weights_that_no_actor_could_receive_are_refused() -> None:
    config = small_config(transport={"max_message_megabytes": 2})
    check_messages(config, 2 * 2**20, 2**28)
    with pytest.raises(UserError, match=r"weights take 2\.5 MiB, more than"):
        check_messages(config, 5 * 2**19, 2**28)


def test_a_map_that_no_welcome_could_carry_is_refused() -> None:
    """``data`` is text of any length to the models; only building the place reads it."""
    noise = base64.b64encode(random.Random(0).randbytes(4 * 2**20)).decode()
    data: dict[str, Any] = small_config().model_dump(mode="json")
    cells = {"rows": 2048, "columns": 2048, "origin": [0.0, 0.0], "data": noise}
    data["scenario"].update(kind="map", map="big.yaml", cells=cells)
    config = parse_config(data, "test")
    with pytest.raises(UserError, match="with the map in it, and actors receive 4; crop the map"):
        check_messages(config, 1, 2**28)


def hello(worlds: int) -> Hello:
    return Hello("actor", "life", "here", 1, worlds, VERSION)


def made(config: RunConfig, tmp_path: Path, largest: int | None = None) -> Ingest:
    events = EventLog(tmp_path / "events.log", quiet=True)
    return Ingest(config, "run", "x", Roster(), events, largest_message=largest)


def test_an_actor_with_other_worlds_is_told_in_the_answer_to_its_hello(tmp_path: Path) -> None:
    config = small_config(transport={"max_message_megabytes": 1})
    ingest = made(config, tmp_path)
    assert isinstance(ingest.on_hello(hello(2)), Welcome)
    answer = ingest.on_hello(hello(1000))
    assert isinstance(answer, Refusal)
    assert "a chunk of 1000 worlds" in answer.reason and "use fewer" in answer.reason
    assert isinstance(made(config, tmp_path, largest=1000).on_hello(hello(2)), Refusal)
    ingest = made(small_config(transport={"max_message_megabytes": 512}), tmp_path)
    answer = ingest.on_hello(hello(MOST_WORLDS_PER_ACTOR + 1))
    assert isinstance(answer, Refusal) and "at most 4096 worlds" in answer.reason


@pytest.mark.parametrize(
    "section",
    ["world", "task", "localization", "learner", "actor", "transport", "ppo", "network"],
)
def test_no_number_of_a_configuration_is_beyond_what_others_can_read(section: str) -> None:
    """msgpack has integers of 64 bits: a learner that accepted more could welcome nobody."""
    data = small_config().model_dump(mode="json")
    for key, value in data[section].items():
        if isinstance(value, int) and not isinstance(value, bool):
            changed = {**data, section: {**data[section], key: 10**30}}
            with pytest.raises(UserError, match=key):
                parse_config(changed, "test")


@pytest.mark.parametrize(
    ("section", "key"),
    [
        ("transport", "upload_timeout"),
        ("transport", "lease"),
        ("task", "time_limit"),
        ("world", "tick"),
    ],
)
@pytest.mark.parametrize("value", [1e30, 86_401.0, 1e-9])
def test_durations_are_those_that_a_machine_can_wait_for(
    section: str, key: str, value: float
) -> None:
    with pytest.raises(UserError, match=key):
        small_config(**{section: {key: value}})


def test_an_episode_has_as_many_steps_as_memory_has_room_for() -> None:
    with pytest.raises(UserError, match=r"task.time_limit 86400 s has 86,400,000 control steps"):
        small_config(task={"time_limit": 86_400.0}, world={"tick": 0.001, "ticks_per_step": 1})
    assert small_config().steps_limit == 150


def test_a_queue_that_may_not_hold_the_largest_batch_is_found_at_the_start(tmp_path: Path) -> None:
    config = small_config(ppo={"batch_size_final": 2048}, learner={"queue_megabytes": 4})
    with pytest.raises(UserError) as caught:
        check_queue(config)
    said = str(caught.value)
    assert said.startswith("learner.queue_megabytes 4 may not hold a batch of ppo.batch_size_final")
    needed = int(said.split("up to ")[1].split(";")[0])
    check_queue(small_config(ppo={"batch_size_final": 2048}, learner={"queue_megabytes": needed}))
    transport = {"endpoint": free_endpoint()}
    config = config.model_copy(update={"transport": config.transport.model_copy(update=transport)})
    with pytest.raises(UserError, match="queue_megabytes"):
        run_learner(config, tmp_path / "run", resume=False, stop=Event())
    assert not (tmp_path / "run").exists()
    # Such a batch does fit: people everywhere, all chunks of one world each.
    size = 0
    for seed in range(4):
        trajectory = random_trajectory(config, seed, steps=8, worlds=1)
        for observation in (trajectory.observation, trajectory.final_observation):
            observation.pedestrian_count[:] = config.task.max_pedestrians
        message = len(encode(ChunkHeader("r", "a", "l", 1, 8, 1), trajectory.to_arrays()))
        size = max(size, memory_of(trajectory, message))
    assert size * 2048 / 8 <= needed * 1e6
