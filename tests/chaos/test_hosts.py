"""Hosts in namespaces: long wires, and a training behind NAT whose link is cut and healed.

``LNDRL_CUT`` says for how many seconds; 20 where somebody has the time.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from lndrl.chaos.hosts import Hosts, missing
from lndrl.chaos.ledger import ActorBook, LearnerBook, balance, files_of, lines_of, parse
from lndrl.chaos.stage import CONFIG
from lndrl.errors import UserError
from lndrl.evaluation.sweep.processes import this_program

CUT = float(os.environ.get("LNDRL_CUT", "4"))
PATIENCE = 600.0  # s, for machines with much else to do
WHY_NOT = missing(nat=True)
needs_hosts = pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT or "there are hosts")

ECHO = """
import socket, sys
server = socket.create_server(("0.0.0.0", 5000))
print("up", flush=True)
peer, (address, _) = server.accept()
print(address, flush=True)
while data := peer.recv(65536):
    peer.sendall(data)
"""
ASK = """
import socket, sys, time
peer = socket.create_connection((sys.argv[1], 5000), 30.0)
peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
for _ in range(5):
    began = time.monotonic()
    peer.sendall(b"x" * 100)
    assert peer.recv(100)
    print(time.monotonic() - began, flush=True)
"""


def site(hosts: Hosts) -> None:
    """A learner here, and behind a long wire a gateway that does NAT for the actors' network."""
    for name in ("learner", "gateway", "actors"):
        hosts.add(name)
    hosts.join("gateway", "10.77.0.1/24", "actors", "10.77.0.2/24")
    hosts.route("actors", by="10.77.0.1")
    hosts.forward("gateway", hide="10.77.0.0/24")


@needs_hosts
def test_a_wire_is_as_long_as_it_should_be_and_nat_hides_who_asks() -> None:
    with Hosts() as hosts:
        site(hosts)
        hosts.wire("learner", "192.0.2.1/24", "gateway", "192.0.2.2/24", delay=0.03)
        server = hosts.start(
            "learner", [sys.executable, "-c", ECHO], stdout=subprocess.PIPE, text=True
        )
        assert server.stdout is not None and server.stdout.readline() == "up\n"
        rounds = hosts.run("actors", [sys.executable, "-c", ASK, "192.0.2.1"], timeout=PATIENCE)
        assert server.stdout.readline() == "192.0.2.2\n"
        server.communicate(timeout=PATIENCE)
    seconds = [float(line) for line in rounds.split()]
    assert len(seconds) == 5 and min(seconds) >= 0.06


@needs_hosts
def test_two_hosts_of_one_name_are_refused_and_none_is_left() -> None:
    with Hosts() as hosts:
        hosts.add("learner")
        with pytest.raises(UserError, match="ip netns add"):
            hosts.add("learner")
    left = subprocess.run(["ip", "netns", "list"], capture_output=True, text=True).stdout
    assert hosts.namespace("learner") not in left


@needs_hosts
def test_a_cut_link_loses_nothing(tmp_path: Path) -> None:
    (tmp_path / "run.yaml").write_text(yaml.safe_dump(CONFIG), encoding="utf-8")
    book, ledger = tmp_path / "actors.jsonl", tmp_path / "runs/far/ledger.jsonl"
    with Hosts() as hosts:
        site(hosts)
        link = hosts.wire(
            "learner", "192.0.2.1/24", "gateway", "192.0.2.2/24", delay=0.01, loss=0.001, seed=1
        )
        endpoint = "tcp/192.0.2.1:7447"
        serve = "learner run.yaml --run far --insecure --listen".split()
        learner = start(hosts, "learner", tmp_path, *serve, endpoint)
        wait(lambda: "[listen]" in (tmp_path / "learner.log").read_text(), learner)
        act = "actor --count 1 --connect".split()
        actors = start(hosts, "actors", tmp_path, *act, endpoint, "--ledger", str(book))
        try:
            wait(lambda: trained(ledger) > 0, learner, actors)
            link.cut()
            time.sleep(CUT)
            before = trained(ledger)
            link.heal()
            wait(
                lambda: trained(ledger) > before + 3 * CONFIG["ppo"]["batch_size"], learner, actors
            )
        finally:
            end(actors)
            end(learner)
    both = balance(
        LearnerBook().read(lines_of(*files_of(ledger))), ActorBook().read(lines_of(book))
    )
    assert (both.lost, both.duplicated, both.contradictions) == (0, 0, 0), both.examples
    assert both.acknowledged > before
    assert both.acknowledged == both.trained + both.dropped


def start(hosts: Hosts, host: str, folder: Path, *words: str) -> subprocess.Popen[bytes]:
    with (folder / f"{words[0]}.log").open("wb") as log:
        return hosts.start(
            host,
            [sys.executable, "-m", "lndrl", *words],
            cwd=folder,
            env=this_program() | {"OMP_NUM_THREADS": "1"},
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
        )


def trained(ledger: Path) -> int:
    entries = filter(None, map(parse, lines_of(ledger)))
    return sum(int(entry["samples"]) for entry in entries if entry["kind"] == "trained")


def wait(done: Callable[[], bool], *processes: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not done():
        assert all(process.poll() is None for process in processes)
        assert time.monotonic() < deadline
        time.sleep(0.1)


def end(process: subprocess.Popen[bytes]) -> None:
    process.send_signal(signal.SIGINT)
    try:
        process.wait(60.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def test_without_permission_one_sentence_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    assert "needs" in missing() or "need" in missing()
    with pytest.raises(UserError, match="network namespaces need iproute2"), Hosts():
        pass
