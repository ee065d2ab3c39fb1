"""What operators ask of a run, over the transport, and what is left of it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from learner.run.events import EventLog
from learner.run.orders import Orders
from lndrl.errors import UserError
from lndrl.transport import open_viewer
from lndrl.transport.messages import MessageError, Refusal, encode
from lndrl.transport.operation import Granted, Request, answer, sentence_of
from lndrl.transport.wire import DEFAULT_LIMITS
from tests.learner.helpers_learner import small_config
from tests.learner.test_learner import Run
from tests.lndrl.transport.security.sites import Site


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_a_checkpoint_and_a_stop_are_done_between_updates(tmp_path: Path) -> None:
    config = small_config(learner={"checkpoint_interval": 1000})
    run = Run(config, tmp_path / "run")
    learner, viewer = run.learner, run.actor._network.viewer()
    run.update()
    stop = threading.Event()
    assert "has not begun" in viewer.request("stop", learner.folder.run_id)
    thread = threading.Thread(target=_go_on, args=(learner, stop))
    thread.start()
    try:
        said = wait_granted(lambda: viewer.request("checkpoint", learner.folder.run_id))
        assert said == "a checkpoint follows the update at work"
        wait_until(lambda: "step-000000032" in str(learner.last_checkpoint))
        assert "another run" in viewer.request("stop", "other")
        assert not stop.is_set()
        said = viewer.request("stop", learner.folder.run_id)
        assert said.startswith("the run stops") and stop.is_set()
    finally:
        stop.set()
        thread.join()
    assert "ending already" in viewer.request("stop", learner.folder.run_id)
    log = learner.folder.events.read_text()
    assert log.count(" operator ") == 5 and log.count(": granted, ") >= 2
    assert "this process asks for a checkpoint: granted" in log
    learner.close()
    again = Run(config, tmp_path / "run", resume=True)
    assert again.learner.counters.steps == 32
    again.close()


def _go_on(learner, stop: threading.Event) -> None:
    """What ``Learner.run`` does, of a learner that has begun already."""
    learner.begin, begin = lambda: None, learner.begin
    try:
        learner.run(stop)
    finally:
        learner.begin = begin


def wait_granted(ask: Callable[[], str]) -> str:
    """What the learner says once its loop has begun."""
    deadline = time.monotonic() + 60.0
    while (said := ask()).startswith("refused"):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return said


def test_each_request_is_an_event_even_when_refused(tmp_path: Path) -> None:
    events = EventLog(tmp_path / "events.log", quiet=True)
    orders, stop = Orders("r1", events), threading.Event()
    orders.heed(stop)
    assert isinstance(orders.on_request(Request("stop", "r2", "eve")), Refusal)
    assert not stop.is_set()
    assert isinstance(orders.on_request(Request("checkpoint", "r1", "ann")), Granted)
    assert orders.checkpoint_due() and not orders.checkpoint_due()
    assert isinstance(orders.on_request(Request("stop", "r1", "ann")), Granted)
    assert isinstance(orders.on_request(Request("stop", "r1", "ann")), Refusal)
    events.close()
    lines = (tmp_path / "events.log").read_text().splitlines()
    assert len(lines) == 4 and all(" operator " in line for line in lines)
    assert "eve asks for a stop: refused, another run" in lines[0]


def test_nonsense_is_refused_in_words() -> None:
    for data in (b"", b"\xff" * 9, encode(Refusal("x"))):
        said = sentence_of(answer(data, Orders("r", EventLog(None, True)), DEFAULT_LIMITS))
        assert said.startswith("refused: the learner") and "same lndrl version" in said
    with pytest.raises(MessageError, match="action must be one of checkpoint, stop"):
        Request("halt", "r", "s")
    request = encode(Request("stop", "r", "s"))
    assert "takes no requests" in sentence_of(answer(request, None, DEFAULT_LIMITS))


@pytest.mark.parametrize("kind", ["tls", "users", "open"])
def test_operators_are_let_in_and_viewers_refused(kind: str, tmp_path: Path) -> None:
    site = Site(kind, tmp_path)
    try:
        site.learner().publish_status({"run_id": "run-1"}, [])
        dashboard = open_viewer(site.config.endpoint, site.config, site.security("dashboard"))
        operator = open_viewer(site.config.endpoint, site.config, site.security("operator"))
        site.open += [dashboard, operator]
        assert dashboard.status(30.0) and operator.status(30.0)
        assert operator.request("stop", "run-1", 30.0) == "a stop it is"
        if kind == "open":
            assert dashboard.request("checkpoint", "run-1", 30.0) == "a checkpoint it is"
        else:
            with pytest.raises(UserError, match="the role dashboard may only look; a stop takes"):
                dashboard.request("stop", "run-1", 1.0)
            assert len(site.handlers.requests) == 1
    finally:
        site.close()
