"""A folder with runs of a moment, for commands that want one."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import NamedTuple

import pytest
import yaml

from lndrl.cli.main import run as lndrl
from lndrl.machine.threads import kept_threads
from tests.docs.doing import FOLLOWED, RUNS, shortened
from tests.docs.pages import ROOT, Command, commands
from tests.small import small_run

SMALL = small_run(steps=64, time_limit=4.0)


class Followed(NamedTuple):
    """Where pages were followed, and each command that was run with its exit code."""

    folder: Path
    codes: list[tuple[Command, int]]


@pytest.fixture(scope="session")
def followed(tmp_path_factory: pytest.TempPathFactory) -> Followed:
    """The pages of FOLLOWED, followed from the first command to the last in a folder of its own.

    What is trained on the way, ``runs/first``, other commands of the pages may look at.
    """
    folder = tmp_path_factory.mktemp("docs")
    (folder / "small.yaml").write_text(yaml.safe_dump(SMALL))
    codes: list[tuple[Command, int]] = []
    with pytest.MonkeyPatch.context() as patch, kept_threads():
        patch.chdir(folder)
        for command in (each for page in FOLLOWED for each in commands(ROOT / page)):
            words = shortened(command.words) if command.block else None
            codes += [(command, lndrl(words))] if words is not None else []
    return Followed(folder, codes)


@pytest.fixture(scope="session")
def filled(followed: Followed, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with every run that the pages name."""
    folder = tmp_path_factory.mktemp("filled")
    for name in RUNS:
        shutil.copytree(followed.folder / "runs/first", folder / "runs" / name)
    return folder
