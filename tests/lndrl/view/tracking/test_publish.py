"""A tracker that fails is told once and tried again; it can neither stop nor slow a training."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from threading import Event

import pytest

from lndrl.cli.main import run as lndrl
from lndrl.view.tracking import publish as module
from lndrl.view.tracking.feed import Row
from lndrl.view.tracking.publish import RunFacts, TrackerError, plain, publish
from tests.lndrl.view.tracking.test_feed import line


class Broken:
    """Takes rows as soon as it has refused them ``times``."""

    where = "nowhere"

    def __init__(self, times: int) -> None:
        self.times, self.got, self.finished = times, list[int](), 0

    def sent(self) -> float:
        return 0.0

    def send(self, rows: Sequence[Row]) -> None:
        if self.times:
            self.times -= 1
            raise TrackerError("https://user:secret@host is\n away")
        self.got += [row["update"] for row in rows]

    def finish(self, ended: bool) -> None:
        self.finished += 1


@pytest.fixture
def facts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RunFacts:
    monkeypatch.setattr(module, "_LOOK", 0.01)
    monkeypatch.setattr(module, "_FIRST_PAUSE", 0.01)
    monkeypatch.setattr(module, "_BATCH", 2)
    (tmp_path / "metrics.jsonl").write_text("".join(line(i, float(i)) for i in range(1, 6)))
    return RunFacts(tmp_path, "a", "a-1", "0", {})


def test_a_failure_is_said_once_and_nothing_is_lost_or_sent_twice(facts: RunFacts) -> None:
    tracker, said, going = Broken(3), list[str](), iter([True] * 5)
    count = publish(facts, lambda: tracker, lambda: next(going, False), Event(), said.append)
    assert count == 5 and tracker.got == [1, 2, 3, 4, 5] and tracker.finished == 1
    assert said == [
        "to nowhere",
        "https://host is away; tried again until it works, training goes on",
        "works again, 5 rows sent",
    ]


def test_what_was_not_sent_is_said_at_the_end(facts: RunFacts) -> None:
    tracker, stop = Broken(9), Event()
    stop.set()
    with pytest.raises(TrackerError, match=r"^https://host is away$"):
        publish(facts, lambda: tracker, lambda: True, stop, lambda text: None)
    assert tracker.times == 8, "asked to end, it tries once more"


def test_addresses_are_said_without_names_and_passwords() -> None:
    assert plain(ValueError("no http://me:pw@host:1/x,\nnor y.")) == "no http://host:1/x, nor y"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["log", "runs/none", "--to", "wandb"], "runs/none: is no run folder of lndrl"),
        (["log", "runs/none", "--to", "excel"], "--to excel: is unknown; known: wandb, mlflow"),
        (["train", "--log", "excel"], "--log excel: is unknown; known: wandb, mlflow"),
        (["train", "--serial", "--log", "wandb"], "--log does not go with --serial"),
    ],
)
def test_mistakes_are_one_sentence(
    words: list[str],
    sentence: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(module, "find_spec", lambda name: object())
    assert lndrl(words) == 2
    said = capsys.readouterr().err
    assert sentence in said and said.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_package_that_is_missing_is_named_before_anything_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(module, "find_spec", lambda name: None)
    assert lndrl(["learner", "--log", "mlflow"]) == 2
    assert 'pip install "lndrl[mlflow]"' in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_no_run_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text(json.dumps({"version": "0"}))
    with pytest.raises(module.UserError, match="is no run folder"):
        module.facts_of(tmp_path)
