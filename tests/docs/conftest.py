"""A folder with runs of a moment, for commands that want one."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml

from lndrl.cli.main import run as lndrl
from lndrl.machine.threads import kept_threads
from tests.docs.doing import RUNS

SMALL: dict[str, Any] = {
    "scenario": "hybrid",
    "network": {"map_channels": [4, 4, 8], "features": 16, "goal_features": 8},
    "ppo": {"batch_size": 64, "minibatch_size": 32, "epochs": 1, "teacher": None},
    "learner": {"total_steps": 64, "threads": 1, "validation_episodes": 1},
    "actor": {"count": 1, "worlds": 2, "horizon": 16},
    "localization": {"min_particles": 60, "max_particles": 120},
    "task": {"time_limit": 4.0},
}


@pytest.fixture(scope="session")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with small.yaml and runs/first, trained for a moment."""
    folder = tmp_path_factory.mktemp("docs")
    (folder / "small.yaml").write_text(yaml.safe_dump(SMALL))
    with pytest.MonkeyPatch.context() as patch, kept_threads():
        patch.chdir(folder)
        assert lndrl(["train", "small.yaml", "--serial", "--run", "first"]) == 0
    return folder


@pytest.fixture(scope="session")
def filled(trained: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with every run that the pages name."""
    folder = tmp_path_factory.mktemp("filled")
    shutil.copy(trained / "small.yaml", folder)
    for name in RUNS:
        shutil.copytree(trained / "runs/first", folder / "runs" / name)
    return folder
