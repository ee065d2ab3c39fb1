"""Work in other processes: figures come back, errors are sentences, nothing is left running."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

from lndrl.bench.gpu.apart import Work, apart
from lndrl.bench.gpu.parts import Outcome, OutOfTimeError
from lndrl.errors import UserError
from tests.lndrl.bench.gpu.helpers_gpu import dies, fails, hangs, refuses, tells


def do(*works: Work, within: float = 60.0) -> dict[str, Any]:
    outcome = Outcome()
    try:
        apart(outcome.add, time.monotonic() + within, *works)
    except (UserError, OutOfTimeError) as error:
        outcome.add(error, "raised")
    return outcome.figures


def test_figures_come_back_from_another_process() -> None:
    figures = do((tells, (1.5,)))
    assert figures["deep"] == {"figure": 1.5}
    assert figures["process"] != os.getpid() and "raised" not in figures


def test_an_error_is_a_sentence_with_its_trace_and_the_other_goes_on() -> None:
    figures = do((fails, (2.0,)), (tells, (1.5,)))
    assert str(figures["raised"]) == "ZeroDivisionError: no such luck"
    assert figures["before"] == 2.0 and figures["deep"] == {"figure": 1.5}
    assert figures["trace"][-2:] == ["ZeroDivisionError: no such", "luck"]


def test_what_users_are_told_has_no_trace() -> None:
    figures = do((refuses, ()))
    assert str(figures["raised"]) == "no GPU today" and "trace" not in figures


def test_a_process_that_dies_is_said() -> None:
    assert str(do((dies, ()))["raised"]) == "its process died with exit code 13"


def test_a_process_that_hangs_is_ended() -> None:
    for seconds in (8.0, 40.0):  # a busy machine needs longer to start it
        figures = do((hangs, ()), within=seconds)
        if "process" in figures:
            break
    assert isinstance(figures["raised"], OutOfTimeError)
    assert not Path(f"/proc/{figures['process']}").exists()
