"""Kernels compiled ahead, by a process that waits for others who will need them.

Those who step worlds all come to the same kernels in the same order, and each kernel is compiled by
one process alone (``lndrl.kernels``). So whoever has nothing to do meanwhile, a learner without
samples or the parent of workers, begins at the other end, and two cores are busy instead of one.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Thread

import numpy as np

from lndrl.config import RunConfig
from lndrl.kernels import is_kept

# What is compiled is imported where it is: a learner, whose kernels are kept, needs no simulator.

_MAP = 40  # cells of the map that a filter is tried on

Work = Callable[[RunConfig], None]

logger = logging.getLogger("lndrl")


@contextmanager
def compiling_ahead(config: RunConfig, training: bool = True) -> Iterator[None]:
    """Compile in a thread of its own, while this lasts or longer, what ``config`` will need.

    ``training``: with its teacher. Does nothing where all is kept. What goes wrong there is left to
    those who will need it.
    """
    if missing := _missing(config, training):
        # daemon: nobody waits for a kernel when the program ends.
        Thread(target=_compile, args=(config, missing), name="ahead", daemon=True).start()
    yield


def compile_missing(config: RunConfig, training: bool = True) -> None:
    """The same here and now, for a process that has nothing else to do."""
    _compile(config, _missing(config, training))


def _missing(config: RunConfig, training: bool) -> list[Work]:
    """What has to be done, in the order opposite to that of who steps worlds."""
    work: list[tuple[str, str, Work]] = []
    if config.localization.kind == "amcl":
        work.append(("lndrl.localization.update", "update_belief", _localize))
    if training and config.ppo.teacher is not None:
        work.append(("lndrl.planners.rollouts", "decide", _teach))
    if training and config.learner.device == "cpu":
        work.append(("lndrl.policy.sparse.scan", "windows_gradient", _learn))
    work.append(("lndrl.navigation.step", "drive_worlds", _step))
    work.append(("lndrl.navigation.step", "judge_worlds", _step))
    return list(dict.fromkeys(each for module, name, each in work if not is_kept(module, name)))


def _compile(config: RunConfig, missing: list[Work]) -> None:
    try:
        for each in missing:
            each(config)
    except Exception:
        logger.debug("kernels could not be compiled ahead", exc_info=True)


def _localize(config: RunConfig) -> None:
    """A filter's first update, in the middle of an empty room; called as worlds call it."""
    from lndrl.localization import LikelihoodMap, belief
    from lndrl.localization.bins import make_bins
    from lndrl.localization.resampling import kld_limits
    from lndrl.localization.update import reset_belief, update_belief
    from lndrl.maps.grid import OccupancyGrid

    laser, localization = config.world.laser, config.localization
    walls = np.ones((_MAP, _MAP), bool)
    walls[1:-1, 1:-1] = False
    grid = OccupancyGrid(walls, config.scenario.resolution)
    middle = np.array([0.5 * _MAP * grid.resolution] * 2 + [0.0])
    robot = belief.belief_of(belief.make_beliefs(1, localization), 0)
    scratch, bins = belief.make_scratch(localization, laser), make_bins(localization)
    reset_belief(middle, np.array(localization.initial_deviations), robot, scratch, bins)
    readings = np.full(2, laser.range_max, np.float32)
    update_belief(
        middle, readings, np.zeros(2, np.float32), robot, scratch, bins, kld_limits(localization),
        belief.make_field(LikelihoodMap.build(grid, localization, laser)),
        belief.make_settings(localization, laser), True,
    )  # fmt: skip


def _teach(config: RunConfig) -> None:
    """The teacher's costs of one observation."""
    from lndrl.navigation import Observation
    from lndrl.planners import teacher_of

    planner = teacher_of(config)
    planner.reset(config.seed, [0])
    planner.costs(Observation.zeros_for(1, config), np.zeros(1, np.int64))


def _step(config: RunConfig) -> None:
    """A control step of no worlds at all."""
    from lndrl.navigation import Observation
    from lndrl.navigation.batch import NavigationBatch
    from lndrl.navigation.navigation import build_surroundings

    place, field = build_surroundings(config)
    batch = NavigationBatch(place, field, config, 1, Observation.zeros_for(1, config))
    batch.judge(0, 0)
    batch.drive(np.zeros((0, 2)))


def _learn(config: RunConfig) -> None:
    """A gradient of nothing in particular."""
    from lndrl.navigation import Observation
    from lndrl.policy import build_policy, prepare, supports_sparse

    if supports_sparse(config):
        observation = Observation.zeros_for(1, config)
        observation.pedestrian_count[:] = 1
        build_policy(config)(prepare(observation, config)).sum().backward()
