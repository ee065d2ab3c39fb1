"""The end of a run, which waits for what its last weights are worth."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Thread

from learner.status import snapshot
from lndrl.config import RunConfig
from lndrl.policy import read_policy
from lndrl.transport import NO_WEIGHTS
from lndrl.transport.status import parse_status
from lndrl.view.dashboard.verdict import headline
from tests.learner.run.helpers_validation import HELLO, Trained, small


@contextmanager
def finishing(run: Trained, stop: Event) -> Iterator[Thread]:
    """The end of ``run``, which waits for what an evaluator makes of its last weights."""
    at = (run.learner.recorder, run.learner.counters.updates, stop)
    thread = Thread(target=run.validation.finish, args=at)
    thread.start()
    try:
        yield thread
    finally:
        stop.set()
        thread.join(30.0)


def test_a_run_s_end_waits_for_its_last_weights(start) -> None:
    run, stop = start(), Event()
    run.validate(1, 18)
    run.publish(2)
    resting = dataclasses.replace(HELLO, ready=False)
    assert run.ask(resting).version == NO_WEIGHTS
    with finishing(run, stop) as thread:
        tasks = (run.ask(resting) for _ in range(1000) if not stop.wait(0.01))
        task = next(task for task in tasks if task.version != NO_WEIGHTS)
        assert task.version == 2, "at the end nobody rests"
        ack = run.evaluator.report(run.result(task, 20))
        assert ack is not None and ack.status == "accepted"
        thread.join(30.0)
        assert not thread.is_alive() and not stop.is_set()
    assert [row["version"] for row in run.validation.curve] == [1, 2]
    assert run.best() == 2
    assert "waiting for that of the last weights" in run.learner.folder.events.read_text()


def test_a_run_s_end_waits_for_nobody_in_vain(start, monkeypatch) -> None:
    monkeypatch.setattr("learner.run.validation._SILENT", -1.0)
    monkeypatch.setattr("learner.run.validation._GIVEN_UP", -1.0)
    alone, gone, all_known = start("a"), start("b"), start("c")
    alone.publish(1)
    gone.ask()
    gone.publish(1)
    all_known.validate(1, 10)
    for run in (alone, gone, all_known):
        with finishing(run, Event()) as thread:
            thread.join(30.0)
            assert not thread.is_alive()
        assert "waiting" not in run.learner.folder.events.read_text()


def test_a_signal_ends_the_waiting(start) -> None:
    run, stop = start(), Event()
    run.publish(1)
    assert run.ask().version == 1
    with finishing(run, stop) as thread:
        thread.join(0.5)
        assert thread.is_alive()
        stop.set()
        thread.join(30.0)
        assert not thread.is_alive()
    assert run.validation.curve == []


def impatient() -> RunConfig:
    return small(patience=3000)


def stand_still(run: Trained) -> None:
    """Five versions, a thousand steps each, of which the second has the most arrivals."""
    for version, arrived in enumerate((10, 18, 10, 10), 1):
        run.validate(version, arrived)
        assert not run.learner.finished
    run.validate(5, 8)


def test_a_run_is_finished_where_arrivals_no_longer_rise(start) -> None:
    run = start(config=impatient())
    stand_still(run)
    assert run.learner.finished and run.learner.counters.steps < 10_000
    status = parse_status(snapshot(run.learner))
    run.validate(6, 18)  # what was under way
    assert run.learner.finished, "what comes later does not undo it"
    run.learner.end()
    why = "validated arrivals have not risen from step 2,000 to 5,000"
    said = run.learner.folder.events.read_text()
    assert f" end        finished at step 6,000: {why}, the most are 0.700 at step 2,000 (" in said
    summary = json.loads((run.learner.folder.path / "summary.json").read_text())
    assert summary["finished"] and summary["early"].startswith(why)
    assert f"{why}, " in str(run.learner.summary())
    assert "to train on: --resume --set learner.patience=0" in str(run.learner.summary())
    assert status.state == "done" and headline(status).word == "done"
    assert headline(status).sentence.startswith(why)
    assert read_policy(run.learner.folder.path).origin.startswith("best checkpoint, step ")


def test_a_run_that_has_its_steps_ended_for_no_other_reason(start) -> None:
    run = start(config=small(patience=3000, total_steps=5000))
    stand_still(run)
    assert run.learner.finished and run.learner.early == ""
    assert snapshot(run.learner)["verdict"] == "done"


def test_patience_goes_on_where_a_run_was_stopped(start) -> None:
    run = start(config=impatient())
    for version, arrived in enumerate((10, 18, 10, 10), 1):
        run.validate(version, arrived)
    run.learner.end()
    run.learner.close()
    again = start(resume=True, config=impatient())
    assert not again.learner.finished
    again.validate(5, 8)
    assert again.learner.finished
    again.learner.end()
    again.learner.close()
    third = start(resume=True, config=impatient())
    assert third.learner.finished, "at once: the curve is kept"
    third.learner.close()
    for patience in (0, 4000):
        on = start(resume=True, config=small(patience=patience))
        assert not on.learner.finished
        on.learner.close()


def test_who_goes_back_before_it_trains_on(start) -> None:
    run = start(config=impatient())
    run.validate(1, 18)
    run.learner.checkpoint()
    for version in (2, 3, 4):
        run.validate(version, 10)
    assert run.learner.finished
    run.learner.end()
    run.learner.close()
    again = start(resume=True, checkpoint="step-000001000", config=impatient())
    assert not again.learner.finished
