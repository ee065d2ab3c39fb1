"""The tests that need a GPU, by pytest, where the program runs from a checkout that has them."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

from lndrl.bench.gpu.parts import OutOfTimeError, Tell
from lndrl.bench.gpu.plan import Plan
from lndrl.errors import UserError
from lndrl.evaluation.sweep.processes import this_program
from lndrl.machine.cores import usable_cores

ROOT = Path(__file__).resolve().parents[3]
"""Where this program's own files are."""

_MARK = "pytest.mark.cuda"
_NONE_COLLECTED = 5  # pytest's exit code
_LOOK = 0.1  # s
_SHOWN = 20  # failed tests, each with the first line that it said


@dataclass
class _Run:
    """pytest at work on one file."""

    file: Path
    process: subprocess.Popen[bytes]
    result: Path
    log: Path


def measure(tell: Tell, deadline: float, plan: Plan, root: Path = ROOT) -> None:
    """Tell how many tests ``passed``, ``failed`` and were ``skipped``, and which failed.

    Each file has a process of its own, as many side by side as there are cores. Raises UserError
    where a test failed, or none was run, which a rehearsal cannot help; OutOfTimeError at
    ``deadline``, with what has ended told.
    """
    files = marked(root)
    if not files:
        raise UserError(f"{root} holds no tests; run from a checkout of the repository")
    if find_spec("pytest") is None:
        raise UserError("pytest is not installed; deploy/wheels.py carries it along")
    counts = {"passed": 0, "failed": 0, "skipped": 0}
    failed: list[str] = []
    running: list[_Run] = []
    waiting = list(files)
    with tempfile.TemporaryDirectory(prefix="lndrl-bench-") as folder:
        try:
            while waiting or running:
                while waiting and len(running) < usable_cores():
                    running.append(_start(waiting.pop(0), root, Path(folder)))
                for run in [each for each in running if each.process.poll() is not None]:
                    running.remove(run)
                    failed += _count(run, root, counts)
                    _told(tell, counts, failed)
                if running and time.monotonic() > deadline:
                    left = len(running) + len(waiting)
                    raise OutOfTimeError(f"{left} of {len(files)} files had not ended")
                time.sleep(_LOOK if running else 0.0)
        finally:
            for run in running:
                run.process.kill()
                run.process.wait()
    if failed:
        raise UserError(f"{len(failed)} failed, the first is {failed[0]}")
    if not counts["passed"] and not plan.is_rehearsal:
        raise UserError(f"none was run, {counts['skipped']} were skipped")


def marked(root: Path) -> list[Path]:
    """Files of tests below ``root`` that mark some as needing a GPU."""
    found = sorted((root / "tests").rglob("test_*.py"))
    return [path for path in found if _MARK in path.read_text("utf-8")]


def _start(file: Path, root: Path, folder: Path) -> _Run:
    name = "-".join(file.relative_to(root).with_suffix("").parts)
    result, log = folder / f"{name}.xml", folder / f"{name}.log"
    command = [sys.executable, "-m", "pytest", "-m", "cuda", "-p", "no:cacheprovider"]
    command += [f"--rootdir={root}", f"--junit-xml={result}", str(file)]
    with log.open("wb") as out:
        process = subprocess.Popen(
            command,
            cwd=root,
            env=this_program(),
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=out,
            start_new_session=True,
        )
    return _Run(file, process, result, log)


def _count(run: _Run, root: Path, counts: dict[str, int]) -> list[str]:
    """Add the tests of a run to ``counts``; those that failed, with what they said."""
    try:
        cases = list(ElementTree.parse(run.result).iter("testcase"))
    except (OSError, ElementTree.ParseError):
        cases = []
    if not cases and run.process.returncode == _NONE_COLLECTED:
        return []
    if not cases:
        counts["failed"] += 1
        return [f"{run.file.relative_to(root)}: {_last_line(run.log)}"]
    failed = []
    for case in cases:
        if (why := next((e for e in case if e.tag in ("failure", "error")), None)) is not None:
            counts["failed"] += 1
            said = (why.get("message") or "").strip().splitlines() or ["no reason given"]
            failed.append(f"{case.get('classname')}.{case.get('name')}: {said[0]}")
        else:
            counts["skipped" if case.find("skipped") is not None else "passed"] += 1
    return failed


def _told(tell: Tell, counts: dict[str, int], failed: Sequence[str]) -> None:
    for name, count in counts.items():
        tell(count, name)
    if failed:
        tell(list(failed[:_SHOWN]), "which_failed")


def _last_line(log: Path) -> str:
    with suppress(OSError):
        lines = log.read_text("utf-8", "replace").split("\n")
        return next((each.strip() for each in reversed(lines) if each.strip()), "nothing said")
    return "nothing said"
