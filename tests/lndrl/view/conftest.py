"""A learner's answer and a world, both made up, for the tests of the drawings."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from lndrl.navigation.snapshot import WorldSnapshot

_ACTOR_SPLIT = {
    "simulate": 0.5,
    "infer": 0.2,
    "upload": 0.05,
    "fetch": 0.04,
    "wait": 0.18,
    "other": 0.03,
}


def _actor(i: int) -> dict[str, Any]:
    return {
        "id": f"node-{i}",
        "host": "a-host-with-a-rather-long-name",
        "pid": 100 + i,
        "worlds": 8,
        "state": {0: "active", 3: "gone", 5: "slow"}.get(i, "active"),
        "last_ack_age": 134.0 if i == 3 else 0.4,
        "lag": i % 3,
        "steps": 1000 * i,
        "rate": 10.5,
        "restarts": 0,
        "time_split": _ACTOR_SPLIT,
    }


def _counted(arrived: int) -> dict[str, int]:
    rest = {"collided": 100 - arrived, "lost": 0, "timeout": 0, "steps": 5000}
    return {"episodes": 100, "arrived": arrived, **rest}


def _answer(fleet: int = 9, log: int = 20, rows: int = 120, **changes: Any) -> dict[str, Any]:
    history = [
        {
            "time": 1000.0 + i,
            "steps": 100 * i,
            "rate": 80.0,
            "arrived": 0.1 + 0.4 * i / max(rows, 1),
            "collided": 0.5 - 0.3 * i / max(rows, 1),
            "lost": 0.1,
            "timeout": 0.3 - 0.1 * i / max(rows, 1),
            "mean_return": -300.0 + 5 * i,
            "kl": 0.01,
            "entropy": 3.0,
            "lag": 0.5,
        }
        for i in range(rows)
    ]
    snapshot = {
        "run_id": "r1",
        "run_name": "crowd-7",
        "verdict": "learning",
        "state": "training",
        "time": 2000.0,
        "uptime": 1531.0,
        "steps": 123456,
        "total_steps": 1200000,
        "updates": 121,
        "weights_version": 121,
        "rate": {"10s": 82.4, "60s": 81.3, "300s": 79.5},
        "eta": 13290.0,
        "time_split": {
            "wait": 0.3,
            "ingest": 0.05,
            "update": 0.59,
            "publish": 0.02,
            "checkpoint": 0.01,
            "other": 0.03,
        },
        "actor_split": _ACTOR_SPLIT,
        "overhead_learner": 0.16,
        "overhead_actor": 0.15,
        "actors": [_actor(i) for i in range(fleet)],
        "episodes": {
            "count": 5321,
            "window": 500,
            "arrived": 0.552,
            "collided": 0.207,
            "lost": 0.031,
            "timeout": 0.21,
            "mean_return": 212.3,
            "mean_time": 22.9,
            "mean_distance": 12.2,
            "position_error": 0.21,
        },
        "ppo": {
            "policy_loss": -0.0123,
            "value_loss": 0.842,
            "entropy": 2.11,
            "kl": 0.0081,
            "clip_fraction": 0.121,
            "explained_variance": 0.63,
            "gradient_norm_policy": 0.41,
            "gradient_norm_value": 3.2,
            "learning_rate": 2.7e-4,
            "importance_max": 2.3,
        },
        "lag": {"mean": 0.5, "max": 2},
        "dropped": {"stale": 3, "duplicate": 0, "refused": 0},
        "queue": {"chunks": 2, "megabytes": 1.8},
        "events": [
            {"time": 1900.0 + i, "kind": "join", "text": f"event {i} " + "words " * (i % 20)}
            for i in range(log)
        ],
        "validation": {
            "episodes": 100,
            "heard": 1.0,
            "points": [
                {
                    "version": 10 * i,
                    "steps": 10000 * i,
                    "unix": 1000.0 + 80 * i,
                    "sampled": _counted(8 * i),
                    "greedy": _counted(7 * i),
                }
                for i in range(12)
            ],
            "best": {"version": 90, "steps": 90000, "sampled": _counted(91)},
        },
        "checkpoint": {"path": "runs/crowd-7/checkpoints/step-000123456", "age": 41.0},
    }
    return {"snapshot": snapshot | changes, "history": history}


def _world(steps: int = 10, outcome: str = "", people: int = 4, particles: int = 50) -> Any:
    rng = np.random.default_rng(steps)
    occupied = np.zeros((120, 200), bool)
    occupied[0] = occupied[-1] = occupied[:, 0] = occupied[:, -1] = True
    occupied[40:60, 90:110] = True
    time = 0.4 * np.arange(steps + 1)
    path = np.stack([1.0 + 0.5 * time, 1.0 + 0.2 * time], axis=1)
    path_estimated = path + 0.05
    pose = np.array([*path[-1], 0.4])
    centre = rng.uniform(1.0, 5.0, (people, 2))
    return WorldSnapshot(
        scenario="made up",
        size=(10.0, 6.0),
        occupied=occupied,
        resolution=0.05,
        origin=(0.0, 0.0),
        world=0,
        episode=0,
        steps=steps,
        time=float(time[-1]),
        outcome=outcome,
        pose_true=pose,
        pose_estimated=pose + np.array([0.05, 0.05, 0.02]),
        variance=np.full(3, 0.01),
        particles=pose + 0.1 * rng.normal(size=(particles, 3)),
        start_pose=np.array([1.0, 1.0, 0.0]),
        goal=np.array([8.0, 4.0]),
        arrive_distance=0.5,
        command=np.array([0.6, 0.0]),
        scan=np.full(90, 2.0, np.float32),
        field_of_view=math.pi,
        range_max=12.0,
        pedestrian_position=centre,
        pedestrian_velocity=rng.uniform(-0.5, 0.5, (people, 2)),
        leg_position=np.repeat(centre, 2, axis=0) + 0.1,
        pedestrian_radius=0.3,
        leg_radius=0.1,
        robot_radius=0.17,
        path=path,
        path_estimated=path_estimated,
        episode_return=1.0,
    )


@pytest.fixture
def answer() -> Callable[..., dict[str, Any]]:
    """Makes ``{"snapshot", "history"}``; keywords change the snapshot."""
    return _answer


@pytest.fixture(scope="session")
def answer_maker() -> Callable[..., dict[str, Any]]:
    """The same for fixtures that serve several tests."""
    return _answer


@pytest.fixture
def world() -> Callable[..., WorldSnapshot]:
    """Makes a snapshot of a small world."""
    return _world
