"""What the tests of validation share."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from lndrl.config import RunConfig
from tests.learner.run.helpers_validation import Trained


@pytest.fixture
def start(tmp_path: Path):
    made: list[Trained] = []

    def make(name: str = "run", config: RunConfig | None = None, **options: Any) -> Trained:
        made.append(Trained(tmp_path / name, config, **options))
        return made[-1]

    yield make
    for each in made:
        each.learner.close()
