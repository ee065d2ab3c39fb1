"""The pages about parts of one's own: their examples run as they stand there."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from lndrl import extensions
from lndrl.cli.main import run
from lndrl.extensions import HOOKS
from lndrl.transport import free_endpoint

ROOT = Path(__file__).resolve().parents[2]
PAGES = ROOT / "docs" / "extend"
ROOM = {
    "name": "room",
    "size": [9, 6],
    "pedestrians": {
        "count": [2, 2],
        "routes": [{"start": [4, 1, 5, 2], "goal": [4, 4, 5, 5]}],
    },
    "robot": [{"start": [1, 1, 2, 5], "goal": [7, 1, 8, 5]}],
}
SHORT: dict[str, Any] = {
    "scenario": ROOM,
    "network": {"map_channels": [2, 2, 2], "features": 8, "goal_features": 4},
    "task": {"time_limit": 4.0},
    "localization": {"min_particles": 50, "max_particles": 60},
    "ppo": {"batch_size": 32, "minibatch_size": 16, "epochs": 1},
    "actor": {"count": 1, "worlds": 2, "horizon": 16},
    "learner": {"total_steps": 64, "checkpoint_interval": 1},
}
EPISODES = ["--episodes", "2", "--workers", "0", "--scenario", "room.yaml", "--json"]


def blocks(page: str, language: str) -> list[str]:
    """The code of ``page`` in ``language``, block by block."""
    return re.findall(rf"```{language}\n(.*?)```", (PAGES / page).read_text(), re.DOTALL)


@pytest.fixture
def example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Puts a page's example into an empty working folder; returns its module's name."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(extensions, "_trusted", {})
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "room.yaml").write_text(yaml.safe_dump(ROOM))
    (tmp_path / "lndrl.yaml").write_text(yaml.safe_dump(SHORT))  # what the pages' files extend
    written: list[str] = []

    def write(page: str) -> str:
        (text,) = blocks(page, "python")
        name = re.match(r'"""(\w+)\.py: ', text)
        assert name is not None, f"{page}: begins with its file's name"
        assert len(text.splitlines()) <= 32, f"{page}: an example has about 30 lines"
        (tmp_path / f"{name[1]}.py").write_text(text)
        written.append(name[1])
        return name[1]

    yield write
    for name in written:
        sys.modules.pop(name, None)


def json_of(capsys: pytest.CaptureFixture[str], arguments: list[str]) -> Any:
    capsys.readouterr()
    assert run(arguments) == 0, capsys.readouterr().err
    return json.loads(capsys.readouterr().out)


def test_the_planner(example: Any, capsys: pytest.CaptureFixture[str]) -> None:
    name = example("planner.md")
    command = ["evaluate", f"{name}:Wary", "--trust-modules", name, *EPISODES]
    found = json_of(capsys, [*command, "--planner-set", "distance=0.8"])
    assert (found["planner"], found["actions"]) == ("wary:Wary", "rule")
    assert found["records"][0]["distance"] > 1.0
    (methods,) = blocks("planner.md", "yaml")
    Path("bench.yaml").write_text(f"scenarios: [room.yaml]\n{methods}")
    table = ["benchmark", "--spec", "bench.yaml", "--episodes", "1", "--workers", "0", "--json"]
    rows = json_of(capsys, [*table, "--trust-modules", name])
    assert [row["method"] for row in rows] == ["wary", "bold"]
    picture = ["play", f"{name}:Wary", "--scenario", "room.yaml", "--out", "a.png"]
    assert run([*picture, "--trust-modules", name]) == 0 and Path("a.png").exists()


def test_the_reward_term_in_a_training_of_processes(example: Any, tmp_path: Path) -> None:
    name = example("reward.md")
    (text,) = blocks("reward.md", "yaml")
    (tmp_path / "manners.yaml").write_text(text)
    command = [sys.executable, "-m", "lndrl", "train", "manners.yaml", "--run", "r"]
    command += ["--no-dashboard", "--listen", free_endpoint(), "--trust-modules", name]
    # Not in PYTHONPATH: the working folder is enough.
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=1800
    )
    assert done.returncode == 0, done.stderr
    rows = [json.loads(line) for line in Path("runs/r/metrics.jsonl").read_text().splitlines()]
    assert all("keep_right" in row["reward_parts"] for row in rows)
    assert any(row["reward_parts"]["keep_right"] is not None for row in rows)
    kept = yaml.safe_load(Path("runs/r/config.yaml").read_text())
    assert kept["task"]["reward"]["terms"]["keep_right"]["settings"] == {"distance": 1.2}
    # Whoever tests the run needs no trust: the term is not imported.
    assert run(["evaluate", "runs/r", "--episodes", "1", "--workers", "0"]) == 0
    assert name not in sys.modules


@pytest.mark.parametrize("page", ["network.md", "encoder.md"])
def test_networks_and_encoders_are_trained_and_tested(
    page: str, example: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    name = example(page)
    (text,) = blocks(page, "yaml")
    Path("c.yaml").write_text(text)
    train = ["train", "c.yaml", "--serial", "--run", "r"]
    assert run(train) == 2
    assert f"{name}:" in (refused := capsys.readouterr().err) and "is refused" in refused
    assert not Path("runs/r").exists()
    assert run([*train, "--trust-modules", name]) == 0
    resumed = ["train", "--serial", "--run", "r", "--resume", "--steps", "96"]
    assert run([*resumed, "--trust-modules", name]) == 0
    found = json_of(capsys, ["evaluate", "runs/r", "--trust-modules", name, *EPISODES])
    assert len(found["records"]) == 2
    extensions._trusted.clear()
    assert run(["evaluate", "runs/r", *EPISODES]) == 2
    assert "is refused: importing it runs code" in capsys.readouterr().err


def test_the_scenario(example: Any, capsys: pytest.CaptureFixture[str]) -> None:
    name = example("scenario.md")
    (text,) = blocks("scenario.md", "yaml")
    Path("warehouse.yaml").write_text(text)
    command = ["scenarios", "warehouse.yaml", "--layout", "3", "--json"]
    assert run(command) == 2
    assert "is refused" in capsys.readouterr().err
    found = json_of(capsys, [*command, "--trust-modules", name])
    assert found["layout"] == "warehouse-3" and found["robot"] and found["routes"]
    train = ["train", "lndrl.yaml", "--set", "scenario=warehouse.yaml", "--serial", "--run", "r"]
    assert run([*train, "--trust-modules", name]) == 0


def test_the_metrics(example: Any, capsys: pytest.CaptureFixture[str]) -> None:
    name = example("metric.md")
    command = ["evaluate", "straight", "--trust-modules", name, *EPISODES]
    command += ["--metric", f"{name}:SlowArrival", "--metric", f"{name}:ShareAstray"]
    found = json_of(capsys, command)["own_metrics"]
    assert set(found) == {"SlowArrival", "ShareAstray"} and 0.0 <= found["ShareAstray"] <= 1.0


def test_the_index_names_every_hook_and_page() -> None:
    text = (PAGES / "README.md").read_text()
    assert all(hook.group in text for hook in HOOKS)
    assert {page.name for page in PAGES.glob("*.md")} - {"README.md"} == set(
        re.findall(r"\]\((\w+\.md)\)", text)
    )
