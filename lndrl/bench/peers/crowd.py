"""``lndrl bench crowd --peers``: 22 people in the same open scene, by other packages.

Same size, tick, goals, radius and speed as ``lndrl.bench.crowd``; ours and theirs take turns, so
that what else the machine does hits all of them.
"""

from __future__ import annotations

import contextlib
import importlib
import logging
import math
import statistics
import tempfile
from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np

from lndrl.bench.crowd import (
    PEOPLE,
    TICK,
    build_crowd,
    python_microseconds,
    random_goals,
    tick_microseconds,
)
from lndrl.config import CrowdConfig
from lndrl.world.pedestrians import ORCA, SFM

ROUNDS = 7
_STEPS = 20  # steps between two looks at the clock

Figures = dict[str, float]
Turn = Callable[[float], Figures]


def measure_peers(seconds: float) -> dict[str, Any]:
    """Microseconds of one step of 22 agents, ``{peer: {key: figure}}``; ``lndrl`` in turn.

    ``step_microseconds`` includes what the package asks of Python (reading positions, setting
    preferred velocities); ``step_call_microseconds`` is its step alone.
    """
    found: dict[str, Any] = {}
    turns: dict[str, Turn] = {"lndrl": _ours()}
    for name, module, package, build in (
        ("pyrvo", "pyrvo", "pyrvo", _pyrvo),
        ("navground", "navground.sim", "navground", _navground),
        ("pysocialforce", "pysocialforce", "pysocialforce", _pysocialforce),
    ):
        level = logging.getLogger().level
        try:
            # One of them opens a log in the working folder.
            with tempfile.TemporaryDirectory() as elsewhere, contextlib.chdir(elsewhere):
                importlib.import_module(module)
        except ImportError:
            found[name] = {"missing": f"pip install {package}"}
        else:
            logging.getLogger().setLevel(level)  # one of them turns debug messages on
            turns[name] = build()
    rounds: dict[str, list[Figures]] = {name: [] for name in turns}
    for _ in range(ROUNDS):
        for name, turn in turns.items():
            rounds[name].append(turn(seconds / ROUNDS / len(turns)))
    for name, figures in rounds.items():
        found[name] = {key: statistics.median(f[key] for f in figures) for key in figures[0]}
    return found


def _timed(step: Callable[[], Any], seconds: float) -> float:
    """Median microseconds of ``step`` over about ``seconds``."""
    step()
    times: list[float] = []
    stop = perf_counter() + seconds
    while perf_counter() < stop or not times:
        started = perf_counter()
        for _ in range(_STEPS):
            step()
        times.append((perf_counter() - started) / _STEPS)
    return 1e6 * statistics.median(times)


def _ours() -> Turn:
    orca, social = build_crowd(ORCA), build_crowd(SFM)

    def turn(seconds: float) -> Figures:
        return {
            "tick_microseconds": tick_microseconds(*orca, seconds / 3),
            "tick_microseconds_from_python": python_microseconds(*orca, seconds / 3),
            "tick_microseconds_social_force": tick_microseconds(*social, seconds / 3),
        }

    return turn


def _pyrvo() -> Turn:
    import pyrvo

    c = CrowdConfig()
    simulator = pyrvo.RVOSimulator(
        TICK,
        c.orca_neighbor_distance,
        c.orca_max_neighbors,
        c.orca_time_horizon,
        c.orca_time_horizon_obstacle,
        c.orca_radius,
        c.max_speed,
    )
    routes = random_goals(PEOPLE, 64).tolist()
    ahead = [route[1] for route in routes]
    left = [iter(route[2:] + 1000 * route) for route in routes]
    for route in routes:
        simulator.add_agent(tuple(route[0]))

    def step() -> None:
        # Plain floats: arrays of 22 rows cost more than they save.
        for i in range(PEOPLE):
            position = simulator.get_agent_position(i)
            x, y = ahead[i][0] - position.x, ahead[i][1] - position.y
            length = math.sqrt(x * x + y * y)
            if length < 0.2:
                ahead[i] = next(left[i])
            scale = c.max_speed / max(length, 1.0)
            simulator.set_agent_pref_velocity(i, (x * scale, y * scale))
        simulator.do_step()

    def turn(seconds: float) -> Figures:
        return {
            "step_microseconds": _timed(step, seconds / 2),
            "step_call_microseconds": _timed(simulator.do_step, seconds / 2),
        }

    return turn


def _navground() -> Turn:
    # Its types know base classes only, not what is made by name.
    core: Any = importlib.import_module("navground.core")
    sim: Any = importlib.import_module("navground.sim")

    c = CrowdConfig()
    world = sim.World()
    route = random_goals(PEOPLE, 64)
    for goals in route:
        behavior = core.Behavior.make_type("ORCA")
        behavior.time_horizon = c.orca_time_horizon
        behavior.horizon = c.orca_neighbor_distance
        behavior.max_number_of_neighbors = c.orca_max_neighbors
        behavior.optimal_speed = c.max_speed
        kinematics = core.Kinematics.make_type("Omni")
        kinematics.max_speed = c.max_speed
        task = sim.Task.make_type("Waypoints")
        task.waypoints = [(float(x), float(y)) for x, y in goals[1:]]
        task.loop = True
        task.tolerance = 0.2
        state = sim.StateEstimation.make_type("Bounded")
        state.range = c.orca_neighbor_distance
        agent = sim.Agent(c.orca_radius, behavior, kinematics, task, [state], TICK)
        agent.position = (float(goals[0, 0]), float(goals[0, 1]))
        world.add_agent(agent)

    def turn(seconds: float) -> Figures:
        return {"step_microseconds": _timed(lambda: world.update(TICK), seconds)}

    return turn


def _pysocialforce() -> Turn:
    import pysocialforce

    start, goal = random_goals(PEOPLE, 64)[:, :2].transpose(1, 0, 2)
    way = goal - start
    velocity = CrowdConfig().max_speed * way / np.linalg.norm(way, axis=1)[:, None]
    # Its people stop at their only goal: far ahead, nobody arrives.
    state = np.hstack([start, velocity, start + 1e4 * velocity])
    simulator = pysocialforce.Simulator(state)
    peds = simulator.peds

    def step() -> None:
        simulator.step_once()
        peds.ped_states.clear()  # it keeps every state of the past
        peds.group_states.clear()

    def turn(seconds: float) -> Figures:
        return {"step_microseconds": _timed(step, seconds)}

    return turn
