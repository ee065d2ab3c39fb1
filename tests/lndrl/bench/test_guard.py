"""``lndrl bench guard``: the contests, counted."""

from __future__ import annotations

import json

import pytest

from lndrl.bench import guard
from lndrl.cli.main import run


def test_steps_are_shared_by_the_cases() -> None:
    figures = guard.run(20 * len(guard.CASES))
    assert figures["steps"] == 20 * len(guard.CASES) and figures["touched what was seen"] == 0
    for name in guard.CASES:
        assert figures[name]["steps"] == 20 and figures[name]["microseconds"] > 0.0
        assert 0.0 <= figures[name]["standing"] <= 1.0


def test_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    steps = 2 * len(guard.CASES)
    assert run(["bench", "guard", "--steps", str(steps), "--json"]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["steps"] == steps
    assert f"guard: {steps} of {steps} steps" in printed.err
    assert run(["bench", "laser", "--steps", "8"]) == 2
    assert "--steps goes with guard, not with laser" in capsys.readouterr().err
