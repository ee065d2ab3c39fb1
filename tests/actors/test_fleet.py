"""Spawned workers against a learner on a real Zenoh loopback."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from actors.fleet import Fleet, run_fleet
from lndrl.transport import Hello, Security, free_endpoint, open_learner
from tests.lndrl.transport.security.authority import make_certificates

PATIENCE = 600.0  # s, for machines with much else to do


def wait_for(condition: Callable[[], object], what: str) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, f"waited in vain for {what}"
        time.sleep(0.05)


def gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    with open(f"/proc/{pid}/stat") as stat:
        return stat.read().rsplit(")", 1)[1].split()[0] == "Z"


@pytest.fixture
def learner(small_config, noting_learner):
    """A learner on a loopback port of its own, weights version 0 out."""
    endpoint = free_endpoint()
    config = small_config(
        transport={"endpoint": endpoint},
        learner={"validation_episodes": 1, "validation_share": 1.0},
        task={"time_limit": 2.0},
    )
    learner = noting_learner(config, open_learner(config.transport, "run-1"))
    learner.publish(0)
    return learner


def test_a_killed_evaluator_is_replaced_until_the_run_is_done(learner):
    lines: list[str] = []
    endpoint = learner.config.transport.endpoint
    fleet = Fleet(endpoint, 1, log=lines.append, role="evaluator")
    fleet.start()
    try:
        wait_for(lambda: fleet.poll() is not None or learner.results, "the first result")
        assert not fleet.error
        (first,) = fleet.pids()
        os.kill(first, signal.SIGKILL)
        before = len(learner.results)
        wait_for(
            lambda: fleet.poll() is not None or len(learner.results) > before + 1,
            "a result of the replacement",
        )
        assert len({result.incarnation for result in learner.results}) == 2
        assert {result.evaluator_id for result in learner.results} == {fleet._slots[0].actor_id}
        assert not learner.headers and not learner.members, "it is no actor"
        learner.endpoint.finish()
        wait_for(lambda: fleet.poll() is not None, "the end")
        assert fleet.poll() == 0
    finally:
        fleet.stop()
    text = "\n".join(lines)
    assert "evaluator 0 was killed by SIGKILL" in text and "evaluator 0 done" in text


def test_an_evaluator_that_is_refused_says_why(learner):
    learner.refusal = "this run validates nothing"
    fleet = Fleet(learner.config.transport.endpoint, 1, role="evaluator")
    fleet.start()
    try:
        wait_for(lambda: fleet.poll() is not None, "the refusal")
    finally:
        fleet.stop()
    assert fleet.error.endswith("this run validates nothing")


def test_killed_worker_is_replaced_until_the_run_is_done(learner):
    lines: list[str] = []
    fleet = Fleet(learner.config.transport.endpoint, 1, worlds=1, log=lines.append)
    fleet.start()
    try:
        wait_for(lambda: fleet.poll() is not None or learner.headers, "the first chunk")
        assert not fleet.error
        (first,) = fleet.pids()
        os.kill(first, signal.SIGKILL)
        wait_for(lambda: fleet.poll() is not None or fleet.restarts, "a replacement")
        wait_for(
            lambda: fleet.poll() is not None or len({h.pid for h in learner.headers}) == 2,
            "a chunk of the replacement",
        )
        (second,) = fleet.pids()
        assert second != first and fleet.restarts == 1
        headers = list(learner.headers)  # what the first one sent may come late
        assert {h.pid for h in headers} == {first, second}
        assert {h.worlds for h in headers} == {1}
        assert len({h.actor_id for h in headers}) == 1, "the place keeps its name"
        assert len({h.incarnation for h in headers}) == 2
        replaced = next(h for h in headers if h.pid == second)
        assert replaced.sequence == 1, "numbers begin anew"
        assert any("SIGKILL" in line for line in lines)
        learner.endpoint.finish()
        wait_for(lambda: fleet.poll() is not None, "the end")
        assert fleet.poll() == 0 and fleet.restarts == 1
        # Those that are done leave by themselves: nobody is left to be killed.
        (worker,) = [slot.process for slot in fleet._slots]
        assert worker is not None
        worker.join(PATIENCE)
        assert worker.exitcode == 0
    finally:
        begun = time.monotonic()
        fleet.stop()
    assert time.monotonic() - begun < 30.0
    assert gone(first) and gone(second)
    assert fleet.pids() == []


def test_fleet_grows_and_shrinks_while_it_runs(learner):
    """An actor that comes delivers; one that is taken away leaves no process and no gap."""
    lines: list[str] = []
    fleet = Fleet(learner.config.transport.endpoint, 1, log=lines.append)
    fleet.start()
    try:
        assert not fleet.settled() and fleet.shrink() is None
        wait_for(lambda: fleet.poll() is not None or fleet.settled(), "the first actor")
        (first,) = fleet.pids()
        added = fleet.grow()
        assert len(fleet) == 2 and not fleet.settled()
        wait_for(
            lambda: fleet.poll() is not None or added in {h.actor_id for h in learner.headers},
            "a chunk of the second actor",
        )
        assert fleet.settled()
        second = fleet.pids()[-1]
        assert fleet.shrink() == added
        assert len(fleet) == 1 and not fleet.settled()
        # Its place is not given away before it is free.
        other = fleet.grow()
        assert other != added and fleet.shrink() == other
        wait_for(lambda: fleet.poll() is not None or fleet.settled(), "the second actor's end")
        assert gone(second) and fleet.pids() == [first]
        # Of the one that left a window of chunks may still be on its way.
        delivered = len(learner.headers) + learner.config.transport.upload_window
        wait_for(lambda: len(learner.headers) > delivered + 2, "chunks of the one that is left")
        assert {h.pid for h in learner.headers[delivered:]} == {first}
        assert fleet.restarts == 0 and not any("another starts" in line for line in lines)
        assert fleet.grow() == added, "the place is free again"
    finally:
        fleet.stop()
    assert gone(first) and fleet.pids() == []


def test_stopping_includes_those_on_their_way_out(learner):
    fleet = Fleet(learner.config.transport.endpoint, 2, log=lambda line: None)
    fleet.start()
    try:
        wait_for(lambda: fleet.poll() is not None or len(fleet.pids()) == 2, "two workers")
        pids = fleet.pids()
        fleet.shrink()
        assert sorted(fleet.pids()) == sorted(pids)
    finally:
        fleet.stop()
    assert all(gone(pid) for pid in pids)


def test_refused_fleet_says_so_once(learner, capfd):
    learner.refusal = "this learner wants another version"
    assert run_fleet(learner.config.transport.endpoint, 2) == 2
    assert capfd.readouterr().err.count("wants another version") == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_ended_foreground_fleet_leaves_no_process(learner, number):
    """Ctrl-C and a hang-up reach the whole group, SIGTERM and SIGKILL only the fleet."""
    program = (
        "from actors.fleet import run_fleet; import sys; "
        f"sys.exit(run_fleet({learner.config.transport.endpoint!r}, 1))"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program], start_new_session=True, stderr=subprocess.PIPE, text=True
    )
    try:
        wait_for(lambda: process.poll() is not None or learner.headers, "the first chunk")
        send = os.killpg if number in (signal.SIGINT, signal.SIGHUP) else os.kill
        send(process.pid, number)
        _, errors = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
    assert process.returncode == (-9 if number == signal.SIGKILL else 0), errors
    assert "Traceback" not in errors
    wait_for(lambda: gone(learner.headers[-1].pid), "the worker's end")


def test_workers_log_in_without_showing_the_password(
    small_config, noting_learner, tmp_path, capfd
) -> None:
    """Certificates, user and namespace reach the process that opens the connection."""
    certificates = make_certificates(tmp_path / "certs")
    users = tmp_path / "users"
    users.touch(0o600)
    users.write_text("actor-here:walks-on-water\n")
    endpoint = free_endpoint().replace("tcp", "tls")
    config = small_config(transport={"endpoint": endpoint, "namespace": "lab/one"})
    guard = Security("learner", certificates, users=users)
    learner = noting_learner(config, open_learner(config.transport, "run-1", guard))
    learner.refusal = "this learner wants another version"
    fleet = Fleet(endpoint, 1, security=guard.of_local("actor"), namespace="lab/one")
    fleet.start()
    try:
        (worker,) = fleet.pids()
        for place in ("cmdline", "environ"):
            assert "walks-on-water" not in Path(f"/proc/{worker}/{place}").read_text()
        wait_for(lambda: fleet.poll() is not None, "the refusal")
    finally:
        fleet.stop()
    assert "wants another version" in fleet.error
    assert "walks-on-water" not in "".join(capfd.readouterr())


@pytest.mark.parametrize("host", ["a" * 64, "-robot_7.lab", "...", "ü" * 63])
def test_a_host_of_any_name_gives_names_that_learners_take(host, monkeypatch):
    monkeypatch.setattr("actors.fleet.socket.gethostname", lambda: host)
    fleet = Fleet("tcp/127.0.0.1:7447", 1)
    Hello(fleet._slots[0].actor_id, "life", host, 1, 1, "0")
