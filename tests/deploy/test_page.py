"""deploy/README.md: who follows it has a learner on one host and actors on two others.

Three of its commands, the actors' twice, and a copy of three files: each on a host of its own.
"""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from lndrl.chaos.hosts import Hosts, missing
from lndrl.chaos.ledger import lines_of, parse
from lndrl.chaos.stage import CONFIG
from lndrl.evaluation.sweep.processes import this_program

PAGE = (Path(__file__).resolve().parents[2] / "deploy/README.md").read_text()
PATIENCE = 300.0  # s, for machines with much else to do
WHY_NOT = missing()


def command(name: str) -> str:
    """The page's first command line of that name."""
    found = re.search(rf"^    (.*\.venv/bin/lndrl {name} .*)$", PAGE, re.MULTILINE)
    assert found is not None
    return found[1]


def changed(line: str, *changes: tuple[str, str]) -> list[str]:
    """``line`` for a shell, with what a reader fills in; each must stand there."""
    for old, new in changes:
        assert old in line, (old, line)
        line = line.replace(old, new)
    return ["sh", "-c", f"exec env {line}" if "=" in line.split()[0] else f"exec {line}"]


@pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT or "there are hosts")
def test_the_page_leads_to_actors_on_two_hosts(tmp_path: Path) -> None:
    places = {name: tmp_path / name for name in ("learner", "one", "two")}
    for place in places.values():
        (place / ".venv/bin").mkdir(parents=True)
        program = place / ".venv/bin/lndrl"
        program.write_text(f'#!/bin/sh\nexec {sys.executable} -m lndrl "$@"\n')
        program.chmod(0o755)
    (places["learner"] / "small.yaml").write_text(yaml.safe_dump(CONFIG))
    ledger = places["learner"] / "runs/first/ledger.jsonl"
    with Hosts() as hosts:
        for name in places:
            hosts.add(name)
        hosts.join("learner", "192.0.2.1/24", "one", "192.0.2.2/24")
        hosts.join("learner", "198.51.100.1/24", "two", "198.51.100.2/24")

        def start(host: str, words: list[str]) -> subprocess.Popen[bytes]:
            with (places[host] / "log").open("ab") as log:
                return hosts.start(
                    host, words, cwd=places[host], env=this_program(),
                    stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                )  # fmt: skip

        addresses = ("learner.example 10.0.0.5", "192.0.2.1 198.51.100.1")
        made = start("learner", changed(command("certs"), addresses))
        assert made.wait(PATIENCE) == 0
        for name in ("one", "two"):
            (places[name] / "certs").mkdir()
            for file in ("ca.pem", "actor.pem", "actor.key"):
                shutil.copy(places["learner"] / "certs" / file, places[name] / "certs")
        serve = changed(command("learner"), ("learner lndrl ", "learner small.yaml "))
        processes = [start("learner", serve)]
        try:
            said = places["learner"] / "log"
            wait(lambda: "[listen]" in said.read_text(), processes, places)
            for name, address in (("one", "192.0.2.1"), ("two", "198.51.100.1")):
                act = changed(command("actor"), ("LEARNER", address), ("--count 8", "--count 1"))
                processes.append(start(name, act))
            wait(lambda: len(senders(ledger)) == 2, processes, places)
        finally:
            for process in reversed(processes):
                process.send_signal(signal.SIGINT)
                try:
                    process.wait(60.0)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()


def senders(ledger: Path) -> set[str]:
    entries = filter(None, map(parse, lines_of(ledger)))
    return {entry["actor"] for entry in entries if entry["kind"] == "accepted"}


def wait(
    done: Callable[[], object], processes: list[subprocess.Popen[bytes]], places: dict[str, Path]
) -> None:
    deadline = time.monotonic() + PATIENCE
    while not done():
        told = {name: (place / "log").read_text() for name, place in places.items() if
                (place / "log").exists()}  # fmt: skip
        assert all(process.poll() is None for process in processes), told
        assert time.monotonic() < deadline, told
        time.sleep(0.2)
