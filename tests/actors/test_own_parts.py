"""An actor and a learner's configuration that names parts of somebody's own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from actors.actor import Actor
from actors.fleet import Fleet
from actors.worker import WorkerOptions
from lndrl import extensions
from lndrl.errors import UserError
from lndrl.navigation import EpisodeRecord
from lndrl.transport import MemoryNetwork, free_endpoint

ROOT = Path(__file__).resolve().parents[2]
TEXT = """
    import numpy as np

    class Bonus:
        def __init__(self, config): pass
        def __call__(self, steps):
            return np.ones(len(steps.steps))
"""


def test_an_actor_imports_only_what_it_trusts(own_module, small_config, noting_learner) -> None:
    module = own_module(TEXT, trusted=False)
    terms = {"bonus": {"use": f"{module}:Bonus", "weight": 3.0}}
    network = MemoryNetwork()
    config = small_config(task={"reward": {"terms": terms}, "time_limit": 2.0})
    learner = noting_learner(config, network.learner())
    learner.publish(0)
    with pytest.raises(UserError, match=r"^task\.reward\.terms\.bonus: reward term .* is refused"):
        Actor(network.actor(), actor_id="a").run_chunk()
    assert module not in sys.modules
    extensions.trust_modules(module)
    actor = Actor(network.actor(), actor_id="a")
    for _ in range(2):
        assert actor.run_chunk()
        actor._take_acks()
    episodes = [EpisodeRecord.from_dict(e, ("bonus",)) for h in learner.headers for e in h.episodes]
    assert episodes and all(e.reward_parts["bonus"] == 3.0 * e.steps for e in episodes)


def test_a_fleet_hands_its_trust_to_its_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extensions, "_trusted", {"mine": None})
    given: list[WorkerOptions] = []

    class Context:
        def Pipe(self, duplex: bool) -> tuple[object, object]:
            return subprocess.PIPE, Closed()

        def Process(self, target: object, args: tuple[WorkerOptions, object], **_: object):
            given.append(args[0])
            return Closed()

    class Closed:
        def close(self) -> None: ...

        def start(self) -> None: ...

    monkeypatch.setattr("actors.fleet.multiprocessing.get_context", lambda kind: Context())
    Fleet("tcp/127.0.0.1:1", 1).start()
    assert given[0].trusted == ("mine",)


def test_training_ends_with_the_actors_sentence(
    own_module: Callable[..., str], tmp_path: Path
) -> None:
    module = own_module("""
        class Bonus:
            def __init__(self, config): pass
            def __call__(self, steps):
                raise ValueError("enough")
    """)
    room = {
        "name": "room",
        "size": [6, 4],
        "pedestrians": {"count": [0, 0]},
        "robot": [{"start": [1, 1, 2, 3], "goal": [4, 1, 5, 3]}],
    }
    config = {
        "scenario": room,
        "network": {"map_channels": [2, 2, 2], "features": 8, "goal_features": 4},
        "task": {"reward": {"terms": {"bonus": {"use": f"{module}:Bonus"}}}},
        "actor": {"count": 1, "worlds": 1, "horizon": 8},
        "localization": {"min_particles": 50, "max_particles": 60},
    }
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(config))
    command = [sys.executable, "-m", "lndrl", "train", "c.yaml", "--run", "r", "--no-dashboard"]
    command += ["--listen", free_endpoint(), "--trust-modules", module]
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{tmp_path / 'own'}"}
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=1800
    )
    last = done.stderr.strip().splitlines()[-1]
    assert done.returncode == 2, done.stderr
    failed = f"reward term {module}:Bonus failed: ValueError: enough ({module}.py, line 5)"
    assert last == f"lndrl: {failed}"
    assert "Traceback" not in done.stderr
