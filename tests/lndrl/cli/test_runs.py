"""What a command says and answers when its run has ended."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from learner.run.record import RunSummary
from lndrl.cli.runs import concluded
from lndrl.cli.signals import Stop


def summary(finished: bool) -> RunSummary:
    return RunSummary(
        Path("runs/first"), finished, 64, 2, 3.0, {"count": 0, "window": 0}, {}, {}, None
    )


@pytest.mark.parametrize(
    ("finished", "stopped", "code"), [(True, True, 0), (True, False, 0), (False, True, 130)]
)
def test_a_finished_run_has_succeeded_whatever_ended_its_last_wait(
    capsys: pytest.CaptureFixture[str], finished: bool, stopped: bool, code: int
) -> None:
    stop = Stop()
    if stopped:
        stop.signal_number = signal.SIGINT
        stop.set()
    assert concluded(summary(finished), Path("runs/first"), stop) == code
    said = capsys.readouterr()
    assert "64 steps" in said.out
    assert ("go on with: " in said.err) == (not finished)
