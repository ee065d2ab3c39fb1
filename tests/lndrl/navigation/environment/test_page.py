"""The page about Gymnasium: what it shows runs as it is (its training: tests/references)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from lndrl.config import load_config
from lndrl.policy import POLICY_FILE, build_policy, policy_metadata, to_bytes

PAGE = Path(__file__).resolve().parents[4] / "docs" / "gymnasium.md"
TINY = ["network.features=8", "network.goal_features=4", "network.map_channels=[4, 4, 4]"]


def test_what_the_page_shows_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    config = load_config(PAGE.parents[1] / "configs" / "lndrl.yaml", TINY)
    folder = tmp_path / "runs" / "first" / "checkpoints" / "step-000000001"
    folder.mkdir(parents=True)
    policy = to_bytes(build_policy(config), policy_metadata(config, 1, 1))
    (folder / POLICY_FILE).write_bytes(policy)
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    shown = [block for block in blocks if "stable_baselines3" not in block]
    assert len(blocks) == len(shown) + 1 == 4
    ran: list[dict[str, Any]] = [{} for _ in shown]  # each by itself, as somebody may copy it
    for block, names in zip(shown, ran, strict=True):
        exec(compile(block, str(PAGE), "exec"), names)
    assert ran[1]["observations"]["scan"].shape == (32, 1, 720)
    assert ran[2]["env"].unwrapped.config == ran[2]["policy"].config == config
