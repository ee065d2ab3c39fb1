"""``lndrl bench world``: control steps on one core, without a policy."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.bench.report import REPETITIONS
from lndrl.bench.scene import SCENARIOS, WORLDS, RandomActions, hybrid_config
from lndrl.kernels import kernel
from lndrl.navigation import VectorNavigation
from lndrl.navigation.step import people_row, robot_row
from lndrl.world.laser import noisy_scan
from lndrl.world.pedestrians import advance_people
from lndrl.world.robot import take_command
from lndrl.world.world import tick_inline

_TURNS = 15
_STEPS = 30
"""Control steps of a split's drive: about as long as an episode of random actions."""


def measure(seconds: float) -> dict[str, Any]:
    """``steps_per_second`` by scenario with random actions: people, robot, contacts, laser, four
    localization updates, observation, reward and episode starts included, policy excluded.

    Medians over short turns that all scenarios take one after the other, so that what else the
    machine does meets all alike; ``steps_per_second_best`` are the fastest turns.
    ``steps_per_second_perfect_localization`` is hybrid without a filter.
    ``microseconds_by_part`` splits a control step of hybrid: the fastest of many drives of the same
    worlds, each with one part more than the one before; ``python`` is what is left of the fastest
    step of VectorNavigation. ``megabytes_per_world`` is what a world needs beyond what all share.
    """
    variants = {name: ["scenario=" + name] for name in SCENARIOS}
    variants["perfect"] = ["localization=perfect"]
    turns = _turns(variants, seconds * 0.75)
    best = {name: max(rates) for name, rates in turns.items()}
    median = {name: statistics.median(rates) for name, rates in turns.items()}
    environment = VectorNavigation(hybrid_config(), 0, WORLDS)
    return {
        "steps_per_second": {name: median[name] for name in SCENARIOS},
        "steps_per_second_perfect_localization": median["perfect"],
        "steps_per_second_best": best,
        "microseconds_by_part": _split(environment, 1e6 / best["hybrid"], seconds / 4),
        "megabytes_per_world": _megabytes(environment),
    }


def microseconds_by_part(seconds: float) -> dict[str, float]:
    """The split of ``measure`` alone, in about ``seconds``."""
    environment = VectorNavigation(hybrid_config(), 0, WORLDS)
    actions = RandomActions(environment.config, WORLDS)
    best = max(_drive(environment, actions, seconds / (2 * _TURNS)) for _ in range(_TURNS))
    return _split(environment, 1e6 / best, seconds / 2)


def _turns(variants: dict[str, list[str]], seconds: float) -> dict[str, list[float]]:
    """Control steps per second under ``configs/lndrl.yaml`` on hybrid with each of the overrides,
    ``_TURNS`` times each.
    """
    environments = {
        name: VectorNavigation(hybrid_config(overrides), 0, WORLDS)
        for name, overrides in variants.items()
    }
    actions = RandomActions(next(iter(environments.values())).config, WORLDS)
    share = seconds / (_TURNS * len(environments))
    rates: dict[str, list[float]] = {name: [] for name in environments}
    for turn in range(_TURNS + 1):
        for name, environment in environments.items():
            rate = _drive(environment, actions, share)
            if turn > 0:  # the first warms up
                rates[name].append(rate)
    return rates


def _drive(environment: VectorNavigation, actions: RandomActions, seconds: float) -> float:
    """Control steps per second over about ``seconds``."""
    started = perf_counter()
    steps = 0
    while (elapsed := perf_counter() - started) < seconds or steps == 0:
        environment.step(actions())
        steps += len(environment)
    return steps / elapsed


def _split(environment: VectorNavigation, whole: float, seconds: float) -> dict[str, float]:
    batch = environment.worlds[0].batch
    world, shared = batch.world, batch.shared
    generator = np.random.default_rng(0)
    drawn = generator.integers(len(environment.actions), size=(_STEPS, len(environment)))
    commands: NDArray[np.float64] = environment.actions[drawn]
    moved = (world.robots, world.people, world.setting, world.scratch)

    def drives() -> None:
        for step in range(_STEPS):
            batch.drive(commands[step])

    def judged() -> None:
        for step in range(_STEPS):
            batch.drive(commands[step])
            batch.judge()

    variants: dict[str, Callable[[], Any]] = {
        "people": lambda: _only_people(*moved, commands, batch.task.ticks),
        "robot_and_contacts": lambda: _and_robots(
            *moved, commands, batch.task.ticks, 0, shared.ranges, batch.tracks.scan
        ),
        "laser": lambda: _and_robots(
            *moved, commands, batch.task.ticks, shared.stride, shared.ranges, batch.tracks.scan
        ),
        "localization": drives,
        "observation_and_reward": judged,
    }
    micros = {"episode_starts": 0.0}
    before = 0.0
    for part, run in variants.items():
        cost = _fastest_step(environment, run, seconds / len(variants))
        micros[part] = max(0.0, cost - before)
        before = max(cost, before)
    micros["episode_starts"] = _starts(environment)
    micros["python"] = max(0.0, whole - before - micros["episode_starts"])
    return micros


def _fastest_step(environment: VectorNavigation, run: Callable[[], Any], seconds: float) -> float:
    """Microseconds that ``run`` takes for one control step of one world, from fresh episodes."""
    times: list[float] = []
    environment.reset_all()
    run()
    while len(times) < REPETITIONS or sum(times) < seconds:
        environment.reset_all()
        started = perf_counter()
        run()
        times.append(perf_counter() - started)
    return 1e6 * min(times) / (_STEPS * len(environment))


def _starts(environment: VectorNavigation) -> float:
    """Microseconds of episode starts per control step under random actions."""
    actions = RandomActions(environment.config, len(environment))
    steps = ended = 0
    while ended < 100:
        ended += len(environment.step(actions()).episodes)
        steps += len(environment)
    times = []
    for _ in range(10):
        started = perf_counter()
        environment.reset_all()
        times.append(perf_counter() - started)
    return 1e6 * min(times) / len(environment) * ended / steps


def _megabytes(environment: VectorNavigation) -> float:
    batch = environment.worlds[0].batch
    states = (batch.world.robots, batch.world.people, batch.beliefs, batch.tracks)
    arrays = [array for state in states for array in state]
    arrays += vars(batch.observation).values()
    return sum(array.nbytes for array in arrays) / len(environment) / 1e6


@kernel()
def _only_people(robots, people, setting, scratch, commands, ticks):
    for _step in range(commands.shape[0]):
        for i in range(commands.shape[1]):
            robot = robot_row(robots, i)
            for _ in range(ticks):
                advance_people(
                    people_row(people, i), robot.pose, robot.command, setting.surroundings,
                    setting.crowd, scratch.crowd,
                )  # fmt: skip


@kernel()
def _and_robots(robots, people, setting, scratch, commands, ticks, stride, ranges, scans):
    """The whole drive but for the filter; without the laser where ``stride`` is 0."""
    for step in range(commands.shape[0]):
        for i in range(commands.shape[1]):
            robot, crowd = robot_row(robots, i), people_row(people, i)
            v, w = commands[step, i, 0], commands[step, i, 1]
            take_command(robot, v, w)
            for tick in range(ticks):
                tick_inline(robot, crowd, setting, scratch)
                last = tick == ticks - 1 or robot.contact[0] != 0
                if stride > 0:
                    noisy_scan(
                        setting.rays, setting.fan, robot.pose, crowd.legs[: 2 * crowd.count[0]],
                        setting.leg_radius, 1 if last else stride, robot.laser_random,
                        scratch.laser, scans[i] if last else ranges,
                    )  # fmt: skip
                if last:
                    break
