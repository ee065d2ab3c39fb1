"""A room without people."""

from __future__ import annotations

import pytest

from lndrl.config import RunConfig


@pytest.fixture(scope="module")
def config() -> RunConfig:
    scenario = {
        "name": "room",
        "size": [8, 8],
        "pedestrians": {"count": [0, 0]},
        "robot": [{"start": [1, 1, 2, 2], "goal": [6, 6, 7, 7]}],
    }
    return RunConfig.model_validate({"scenario": scenario})
