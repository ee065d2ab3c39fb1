"""Driving episodes of the bench again, with everything that a picture of them needs.

A policy's episodes are driven in the whole block that ``lndrl benchmark`` drives them in: what it
does depends, by rounding, on which episodes share its batch.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.evaluation.benchmark.spec import BenchmarkSpec, Contender, bench_config, contenders
from lndrl.evaluation.episodes import EpisodeRunner
from lndrl.evaluation.runner import BLOCK
from lndrl.navigation import EpisodeRecord, Navigation, WorldSnapshot
from lndrl.navigation.families import Family, episode_of
from lndrl.navigation.reward import angle_error, position_error
from lndrl.planners import has_weights, is_rule, planner_source
from lndrl.policy import act_on_one_thread
from lndrl.world.contacts import Hit

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Drive:
    """One episode over time: the start and the end of each of its T control steps.

    Map frame, metres, radians, seconds. Errors are those of what is heard against where the robot
    is, but for ``judged_error`` (m, rad), which the end was judged by (``task.judged_moment``).
    ``hit`` is what the robot touched at the end.
    """

    method: str
    scenario: str
    record: EpisodeRecord
    hit: Hit
    time: Floats  # (T + 1,)
    pose_true: Floats  # (T + 1, 3)
    pose_estimated: Floats  # (T + 1, 3)
    position_error: Floats  # (T + 1,) m
    angle_error: Floats  # (T + 1,) rad
    judged_error: tuple[float, float]
    people: Floats  # (T + 1, P, 2)
    end: WorldSnapshot
    lost_distance: float
    lost_angle: float

    @property
    def episode(self) -> int:
        """The number that its family gives the episode."""
        return episode_of(self.record.world)

    @property
    def reason(self) -> str:
        """Why and when the episode ended, in words."""
        after = f"after {self.record.time:.1f} s"
        if self.record.outcome == "collided":
            what = "a person" if self.hit == "pedestrian" else "a wall"
            return f"collided with {what} {after}"
        if self.record.outcome == "lost":
            # Either limit ends an episode; the position says more where both are passed.
            metres, radians = self.judged_error
            if metres > self.lost_distance:
                return f"lost: {metres:.1f} m off {after}"
            return f"lost: {math.degrees(radians):.0f}° off {after}"
        if self.record.outcome == "timeout":
            away = float(np.hypot(*(self.end.goal - self.pose_true[-1, :2])))
            return f"out of time {away:.1f} m from the goal"
        return f"arrived {after}, {self.record.position_error:.2f} m off on average"


class Replay:
    """One method in one scenario of the bench under ``seed``, built once for any episodes.

    ``family`` says whose episodes, ``changes`` what is another than in the defaults.

    Raises UserError for an impossible scenario and for weights that do not fit.
    """

    def __init__(
        self,
        contender: Contender,
        scenario: str,
        seed: int,
        changes: Sequence[str] = (),
        family: Family = Family.BENCH,
    ) -> None:
        self.contender = contender
        self.config = bench_config(contender, scenario, seed, changes)
        if contender.source.weights is not None:
            act_on_one_thread(self.config)  # as in the bench
        self._runner = EpisodeRunner(contender.source, self.config, contender.greedy, family)

    def drive(
        self,
        episodes: Sequence[int],
        progress: Callable[[Drive], None] | None = None,
        watch: Callable[[Navigation], None] | None = None,
    ) -> list[Drive]:
        """Drive ``episodes``; in their order, ``progress`` gets each as it ends.

        ``watch`` is called for each of them at its start and after each of its control steps.
        """
        found: dict[int, Drive] = {}
        for block in self._blocks(episodes):
            cameras = {k: Camera() for k in block if k in episodes}

            def see(world: Navigation, cameras: dict[int, Camera] = cameras) -> None:
                camera = cameras.get(episode_of(world.world_id))
                if camera is not None:
                    camera(world)
                    if watch is not None:
                        watch(world)

            left = set(cameras)
            for record in self._runner(block, see):
                k = episode_of(record.world)
                if k not in left:
                    continue
                left.remove(k)
                found[k] = cameras[k].drive(record, self.contender.name, self.config)
                if progress is not None:
                    progress(found[k])
                if not left:
                    break  # nothing is left in the block that anybody asked for
        return [found[k] for k in episodes]

    def _blocks(self, episodes: Sequence[int]) -> list[Sequence[int]]:
        if self.contender.source.weights is None:
            return [[k] for k in episodes]  # a rule does the same whatever runs beside it
        firsts = dict.fromkeys(k - k % BLOCK for k in episodes)
        return [range(first, first + BLOCK) for first in firsts]


class Camera:
    """Keeps what a Drive has of one world; watches it at its start and after every step."""

    def __init__(self) -> None:
        self.time: list[float] = []
        self.pose_true: list[Floats] = []
        self.pose_estimated: list[Floats] = []
        self.position_error: list[float] = []
        self.angle_error: list[float] = []
        self.judged_error = 0.0, 0.0
        self.people: list[Floats] = []
        self.hit: Hit = ""
        self.end: WorldSnapshot | None = None

    def __call__(self, world: Navigation) -> None:
        true, estimated = world.world.pose_true, world.pose_heard
        self.time.append(world.world.time)
        self.pose_true.append(true.copy())
        self.pose_estimated.append(estimated.copy())
        self.position_error.append(float(position_error(true, estimated)))
        self.angle_error.append(float(angle_error(true, estimated)))
        self.people.append(world.world.pedestrian_position.copy())
        if world.outcome:
            judged = world.pose_judged
            self.judged_error = (
                float(position_error(judged, estimated)),
                float(angle_error(judged, estimated)),
            )
            self.hit = world.world.collided_with
            self.end = world.snapshot()

    def drive(self, record: EpisodeRecord, method: str, config: RunConfig) -> Drive:
        """The episode that has ended with ``record``, as ``method`` drove it under ``config``."""
        assert self.end is not None
        return Drive(
            method=method,
            scenario=config.scenario.name,
            record=record,
            hit=self.hit,
            time=np.array(self.time),
            pose_true=np.array(self.pose_true),
            pose_estimated=np.array(self.pose_estimated),
            position_error=np.array(self.position_error),
            angle_error=np.array(self.angle_error),
            judged_error=self.judged_error,
            people=np.array(self.people),
            end=self.end,
            lost_distance=config.task.lost_distance,
            lost_angle=config.task.lost_angle,
        )


def contender_named(spec: BenchmarkSpec, name: str, greedy: bool = False) -> Contender:
    """A method of the bench, a rule, what is in a run folder or weights file, or module:Class.

    Weights are called like their folder, a class of one's own like the class. Raises UserError for
    an unknown name, with near ones, and where there are no weights.
    """
    if name not in spec.methods and (is_rule(name) or has_weights(name)):
        source = planner_source(name)
        return Contender(source.label, source, "amcl", greedy)
    (found,), _ = contenders(spec, [name], greedy=greedy)
    return found


def contenders_named(spec: BenchmarkSpec, names: Sequence[str]) -> list[Contender]:
    """``contender_named`` for several, who must be told apart by name; raises UserError."""
    found = [contender_named(spec, name) for name in dict.fromkeys(names)]
    labels = [contender.name for contender in found]
    for label in labels:
        if labels.count(label) > 1:
            raise UserError(f"two methods are called {label}; name folders that differ")
    return found
