"""The learner's loop over the in-memory transport, fed with ready-made trajectories."""

from __future__ import annotations

import hashlib
import json
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.torch import load as load_tensors

from learner.learner import Learner
from learner.status import snapshot
from lndrl.config import RunConfig, load_config, load_scenario
from lndrl.errors import UserError
from lndrl.evaluation.benchmark.trainings import training_of
from lndrl.evaluation.run_metrics import read_metrics
from lndrl.numbering import checkpoint_name
from lndrl.policy.device import machine_with
from lndrl.transport import ChunkHeader, Hello, MemoryNetwork
from lndrl.transport.status import LEARNER_ACTIVITIES, overhead, parse_history, parse_status
from lndrl.version import VERSION
from lndrl.view.dashboard.screen import plain_line
from tests.learner.helpers_learner import random_trajectory, small_config


class Run:
    """A learner and one in-memory actor endpoint that sends what it is told to."""

    def __init__(self, config: RunConfig, path: Path, **options) -> None:
        network = MemoryNetwork()
        self.learner = Learner(config, path, network.learner(), quiet=True, **options)
        self.learner.begin()
        self.actor = network.actor()
        hello = Hello("a", f"life-{self.learner.counters.updates}", "host", 1, 2, VERSION)
        self.welcome = self.actor.hello(hello)
        self.incarnation = hello.incarnation
        self.sequence = 0

    def send(self, version: int | None = None) -> None:
        self.sequence += 1
        config = self.learner.config
        version = self.learner.counters.version if version is None else version
        trajectory = random_trajectory(config, self.sequence, version=version)
        header = ChunkHeader(
            self.welcome.run_id, "a", self.incarnation, self.sequence, 8, 2, timing={"infer": 1.0}
        )
        self.actor.upload(header, trajectory.to_arrays())

    def update(self, times: int = 1) -> None:
        for _ in range(times):
            self.send()
            self.send()
            assert self.learner.advance(timeout=0.0)

    def close(self) -> None:
        self.learner.end()
        self.learner.close()


@pytest.fixture
def start(tmp_path: Path):
    runs: list[Run] = []

    def make(name: str = "run", resume: bool = False, checkpoint: str | None = None, **changes):
        run = Run(small_config(**changes), tmp_path / name, resume=resume, checkpoint=checkpoint)
        runs.append(run)
        return run

    yield make
    for run in runs:
        run.learner.close()


def test_notes_of_the_map_are_events(tmp_path: Path) -> None:
    """Nobody may be at the terminal where the run was started."""
    office = load_scenario("office")
    assert office.cells is not None
    cells = office.cells.model_copy(update={"notes": ["office.yaml: grey 205 is floor"]})
    scenario = office.model_copy(update={"cells": cells})
    run = Run(small_config().model_copy(update={"scenario": scenario}), tmp_path / "run")
    run.close()
    said = run.learner.folder.events.read_text()
    assert " map        office.yaml: grey 205 is floor\n" in said


def test_an_update_publishes_the_next_version_and_records(start) -> None:
    run = start()
    assert run.actor.fetch()[0] == 0
    assert not run.learner.advance(timeout=0.0)
    run.update()
    assert run.actor.fetch()[0] == 1
    (row,) = read_metrics(run.learner.folder.path / "metrics.jsonl")
    assert (row["update"], row["steps"], row["version"]) == (1, 32, 1)
    assert set(row["ppo"]) >= {"policy_loss", "value_loss", "entropy", "kl", "clip_fraction"}
    assert run.learner.counters.steps == 32
    spent = row["time"]["spent"]
    assert set(spent["learner"]) == set(LEARNER_ACTIVITIES)
    assert min(spent["learner"][name] for name in ("wait", "ingest", "update", "publish")) > 0
    assert spent["actors"] == {"infer": 2.0} and spent["actor_steps"] == 32
    assert row["time"]["actor_share_infer"] == 1.0 and row["time"]["overhead_actor"] == 0.0
    assert row["time"]["overhead_learner"] == pytest.approx(overhead(spent["learner"]), abs=0.05)


def test_the_learners_time_is_all_accounted_for(start) -> None:
    run = start()
    # The checkpoint with which it began counts already.
    outer = -time.monotonic()
    before = sum(run.learner.split.totals().values())
    inner = -time.monotonic()
    run.update()
    run.learner.checkpoint()
    run.update()
    inner += time.monotonic()
    spent = run.learner.split.totals()
    outer += time.monotonic()
    assert spent["other"] > 0, "what lies between the named activities"
    assert inner - 1e-6 <= sum(spent.values()) - before <= outer + 1e-6


def test_freed_memory_goes_back_whether_or_not_there_is_a_batch(start, monkeypatch) -> None:
    returned: list[object] = []
    monkeypatch.setattr("learner.memory.return_freed_memory", returned.append)
    run = start()
    run.learner.advance(timeout=0.0)
    assert not returned
    monkeypatch.setattr(run.learner._memory, "_interval", 0.0)
    for _ in range(2):
        assert not run.learner.advance(timeout=0.0)
    assert len(returned) == 2
    run.update()
    assert returned == 3 * [run.learner.ppo.each_thread]


def test_lag_is_measured_in_versions(start) -> None:
    run = start()
    run.update(2)
    run.send(version=0)
    run.send(version=2)
    assert run.learner.advance(timeout=0.0)
    assert run.learner.lag == {"mean": 1.0, "max": 2}


def test_a_run_that_waits_for_kernels_says_so(start, monkeypatch) -> None:
    monkeypatch.setattr("learner.status._SETTLING", 600.0)
    run = start()
    hello = Hello("a-0", "x", "h", 1, 2, VERSION)
    run.learner.ingest.on_hello(hello)
    for ready in (0, 12):
        run.learner.ingest.on_hello(replace(hello, kernels_ready=ready, kernels_needed=31))
    status = parse_status(snapshot(run.learner))
    row = status.actors[-1]
    assert (row.kernels_ready, row.kernels_needed, row.state) == (12, 31, "active")
    assert status.verdict.startswith("compiling: 12 of 31 kernels are ready on a-0; only a first")
    assert "compiling, 12 of 31 kernels are ready on a-0" in plain_line(status)
    joins = [e for e in run.learner.events.recent() if e["kind"] == "join" and "a-0" in e["text"]]
    assert len(joins) == 1, "news of kernels are no new actors"
    run.learner.ingest.on_hello(hello)  # it has them all
    assert parse_status(snapshot(run.learner)).verdict == "learning"
    run.learner.ingest.on_hello(replace(hello, kernels_ready=1, kernels_needed=31))
    starting = Hello("a", run.incarnation, "h", 1, 2, VERSION, kernels_needed=31)
    run.learner.ingest.on_hello(starting)
    run.update()
    status = parse_status(snapshot(run.learner))
    assert status.verdict == "learning", "others deliver"
    assert {row.id: row.kernels_needed for row in status.actors} == {"a-0": 31, "a": 0}
    monkeypatch.setattr("lndrl.kernels.in_progress", lambda: (3, 9))
    said = parse_status(snapshot(run.learner)).verdict
    assert said.startswith("compiling: 3 of 9 kernels are ready in the learner")


def test_the_snapshot_fits_its_schema(start, monkeypatch) -> None:
    monkeypatch.setattr("learner.status._SETTLING", 600.0)
    run = start()
    parse_status(snapshot(run.learner))
    run.update()
    status = parse_status(snapshot(run.learner))
    assert (status.steps, status.updates, status.weights_version) == (32, 1, 1)
    assert status.actors[0].id == "a"
    assert status.actors[0].time_split == status.actor_split == {"infer": 1.0}
    assert status.overhead_learner is not None
    assert status.overhead_actor == 0.0 and 0.0 < status.overhead_learner < 1.0
    assert status.verdict == "learning", "too early to say more"
    run.learner.first_update -= 1000.0
    assert parse_status(snapshot(run.learner)).verdict == "balanced"
    assert len(parse_history(list(run.learner.history))) == 1
    json.dumps(snapshot(run.learner))


def test_the_end_leaves_checkpoint_summary_and_says_done(start) -> None:
    run = start(learner={"total_steps": 64})
    run.update(2)
    assert run.learner.finished
    run.close()
    folder = run.learner.folder.path
    assert (folder / "checkpoints/step-000000064/policy.safetensors").exists()
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["finished"], summary["steps"]) == (True, 64)
    assert run.actor.done()
    assert load_config(folder / "config.yaml") == run.learner.config


def test_resume_continues_counters_sequences_and_metrics(start) -> None:
    run = start(learner={"checkpoint_interval": 2})
    run.update(2)
    run.learner.checkpoint()
    run.update(1)  # lost: no checkpoint after it
    run.learner.close()
    again = start(resume=True)
    learner = again.learner
    assert (learner.counters.steps, learner.counters.version) == (64, 2)
    assert learner.folder.run_id == run.learner.folder.run_id
    rows = read_metrics(learner.folder.path / "metrics.jsonl")
    assert [row["update"] for row in rows] == [1, 2]
    # What the checkpoint contains is a duplicate, what came after it is trained on.
    assert learner.roster.is_known("a", "life-0", 4)
    assert not learner.roster.is_known("a", "life-0", 5)
    again.update()
    assert learner.counters.steps == 96


def test_what_is_handed_on_of_a_training_is_what_the_learner_wrote(start) -> None:
    run = start()
    run.update(2)
    run.learner.checkpoint()
    run.learner.close()
    folder = run.learner.folder.path
    again = start(resume=True)
    again.update(1)
    again.learner.checkpoint()
    newest = again.learner.folder.checkpoints / checkpoint_name(again.learner.counters.steps)
    policy = hashlib.sha256((newest / "policy.safetensors").read_bytes()).hexdigest()[:16]
    found = training_of(folder, policy)
    assert found is not None and found.run == folder.name
    assert found.machine == machine_with(again.learner.ppo.device)
    assert found.steps == found.tested == again.learner.counters.steps
    assert len(found.rows) == 3 and 0.0 <= found.seconds <= again.learner.elapsed + 0.05


def test_an_existing_folder_is_refused_and_left_alone(start) -> None:
    run = start()
    run.update()
    before = (run.learner.folder.path / "metrics.jsonl").read_text()
    with pytest.raises(UserError, match="exists already"):
        start()
    assert (run.learner.folder.path / "metrics.jsonl").read_text() == before


def test_a_device_that_is_not_there_leaves_no_folder(start, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="device cuda:63: "):
        start(learner={"device": "cuda:63"})
    assert not (tmp_path / "run").exists()


def test_run_stops_when_asked(tmp_path: Path) -> None:
    learner = Learner(small_config(), tmp_path / "run", MemoryNetwork().learner(), quiet=True)
    stop = threading.Event()
    stop.set()
    learner.run(stop)
    learner.close()
    assert learner.counters.steps == 0
    assert "stopped at step 0" in learner.folder.events.read_text()


def test_a_full_disk_does_not_stop_training(start, monkeypatch) -> None:
    run = start(learner={"checkpoint_interval": 1})

    def refuse(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("learner.learner.save_checkpoint", refuse)
    run.update(2)
    assert any(event["kind"] == "disk" for event in run.learner.events.recent())


def test_lockstep_waits_for_every_actor(start) -> None:
    run = start(learner={"mode": "lockstep"}, actor={"count": 1})
    run.send()
    assert run.learner.advance(timeout=0.0)
    assert run.learner.counters.steps == 16


def test_a_learner_that_dies_before_its_first_update_can_be_resumed(start) -> None:
    run = start()
    run.learner.close()
    again = start(resume=True)
    assert again.learner.counters.steps == 0
    assert again.welcome.run_id == run.welcome.run_id


def test_a_run_that_starts_from_another_counts_its_own_steps(start, tmp_path: Path) -> None:
    run = start()
    run.update(2)
    run.learner.checkpoint()
    config = small_config(learner={"start": str(run.learner.folder.path)})
    learner = Learner(config, tmp_path / "next", MemoryNetwork().learner(), quiet=True)
    learner.close()
    assert learner.counters.steps == 0
    assert "from the networks of" in learner.folder.events.read_text()
    pairs = zip(learner.ppo.policy.parameters(), run.learner.ppo.policy.parameters(), strict=True)
    assert all(bool((one == other).all()) for one, other in pairs)
    with pytest.raises(UserError, match="holds no checkpoint"):
        Learner(
            small_config(learner={"start": str(tmp_path / "none")}),
            tmp_path / "third",
            MemoryNetwork().learner(),
        )
    assert not (tmp_path / "third").exists()


def test_actors_get_the_average_where_they_shall_act_on_it(start) -> None:
    run = start(learner={"average": 0.9, "acting": "average"})
    run.update(3)
    version, blob = run.actor.fetch(None, 5.0)
    assert version == 3
    sent, ppo = load_tensors(blob), run.learner.ppo
    for name, weights in ppo.average.network.state_dict().items():
        assert bool((sent[name] == weights).all())
        assert not bool((sent[name] == ppo.policy.state_dict()[name]).all())


def test_a_batch_that_grows_finds_room_and_trains_in_more_minibatches(start) -> None:
    """Chunks of 16 samples: 2, then 4, then 8 make a batch; the queue's 2 grow with it."""
    grows = {"batch_size": 32, "batch_size_final": 128, "minibatch_size": 16}
    impatient = {"upload_timeout": 0.1}
    few = {"total_steps": 384, "queue_chunks": 2}
    run = start(ppo=grows, learner=few, transport=impatient)
    steps = [0]
    for _ in range(384 // 16):
        run.send()
        if run.learner.advance(timeout=0.0):
            steps.append(run.learner.counters.steps)
    assert run.learner.finished and run.learner.ingest.answers["pause"] == 0
    assert np.diff(steps).tolist() == [32, 32, 32, 32, 64, 64, 128]
    optimizer = run.learner.ppo.policy_optimizer
    taken = {float(state["step"]) for state in optimizer.state.values()}
    assert taken == {2 * 384 / 16}, "epochs times minibatches"


def test_a_run_that_goes_on_goes_on_with_the_batch_that_it_had(start) -> None:
    grows = {"batch_size": 32, "batch_size_final": 128}
    run = start(ppo=grows, learner={"total_steps": 300})
    while run.learner.counters.steps < 128:
        run.send()
        run.learner.advance(timeout=0.0)
    run.close()
    again = start(resume=True, ppo=grows, learner={"total_steps": 300})
    for _ in range(3):
        again.send()
        assert not again.learner.advance(timeout=0.0)
    again.send()
    assert again.learner.advance(timeout=0.0)
    assert again.learner.counters.steps == 192
