"""The whole system as users run it: processes, signals, a real network on loopback."""

from __future__ import annotations

import io
import json
import os
import pty
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import chdir, closing, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from lndrl.chaos.stage import descendants, is_worker, lives
from lndrl.cli.main import run
from lndrl.config import TransportConfig
from lndrl.machine.threads import kept_threads
from lndrl.transport import free_endpoint, open_learner

PATIENCE = 600.0  # s; compiling on a busy machine takes long
LNDRL = [sys.executable, "-m", "lndrl"]
ROOT = Path(__file__).resolve().parent.parent

# Makes standard input the terminal of this process and becomes the program that follows.
IN_TERMINAL = """
import fcntl, os, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
"""

SMALL: dict[str, Any] = {
    "scenario": "hybrid",
    "network": {"map_channels": [4, 4, 8], "features": 16, "goal_features": 8},
    "ppo": {"batch_size": 64, "minibatch_size": 32, "epochs": 1},
    "learner": {"total_steps": 1_000_000, "checkpoint_interval": 2, "threads": 1},
    "actor": {"count": 1, "worlds": 2, "horizon": 16},
    "localization": {"min_particles": 100, "max_particles": 200},
}


class Terminal:
    """A window that a program draws in, until it is closed."""

    def __init__(self) -> None:
        self.descriptor, self.inside = pty.openpty()
        self.text = b""

    def read(self) -> bool:
        """Take in what was drawn, so that the program need not wait; always true."""
        while select.select([self.descriptor], [], [], 0.0)[0]:
            self.text += os.read(self.descriptor, 65536)
        return True

    def close(self) -> None:
        """The user closes it: the program and its shell hear of it."""
        os.close(self.descriptor)


class Desk:
    """Starts ``lndrl`` commands in a folder and ends them all."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.endpoint = free_endpoint()
        self.processes: list[subprocess.Popen[str]] = []
        # A user's own modules of our names must not stand in for ours, in any process.
        for name in ("learner", "actors"):
            (folder / f"{name}.py").write_text("raise SystemExit(f'{__file__} was imported')\n")
        self.environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
        (folder / "small.yaml").write_text(yaml.safe_dump(SMALL))

    def start(self, *arguments: str, before: Sequence[str] = ()) -> subprocess.Popen[str]:
        log = (self.folder / f"log-{len(self.processes)}").open("w")
        process = subprocess.Popen(
            [*before, *LNDRL, *arguments],
            cwd=self.folder,
            env=self.environment,
            stdout=log,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.processes.append(process)
        return process

    def start_in_terminal(self, *arguments: str) -> tuple[subprocess.Popen[str], Terminal]:
        """The same in a terminal of its own, which the program is told of when it closes."""
        terminal = Terminal()
        (self.folder / f"log-{len(self.processes)}").write_text("(in a terminal)")
        process = subprocess.Popen(
            [sys.executable, "-c", IN_TERMINAL, *LNDRL[1:], *arguments],
            cwd=self.folder,
            env={**self.environment, "TERM": "xterm"},
            stdin=terminal.inside,
            stdout=terminal.inside,
            stderr=terminal.inside,
            text=True,
            start_new_session=True,
        )
        os.close(terminal.inside)
        self.processes.append(process)
        return process, terminal

    def call(self, *arguments: str) -> tuple[int, str, str]:
        """The same in this process, which has torch already: exit code, output, errors.

        For commands of which no test here asks what becomes of their process.
        """
        out, errors = io.StringIO(), io.StringIO()
        with chdir(self.folder), kept_threads(), redirect_stdout(out), redirect_stderr(errors):
            code = run(list(arguments))
        return code, out.getvalue(), errors.getvalue()

    def log(self, process: subprocess.Popen[str]) -> str:
        return (self.folder / f"log-{self.processes.index(process)}").read_text()

    def rows(self, run: str = "a") -> list[dict[str, Any]]:
        path = self.folder / "runs" / run / "metrics.jsonl"
        text = path.read_text() if path.exists() else ""
        lines = text[: text.rfind("\n") + 1].splitlines()  # the last may be half written
        return [json.loads(line) for line in lines if line.endswith("}")]

    def wait(self, what: str, condition: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            logs = "\n".join(self.log(process)[-600:] for process in self.processes)
            assert time.monotonic() < deadline, f"no {what}; logs:\n{logs}"
            time.sleep(0.1)


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    desk = Desk(tmp_path)
    yield desk
    for process in desk.processes:
        process.kill()
        process.wait()


def test_learner_actor_and_dashboard_survive_a_killed_learner(desk: Desk) -> None:
    listen = ("--listen", desk.endpoint, "--run", "a")
    learner = desk.start("learner", "small.yaml", *listen)
    desk.wait("port", lambda: "[listen]" in desk.log(learner))
    actor = desk.start("actor", "--connect", desk.endpoint)
    desk.wait("updates", lambda: len(desk.rows()) >= 3)

    def state() -> str:
        seen = subprocess.run(
            [*LNDRL, "dashboard", "--connect", desk.endpoint, "--once", "--json"],
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        if seen.returncode:
            return seen.stderr
        return json.loads(seen.stdout)["snapshot"]["actors"][0]["state"]

    # On a busy machine an actor may be slow for a while.
    desk.wait("an active actor", lambda: state() == "active")

    learner.kill()
    learner.wait()
    desk.wait("checkpoint", lambda: any(desk.folder.glob("runs/a/checkpoints/step-*")))
    kept = max(int(p.name[5:]) for p in desk.folder.glob("runs/a/checkpoints/step-*"))
    again = desk.start("learner", "small.yaml", *listen, "--resume")
    # The killed one may have written two updates after its last checkpoint, never three.
    desk.wait("going on", lambda: desk.rows()[-1]["steps"] >= kept + 192)
    assert actor.poll() is None
    steps = [row["steps"] for row in desk.rows()]  # once: it goes on
    assert steps == [64 * (i + 1) for i in range(len(steps))]

    workers = descendants(actor.pid)
    assert workers
    for process in (actor, again):
        process.send_signal(signal.SIGINT)
        process.wait(timeout=PATIENCE)
    desk.wait("end of the workers", lambda: not any(lives(pid) for pid in workers))
    assert "Traceback" not in desk.log(actor) + desk.log(again)


def test_train_replaces_a_killed_actor_and_ctrl_c_leaves_nothing(desk: Desk) -> None:
    run = desk.start("train", "small.yaml", "--listen", desk.endpoint, "--run", "a")
    desk.wait("updates", lambda: len(desk.rows()) >= 2)
    (worker,) = [pid for pid in descendants(run.pid) if is_worker(pid)]
    os.kill(worker, signal.SIGKILL)
    count = len(desk.rows())
    desk.wait("another actor", lambda: len(desk.rows()) >= count + 4)
    family = descendants(run.pid)
    run.send_signal(signal.SIGINT)
    assert run.wait(timeout=PATIENCE) == 130
    desk.wait("end of the family", lambda: not any(lives(pid) for pid in family))
    steps = desk.rows()[-1]["steps"]
    assert (desk.folder / f"runs/a/checkpoints/step-{steps:09d}").is_dir()
    assert "Traceback" not in desk.log(run)


def test_a_closed_terminal_leaves_a_checkpoint_and_no_process(desk: Desk) -> None:
    """And a run has one learner: a second one is refused while the first is at work."""
    command = ("train", "small.yaml", "--listen", desk.endpoint, "--run", "a")
    run, terminal = desk.start_in_terminal(*command)
    desk.wait("updates", lambda: terminal.read() and len(desk.rows()) >= 2)
    code, _, said = desk.call("learner", "--run", "a", "--resume", "--listen", free_endpoint())
    assert code == 2
    (line,) = said.splitlines()
    host = socket.gethostname()
    assert f"runs/a: a learner is still at work there, process {run.pid} on {host} (" in line
    family = descendants(run.pid)
    terminal.close()
    assert run.wait(timeout=PATIENCE) == 129
    desk.wait("end of the family", lambda: not any(lives(pid) for pid in family))
    steps = desk.rows()[-1]["steps"]
    assert (desk.folder / f"runs/a/checkpoints/step-{steps:09d}").is_dir()
    assert "stopped at step" in (desk.folder / "runs/a/events.log").read_text()


def test_nohup_goes_on_without_a_terminal(desk: Desk) -> None:
    run = desk.start("train", "small.yaml", "--serial", "--run", "a", before=["nohup"])
    desk.wait("updates", lambda: len(desk.rows()) >= 1)
    run.send_signal(signal.SIGHUP)
    count = len(desk.rows())
    desk.wait("going on", lambda: len(desk.rows()) >= count + 2)
    run.send_signal(signal.SIGTERM)
    assert run.wait(timeout=PATIENCE) == 143
    log = desk.log(run)
    assert "Traceback" not in log
    assert log.endswith("-m lndrl train small.yaml --serial --run a --resume\n")


def train_serially(desk: Desk, name: str, *options: str, own_process: bool = True) -> None:
    command = ("train", "small.yaml", "--serial", "--steps", "256", "--run", name, *options)
    if own_process:
        process = desk.start(*command)
        assert process.wait(timeout=PATIENCE) == 0, desk.log(process)
    else:
        code, _, errors = desk.call(*command)
        assert code == 0, errors


@pytest.fixture(scope="module")
def serial(tmp_path_factory: pytest.TempPathFactory) -> Desk:
    """Serial runs ``plain`` and ``validated``, and ``again`` in a process that did much before."""
    desk = Desk(tmp_path_factory.mktemp("serial"))
    for name, episodes in (("plain", 0), ("validated", 3)):
        options = ("--set", f"learner.validation_episodes={episodes}", "task.time_limit=10")
        train_serially(desk, name, *options)
        train_serially(desk, f"{name}-again", *options, own_process=False)
    return desk


def test_serial_runs_repeat_byte_for_byte_apart_from_times(serial: Desk) -> None:
    texts = []
    for name in ("plain", "plain-again"):
        rows = serial.rows(name)
        assert len(rows) == 4
        for row in rows:
            del row["time"]
        texts.append("\n".join(json.dumps(row) for row in rows))
    assert texts[0] == texts[1]


def test_serial_validation_repeats_and_changes_nothing_of_training(serial: Desk) -> None:
    runs = ("validated", "validated-again", "plain")
    trained, validated = [], []
    for name in runs:
        rows = serial.rows(name)
        found = [row["validation"] for row in rows if "validation" in row]
        trained.append([{**row, "time": None} for row in rows if "validation" not in row])
        untimed = {"unix": None, "elapsed": None, "seconds": None}
        validated.append([{**row, **untimed} for row in found])
    assert trained[0] == trained[1] == trained[2] and len(trained[0]) == 4
    assert validated[0] == validated[1] and validated[2] == []
    assert [row["version"] for row in validated[0]] == [2, 4], "after every second update"
    checkpoints = [serial.folder / "runs" / name / "checkpoints" for name in runs]
    # The tensors: the library writes the entries of the head's metadata in any order.
    blobs = [(folder / "best/policy.safetensors").read_bytes() for folder in checkpoints[:2]]
    best = [blob[8 + int.from_bytes(blob[:8], "little") :] for blob in blobs]
    assert best[0] == best[1] and not (checkpoints[2] / "best").exists()


def test_training_is_validated_and_what_did_best_is_what_is_tested(desk: Desk) -> None:
    settings = ["learner.validation_episodes=2", "learner.validation_share=1", "task.time_limit=4"]
    training = desk.start(
        "train", "small.yaml", "--run", "a", "--no-dashboard", "--listen", desk.endpoint,
        "--set", *settings,
    )  # fmt: skip
    best = desk.folder / "runs/a/checkpoints/best/validation.json"
    desk.wait("second round", lambda: desk.log(training).count("[validated]") > 1)
    assert "[join] evaluator" in desk.log(training) and best.exists()
    evaluator = max(pid for pid in descendants(training.pid) if is_worker(pid))  # the last to come
    before = desk.log(training).count("[validated]")
    os.kill(evaluator, signal.SIGKILL)
    desk.wait("round of another", lambda: desk.log(training).count("[validated]") > before + 1)
    assert "evaluator 0 was killed by SIGKILL" in desk.log(training)
    training.send_signal(signal.SIGINT)
    assert training.wait(timeout=PATIENCE) == 130, desk.log(training)
    step = json.loads(best.read_text())["steps"]
    for options, expected in (
        ([], f"runs/a: best checkpoint, step {step:,}, "),
        (["--checkpoint", "newest"], "runs/a: newest checkpoint, step "),
    ):
        tested = ["evaluate", "runs/a", "--episodes", "1", "--workers", "0", *options]
        code, out, errors = desk.call(*tested)
        assert code == 0 and expected in out + errors, out + errors


def test_a_busy_port_is_one_sentence_and_leaves_no_folder(desk: Desk) -> None:
    with closing(open_learner(TransportConfig(endpoint=desk.endpoint))):
        second = desk.start("learner", "small.yaml", "--listen", desk.endpoint, "--run", "b")
        assert second.wait(timeout=PATIENCE) == 2
    assert len(desk.log(second).strip().splitlines()) == 1
    assert "in use" in desk.log(second)
    assert not (desk.folder / "runs/b").exists()


def test_a_ros_map_of_a_building_trains(desk: Desk) -> None:
    """A 30 x 20 m map as map_server saves it: a hall, a wall with two doors, four pillars."""
    pixels = np.full((400, 600), 254, np.uint8)  # 0.05 m a pixel, row 0 is the north wall
    pixels[:3], pixels[-3:], pixels[:, :3], pixels[:, -3:] = 0, 0, 0, 0
    pixels[:, 298:302] = 0
    pixels[80:120, 298:302] = pixels[280:320, 298:302] = 254
    for row, column in ((100, 150), (300, 150), (100, 450), (300, 450)):
        pixels[row - 8 : row + 8, column - 8 : column + 8] = 0
    header = b"P5\n600 400\n255\n"
    (desk.folder / "building.pgm").write_bytes(header + pixels.tobytes())
    (desk.folder / "building.yaml").write_text(
        "image: building.pgm\nresolution: 0.05\norigin: [-15.0, -10.0, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    (desk.folder / "place.yaml").write_text("name: place\nkind: map\nmap: building.yaml\n")
    small = {**SMALL, "scenario": "place.yaml"}
    (desk.folder / "small.yaml").write_text(yaml.safe_dump(small))
    training = desk.start("train", "small.yaml", "--serial", "--steps", "1500", "--run", "a")
    desk.wait("1,500 steps", lambda: training.poll() is not None)
    assert training.returncode == 0, desk.log(training)
    rows = desk.rows()
    assert rows[-1]["steps"] >= 1500
    assert list((desk.folder / "runs" / "a" / "checkpoints").iterdir())
