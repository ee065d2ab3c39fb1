"""Stable-Baselines3 trains on the environment as docs/gymnasium.md shows, for fewer steps."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import lndrl  # noqa: F401  (the environment's name)

pytest.importorskip("stable_baselines3")

PAGE = Path(__file__).resolve().parents[2] / "docs" / "gymnasium.md"


def test_the_page_trains(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (training,) = (block for block in blocks if "stable_baselines3" in block)
    shorter = training.replace("STEPS = 100_000", "STEPS = 2048")
    assert shorter != training
    names: dict[str, Any] = {}
    exec(compile(shorter, str(PAGE), "exec"), names)
    model = names["model"]
    assert model.num_timesteps == 2048 and model._n_updates == 4
    # Scaled and bounded: a critic that starts at 0 can learn them.
    assert np.abs(model.rollout_buffer.rewards).max() <= 5.0
    assert Path("runs/sb3/model.zip").exists()
    (first, *_) = sorted(Path("runs/sb3").glob("*.monitor.csv"))
    with first.open() as lines:
        next(lines)  # a comment
        episodes = list(csv.DictReader(lines))
    assert episodes and {row["is_success"] for row in episodes} <= {"True", "False"}


def test_its_checker_has_nothing_to_say(recwarn: pytest.WarningsRecorder) -> None:
    from stable_baselines3.common.env_checker import check_env

    made = gymnasium.make("lndrl/Navigation-v0", config={"task": {"time_limit": 2.0}}).unwrapped
    check_env(made)
    assert [str(w.message) for w in recwarn if "lndrl" in str(w.message)] == []
