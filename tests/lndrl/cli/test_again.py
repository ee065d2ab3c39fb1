"""The command line that is told to whoever was interrupted."""

from __future__ import annotations

import os
import shlex
import sys
from pathlib import Path

import pytest

from lndrl.cli.again import remember, resuming_command, same_command


@pytest.fixture(autouse=True)
def called(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["/elsewhere/pytest"])


@pytest.mark.parametrize(
    ("given", "resuming"),
    [
        ("train a.yaml", "train a.yaml --run x --resume"),
        ("train a.yaml --run x --set seed=1 b=2", "train a.yaml --run x --set seed=1 b=2 --resume"),
        ("train --run=x --resume", "train --run=x --resume"),
        ("train --resume --checkpoint step-1 --run x", "train --resume --run x"),
        ("train --resume --checkpoint=step-1 --run x", "train --resume --run x"),
        ("learner --listen tls/[::]:1", "learner --listen 'tls/[::]:1' --run x --resume"),
    ],
)
def test_training_goes_on_with_the_newest_checkpoint(given: str, resuming: str) -> None:
    remember(given.split())
    assert shlex.split(same_command()) == ["lndrl", *given.split()]
    assert resuming_command("x") == f"lndrl {resuming}"


def test_what_a_shell_would_split_is_quoted() -> None:
    remember(["evaluate", "my run", "--scenario", "a*.yaml"])
    assert same_command() == "lndrl evaluate 'my run' --scenario 'a*.yaml'"


def test_the_program_is_the_one_that_was_called(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    remember(["version"])
    monkeypatch.setattr(sys, "argv", ["/site-packages/lndrl/__main__.py", "version"])
    assert same_command() == f"{sys.executable} -m lndrl version"
    script = tmp_path / "lndrl"
    script.write_text("")
    script.chmod(0o755)
    monkeypatch.setattr(sys, "argv", [str(script), "version"])
    monkeypatch.setenv("PATH", os.devnull)
    assert same_command() == f"{script} version"
    monkeypatch.setenv("PATH", str(tmp_path))
    assert same_command() == "lndrl version"
