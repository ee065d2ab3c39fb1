"""Tests that are marked, run by pytest in other processes, counted."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest

from lndrl.bench.gpu import checks
from lndrl.bench.gpu.parts import Outcome, OutOfTimeError
from lndrl.bench.gpu.plan import full_plan, rehearsal
from lndrl.errors import UserError

IMPORTS = "import pytest, time\n"
# Not written as it is: this file itself needs no GPU.
MARK = "@pytest.mark." + "cuda\n"
PASSES = MARK + "def test_good(): pass\n"
FAILS = MARK + "def test_bad(): assert 1 == 2, 'one is not two'\n"
SKIPS = MARK + "@pytest.mark.skip\ndef test_not(): pass\n"
HANGS = MARK + "def test_long(): time.sleep(600)\n"
OTHER = "def test_other(): raise RuntimeError\n"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = cuda\n")
    (tmp_path / "tests/room").mkdir(parents=True)
    return tmp_path


def write(root: Path, **files: str) -> None:
    for name, text in files.items():
        (root / f"tests/room/test_{name}.py").write_text(IMPORTS + text)


def check(root: Path, rehearsing: bool = False, within: float = 120.0) -> dict[str, Any]:
    outcome = Outcome()
    plan = rehearsal() if rehearsing else full_plan()
    try:
        checks.measure(outcome.add, time.monotonic() + within, plan, root)
    except (UserError, OutOfTimeError) as error:
        outcome.add(str(error), "raised")
    return outcome.figures


def test_this_checkout_marks_some() -> None:
    names = [path.name for path in checks.marked(checks.ROOT)]
    assert "test_device.py" in names and "test_raster.py" in names
    assert Path(__file__).name not in names


def test_marked_tests_are_counted_and_failures_named(root: Path) -> None:
    write(root, one=PASSES + SKIPS + OTHER, two=FAILS + PASSES, three=OTHER)
    write(root, four=f"import nothing_of_the_kind\n{PASSES}", five=f"{MARK!r}\n")
    figures = check(root)
    assert (figures["passed"], figures["failed"], figures["skipped"]) == (2, 2, 1)
    assert len(figures["which_failed"]) == 2
    assert any(
        "test_bad: AssertionError: one is not two" in each for each in figures["which_failed"]
    )
    assert figures["raised"].startswith("2 failed, the first is ")


def test_nothing_that_was_run_proves_nothing(root: Path) -> None:
    write(root, one=SKIPS)
    assert check(root)["raised"] == "none was run, 1 were skipped"
    assert "raised" not in check(root, rehearsing=True)


def test_a_test_that_hangs_is_ended(root: Path) -> None:
    write(root, one=HANGS)
    assert check(root, within=3.0)["raised"] == "1 of 1 files had not ended"


def test_without_tests_a_sentence_says_so(root: Path) -> None:
    assert "holds no tests; run from a checkout" in check(root)["raised"]
