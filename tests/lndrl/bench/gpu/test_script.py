"""``lndrl bench gpu``: its file, its table, its exit codes; what is measured is made up."""

from __future__ import annotations

import json
import signal
from pathlib import Path
from typing import Any

import pytest
import torch

from lndrl.bench import gpu
from lndrl.bench.gpu import script
from lndrl.bench.gpu.parts import Part, Tell
from lndrl.cli.main import run


def good(tell: Tell, deadline: float) -> None:
    tell(12345.6, "samples_per_second", "float32", "64")


def bad(tell: Tell, deadline: float) -> None:
    tell(["line"], "trace")
    raise RuntimeError("CUDA error: unspecified launch failure")


def interrupted(tell: Tell, deadline: float) -> None:
    signal.raise_signal(signal.SIGINT)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def parts(monkeypatch: pytest.MonkeyPatch, *made: Part) -> None:
    monkeypatch.setattr(script, "parts_of", lambda plan: list(made))


GOOD, BAD = Part("policy", 10.0, 0.0, good), Part("card", 10.0, 0.0, bad)
LATE = Part("arrivals", 40.0, 1e6, good)


def test_a_failure_is_in_file_and_table_and_the_rest_is_measured(here, monkeypatch, capsys) -> None:
    parts(monkeypatch, BAD, GOOD, LATE)
    assert run(["bench", "gpu", "--rehearse", "--out", "a.json", "--minutes", "1"]) == 1
    content = json.loads(Path("a.json").read_text())
    states = {name: part["state"] for name, part in content["parts"].items()}
    assert states == {"card": "failed", "policy": "done", "arrivals": "skipped"}
    assert content["rehearsal"] and not content["complete"]
    assert content["seconds_allowed"] == 60.0 and content["plan"]["device"] == "cpu"
    assert content["machine"]["cores"] >= 1
    out = " ".join(capsys.readouterr().out.split())
    assert "RuntimeError: CUDA error: unspecified launch failure" in out
    assert "samples_per_second float32 64 │ 12,346" in out
    assert "arrivals │ skipped" in out and "trace" not in out


def test_json_stands_alone_and_what_was_skipped_is_no_failure(here, monkeypatch, capsys) -> None:
    parts(monkeypatch, GOOD, LATE)
    assert run(["bench", "gpu", "--rehearse", "--json"]) == 0
    captured = capsys.readouterr()
    printed = json.loads(captured.out)
    (file,) = here.glob("bench-gpu-*.json")
    kept = json.loads(file.read_text())
    assert printed["parts"] == kept["parts"]
    assert "policy: done after 0 s" in captured.err


def test_an_interrupt_keeps_what_was_measured(here, monkeypatch, capsys) -> None:
    parts(monkeypatch, GOOD, Part("learner", 10.0, 0.0, interrupted), LATE)
    assert run(["bench", "gpu", "--rehearse", "--out", "a.json"]) == 130
    content = json.loads(Path("a.json").read_text())
    assert [part["state"] for part in content["parts"].values()] == [
        "done",
        "measuring",
        "not begun",
    ]
    assert "stopped: a.json holds what was measured; begin again" in capsys.readouterr().err


def test_without_a_gpu_a_sentence_says_what_to_do(here, monkeypatch, capsys) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert run(["bench", "gpu"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("lndrl: bench gpu: torch ")
    assert line.endswith("; --rehearse runs the same script in small on the CPU")
    assert not list(here.iterdir())


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        ("gpu --device cuda:1", "--device does not go with gpu, which takes --minutes, --out"),
        ("gpu --seconds 3", "--seconds does not go with gpu"),
        ("gpu --peers", "--peers does not go with gpu"),
        ("gpu --rehearse --minutes 0", "--minutes 0: must be above 0"),
        ("gpu --rehearse --out no/such/a.json", "--out no/such/a.json: cannot be written (No such"),
        ("world --rehearse", "--rehearse goes with gpu, not with world"),
        ("world --out a.json", "--out goes with gpu, not with world"),
        ("all --minutes 3", "--minutes goes with gpu, not with all"),
    ],
)
def test_options_that_do_not_go_together(here, capsys, command: str, sentence: str) -> None:
    assert run(["bench", *command.split()]) == 2
    assert sentence in capsys.readouterr().err


@pytest.mark.parametrize("plan", [gpu.full_plan(), gpu.rehearsal()])
def test_shares_make_up_eight_minutes_and_every_part_fits_in_its_own(plan: Any) -> None:
    made = script.parts_of(plan)
    assert sum(part.share for part in made) == 480.0
    assert all(part.least <= part.share for part in made)
    assert [part.name for part in made if part.borrows] == ["kernels"]
