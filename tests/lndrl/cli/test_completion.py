"""A shell completes commands, options, and the names that come with the program."""

from __future__ import annotations

import subprocess
import sys

import pytest

from lndrl.cli import completion
from lndrl.cli.main import SUMMARIES
from lndrl.cli.main import run as run_command
from lndrl.config import keys


def completed(line: str) -> list[str]:
    """What bash would offer for ``line``, as the installed script asks for it."""
    words = line.split(" ")
    environment = {
        "_LNDRL_COMPLETE": "complete_bash",
        "COMP_WORDS": line,
        "COMP_CWORD": str(len(words) - 1),
    }
    code = (
        f"import os, sys\nos.environ.update({environment!r})\nsys.argv = ['lndrl']\n"
        "from lndrl.cli.main import main\nmain()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0 and done.stderr == "", done.stderr
    return done.stdout.split()


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("lndrl ", list(SUMMARIES)),
        ("lndrl tra", ["train", "train-all"]),
        ("lndrl train --res", ["--resume"]),
        ("lndrl train no_", ["no_reward", "no_reward-alone", "no_variance", "no_variance-alone"]),
        ("lndrl train --set ppo.ep", ["ppo.epochs="]),
        ("lndrl sweep p", ["ppo"]),
        ("lndrl evaluate dwa --scenario h", ["hall", "hybrid"]),
        ("lndrl scenarios sp", ["sparse"]),
        ("lndrl config sh", ["show"]),
        ("lndrl config show p", ["paper", "ppo"]),
        ("lndrl config show off", ["office"]),
        ("lndrl config explain ppo.c", ["ppo.critic_learning_rate", "ppo.clip"]),
    ],
)
def test_what_is_offered(line: str, offered: list[str]) -> None:
    assert sorted(completed(line)) == sorted(offered)


def test_what_begins_like_no_name_is_left_to_the_shell() -> None:
    assert completion.complete_configuration("./") == []
    assert completion.complete_sweep("my") == []
    assert set(completion.complete_key("")) == set(keys())
    assert "ppo=" not in completion.complete_setting("ppo")


def test_the_script_can_be_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["--help"]) == 0
    shown = capsys.readouterr().out
    assert "--install-completion" in shown and "--show-completion" in shown
