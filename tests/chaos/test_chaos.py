"""A short chaos run, and a short fuzz, with real processes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lndrl.chaos import fuzz, monitor, stage
from lndrl.chaos.fuzz import run_fuzz
from lndrl.chaos.run import ChaosOptions, run_chaos
from lndrl.chaos.stage import descendants, lives
from lndrl.cli.main import run

ROOT = Path(__file__).resolve().parents[2]
PATIENCE = 900.0
KINDS = {"actor_kill", "actor_freeze", "learner_kill", "proxy_cut", "proxy_stall", "proxy_delay"}


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who is asked to leave writes down what became of his samples, however slow the machine."""
    monkeypatch.setattr(stage, "LEAVE_WITHIN", 120.0)


def test_nothing_is_lost_in_a_short_chaos(tmp_path: Path) -> None:
    # As dense as two learner kills, two of an actor, a freeze and a cut can follow each other.
    options = ChaosOptions(minutes=0.4, seed=2, actors=1, pace=1.5, kinds=KINDS)
    report = run_chaos(options, tmp_path)
    found = report.to_dict()
    assert found["learner_deaths"] == []
    assert (found["lost"], found["duplicated"], found["contradictions"]) == (0, 0, 0), found
    assert found["acknowledged"] == found["trained"] + found["dropped"]
    assert found["trained"] > 0
    assert found["faults_by_kind"]["learner_kill"] >= 1
    assert found["resumes"] == found["faults_by_kind"]["learner_kill"]
    assert len(found["recovery_seconds"]) >= 1
    assert sum(found["messages_misused"].values()) > 0
    assert found["orphans"] == 0
    assert report.good
    json.dumps(found)


def test_a_learner_survives_malformed_messages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(monitor, "WARM_UP", 0.0)
    monkeypatch.setattr(monitor, "LIFE_LEAST", 1.0)
    monkeypatch.setattr(fuzz, "CALM", (2.0, 2.5))
    report = run_fuzz(240, 1, 400.0, tmp_path)  # sent at the lowest priority: slow among tests
    found = report.to_dict()
    assert found["crashes"] == 0, found
    assert found["messages"] == 240
    assert found["refused"] > 120
    assert found["taken_wrongly"] == 0, found
    assert {"upload", "hello", "weights", "status", "actors"} <= set(found["messages_by_kind"])
    assert abs(found["memory_growth"]) < 1.0
    assert all(megabytes > 50.0 for megabytes in found["memory_megabytes_by_fifth"])


def test_ctrl_c_leaves_no_process(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "lndrl", "chaos", "--minutes", "5", "--folder", "here"]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    with (tmp_path / "log").open("w") as log:
        process = subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=log)
    try:
        deadline = time.monotonic() + PATIENCE
        family: list[int] = []
        while not (family := descendants(process.pid)):
            assert process.poll() is None, (tmp_path / "log").read_text()
            assert time.monotonic() < deadline
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 130
    finally:
        process.kill()
        process.wait()
    deadline = time.monotonic() + PATIENCE
    while any(lives(pid) for pid in family):  # whoever is killed still takes a moment to end
        assert time.monotonic() < deadline
        time.sleep(0.1)
    said = (tmp_path / "log").read_text()
    assert "Traceback" not in said
    again = "-m lndrl chaos --minutes 5 --folder here, with another --folder"
    assert "stopped: there was nothing to count yet; begin anew with: " in said and again in said


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--only", "earthquake"], "no such fault"),
        (["--without", "flood"], "no such fault"),
        (["--folder", "."], "must be new or empty"),
    ],
)
def test_wrong_options_are_one_sentence(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str], monkeypatch, tmp_path
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.chdir(tmp_path)
    assert run(["chaos", *arguments]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
