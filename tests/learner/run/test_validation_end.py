"""The end of a run, which waits for what its last weights are worth."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Thread

from lndrl.transport import NO_WEIGHTS
from tests.learner.run.helpers_validation import HELLO, Trained


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
