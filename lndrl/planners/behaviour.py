"""What a planner does, as a hash: so that worlds are judged by a planner that was there before."""

from __future__ import annotations

import hashlib

import numpy as np

from lndrl.config import REPOSITORY_CONFIGS, RunConfig, load_config
from lndrl.navigation import Observation
from lndrl.navigation.observation import SCAN_COUNTS
from lndrl.planners.factory import planner_source

_ROWS, _STEPS = 16, 24
_DIGITS = 6  # of a velocity; rounding of another machine is no other behaviour
_WORLD = ("localization.kind=amcl", "localization.delay=0", "world.tick=0.1",
          "world.ticks_per_step=4")  # fmt: skip
"""What planners read of the world in which they act, however a bench comes to set it."""


def behaviour_hash(name: str) -> str:
    """Twelve hex digits of what the rule ``name`` does in 16 made-up episodes of 24 steps.

    Rewriting the planner changes nothing, and nor does what a bench makes of clock and filter;
    another choice in any of the 384 steps does.
    """
    config = load_config(REPOSITORY_CONFIGS / "lndrl.yaml", _WORLD)
    planner = planner_source(name).build(config)
    rows = np.arange(_ROWS)
    planner.reset(0, rows.tolist())
    digest = hashlib.sha256()
    random = np.random.Generator(np.random.PCG64(20_230_320))
    for _ in range(_STEPS):
        velocities = planner.act(made_up(random, config), rows)
        digest.update(np.round(velocities, _DIGITS).astype("<f8").tobytes())
    return digest.hexdigest()[:12]


def made_up(random: np.random.Generator, config: RunConfig) -> Observation:
    """Observations (16,) of places that never were: walls in sectors, gaps, people, beliefs."""
    seen = Observation.zeros_for(_ROWS, config)
    beams, most = seen.scan.shape[1], seen.pedestrians.shape[1]
    sectors = random.uniform(0.3, 14.0, (_ROWS, 12))
    metres = np.repeat(sectors, -(-beams // 12), axis=1)[:, :beams]
    metres = metres + random.normal(0.0, 0.02, metres.shape)
    counts = np.clip(metres / config.world.laser.range_max, 0.0, 1.0) * SCAN_COUNTS
    seen.scan[:] = np.rint(counts)
    seen.pedestrian_count[:] = random.integers(0, min(8, most + 1), _ROWS)
    half = 0.5 * config.task.map_extent
    people = np.concatenate(
        (random.uniform(-half, half, (_ROWS, most, 2)), random.normal(0.0, 0.3, (_ROWS, most, 2))),
        axis=2,
    )
    people[np.arange(most) >= seen.pedestrian_count[:, None]] = 0.0
    seen.pedestrians[:] = people
    seen.goal[:, :2] = random.uniform(-9.0, 9.0, (_ROWS, 2))
    seen.goal[:, 2] = random.uniform(-np.pi, np.pi, _ROWS)
    seen.goal[:, 3:] = 10.0 ** random.uniform(-4.0, 0.5, (_ROWS, 3))
    return seen
