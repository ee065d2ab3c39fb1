"""``lndrl up`` and ``lndrl down`` against a real sshd on loopback; learner and actors are real."""

from __future__ import annotations

import getpass
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import asyncssh
import pytest
import yaml

from lndrl.chaos.ledger import lines_of, parse
from lndrl.chaos.stage import CONFIG
from lndrl.evaluation.sweep.processes import this_program
from lndrl.machine.ports import free_port
from lndrl.machine.processes import lives

PATIENCE = 300.0  # s, for machines with much else to do
SSHD = shutil.which("sshd", path="/usr/sbin:/usr/local/sbin:" + os.environ.get("PATH", ""))
needs_sshd = pytest.mark.skipif(
    SSHD is None, reason="needs sshd, Debian's openssh-server, which is not installed"
)


class Place:
    """An sshd for this user, and a folder that plays the other host."""

    def __init__(self, home: Path) -> None:
        self.home, self.far, self.port = home, home / "far", free_port()
        (home / ".ssh").mkdir(mode=0o700)
        self.far.mkdir()
        host, user = (asyncssh.generate_private_key("ssh-ed25519") for _ in range(2))
        host.write_private_key(home / "host_key")
        user.write_private_key(home / ".ssh/id_ed25519")
        (home / "authorized").write_bytes(user.export_public_key())
        for key in (home / "host_key", home / ".ssh/id_ed25519", home / "authorized"):
            key.chmod(0o600)
        known = host.export_public_key().decode()
        (home / ".ssh/known_hosts").write_text(f"[127.0.0.1]:{self.port} {known}")
        settings = {
            "Port": self.port,
            "ListenAddress": "127.0.0.1",
            "HostKey": home / "host_key",
            "AuthorizedKeysFile": home / "authorized",
            "PidFile": home / "sshd.pid",
            "StrictModes": "no",
            "PasswordAuthentication": "no",
            "UsePAM": "no",
            "Subsystem": "sftp internal-sftp",
        }
        (home / "sshd_config").write_text("".join(f"{k} {v}\n" for k, v in settings.items()))
        if os.geteuid() == 0:
            Path("/run/sshd").mkdir(exist_ok=True)
        assert SSHD is not None
        command = [SSHD, "-D", "-e", "-f", str(home / "sshd_config")]
        with (home / "sshd.log").open("wb") as log:
            self.sshd = subprocess.Popen(command, stdout=log, stderr=log)
        wait(lambda: not socket.socket().connect_ex(("127.0.0.1", self.port)), "sshd")
        self.program()

    def program(self, version: str = "") -> None:
        """lndrl as it is installed on that host; ``version``: one that says it is another."""
        environment = this_program()
        paths = "\n".join(f"export {n}={environment[n]}" for n in ("PYTHONPATH", "PYTHONSAFEPATH"))
        say = f'[ "$1" = --version ] && echo {version} && exit\n' if version else ""
        script = self.far / "lndrl"
        script.write_text(f'#!/bin/sh\n{paths}\n{say}exec {sys.executable} -m lndrl "$@"\n')
        script.chmod(0o755)

    def cluster(self, **changes: Any) -> Path:
        (self.home / "small.yaml").write_text(yaml.safe_dump(CONFIG))
        here = {"user": getpass.getuser(), "port": self.port, "folder": str(self.far)}
        here |= {"host": "127.0.0.1", "program": "./lndrl"}
        data = {
            "run": "first",
            "configuration": "small.yaml",
            "learner": {**here, "listen": free_port()},
            "actors": [{**here, "count": 1}],
        }
        path = self.home / "cluster.yaml"
        for key, value in changes.items():
            data[key] = value(data[key]) if callable(value) else value
        path.write_text(yaml.safe_dump(data))
        return path

    def lndrl(self, *words: str) -> subprocess.Popen[str]:
        with (self.home / f"{words[0]}.log").open("w") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "lndrl", *words],
                cwd=self.home,
                env=this_program() | {"HOME": str(self.home)},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                text=True,
            )

    def said(self, command: str = "up") -> str:
        return (self.home / f"{command}.log").read_text()

    def refused(self) -> str:
        """What an ``up`` says that fails."""
        process = self.lndrl("up", "cluster.yaml")
        assert process.wait(PATIENCE) == 2, self.said()
        return self.said()

    def pids(self) -> list[int]:
        return [int(file.read_text()) for file in (self.far / ".lndrl/first").glob("*.pid")]

    def trained(self) -> bool:
        entries = map(parse, lines_of(self.far / "runs/first/ledger.jsonl"))
        return any(entry is not None and entry["kind"] == "trained" for entry in entries)

    def close(self) -> None:
        for pid in self.pids():
            try:
                os.killpg(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        self.sshd.terminate()
        self.sshd.wait(10.0)


def wait(done: Callable[[], object], what: str) -> None:
    deadline = time.monotonic() + PATIENCE
    while not done():
        assert time.monotonic() < deadline, what
        time.sleep(0.1)


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    made = Place(tmp_path)
    yield made
    made.close()


@needs_sshd
def test_a_run_is_started_watched_and_ended_together(place: Place) -> None:
    place.cluster()
    process = place.lndrl("up", "cluster.yaml")
    try:
        wait(lambda: "everything runs" in place.said() or process.poll() is not None, "up")
        assert process.poll() is None, place.said()
        assert "2 process groups on 1 host" in place.said()
        wait(place.trained, "an update")
        # Keys are for their owner, and no host has more than its roles need.
        certs = place.far / ".lndrl/first/certs"
        assert {f.name for f in certs.iterdir()} == {
            *("ca.pem", "learner.pem", "learner.key", "actor.pem", "actor.key")
        }
        assert all(f.stat().st_mode & 0o077 == 0 for f in certs.glob("*.key"))
        assert len(pids := place.pids()) == 2 and all(map(lives, pids))
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 130, place.said()
    finally:
        process.kill()
    assert not any(map(lives, pids)), place.said()
    assert (place.far / "runs/first/summary.json").exists()
    assert "learner ended" in place.said() and "actors-0 ended" in place.said()


@needs_sshd
def test_what_is_wrong_names_the_host_and_leaves_nothing(place: Place) -> None:
    place.cluster(actors=lambda rows: [{**rows[0], "program": "./missing"}])
    said = place.refused()
    assert "host 127.0.0.1: " in said and "./missing does not start" in said
    place.cluster(actors=lambda rows: [{**rows[0], "port": free_port()}])
    assert "host 127.0.0.1: cannot be reached by ssh" in place.refused()
    place.program(version="0.0.1")
    place.cluster()
    assert "host 127.0.0.1: has lndrl 0.0.1, here is" in place.refused()
    place.program()
    place.cluster(learner=lambda row: {**row, "address": "10.1.2.3"})
    said = place.refused()
    assert "learner.pem: is not made for 10.1.2.3; lndrl certs --out" in said
    assert place.pids() == [] and not (place.far / "runs").exists()
    assert not any("Traceback" in place.said(word) for word in ("up",))


@needs_sshd
def test_a_port_that_is_taken_is_said_in_the_learners_words(place: Place) -> None:
    with socket.create_server(("0.0.0.0", 0)) as taken:
        port = taken.getsockname()[1]
        place.cluster(learner=lambda row: {**row, "listen": port})
        said = place.refused()
    assert "host 127.0.0.1: the learner ended at once" in said and f"port {port} is in use" in said
    assert not any(map(lives, place.pids()))
    down = place.lndrl("down", "cluster.yaml")
    assert down.wait(PATIENCE) == 0
