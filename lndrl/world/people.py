"""What the crowd's kernel reads and writes: people, where they are, how they walk, scratch."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lndrl.config import CrowdConfig
from lndrl.world.orca_walls import Walls
from lndrl.world.social_force import relaxation

ORCA, SFM = 0, 1

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class People(NamedTuple):
    """Up to P pedestrians of one world, or of W worlds with a leading dimension.

    ``position``, ``velocity`` (P + 1, 2): m and m/s in the map frame, row ``count[0]`` holds the
    robot while the kernel runs. ``route`` (P, waypoints, 2) m, ``route_length``, ``target``
    (index of the waypoint ahead), ``direction`` (+1 or -1 along the route), ``shuttle`` (walks
    back and forth), ``model`` (ORCA or SFM), ``heading`` (rad), ``travelled`` (m), all (P,);
    ``legs`` (2 P, 2): left and right leg of each; ``count`` (1,): rows that are alive.
    """

    position: Floats
    velocity: Floats
    route: Floats
    route_length: Integers
    target: Integers
    direction: Integers
    shuttle: NDArray[np.bool_]
    model: Integers
    heading: Floats
    travelled: Floats
    legs: Floats
    count: Integers  # type: ignore[assignment]  # hides tuple.count, which nobody needs

    def world(self, index: int) -> People:
        """Views of one world's rows."""
        return People(*(array[index] for array in self))


def make_people(worlds: int, capacity: int, waypoints: int) -> People:
    """Nobody, in arrays for ``worlds`` times ``capacity`` pedestrians with ``waypoints`` each."""
    shape = (worlds, capacity)
    return People(
        position=np.zeros((worlds, capacity + 1, 2)),
        velocity=np.zeros((worlds, capacity + 1, 2)),
        route=np.zeros((*shape, max(waypoints, 2), 2)),
        route_length=np.zeros(shape, dtype=np.int64),
        target=np.zeros(shape, dtype=np.int64),
        direction=np.ones(shape, dtype=np.int64),
        shuttle=np.zeros(shape, dtype=np.bool_),
        model=np.zeros(shape, dtype=np.int64),
        heading=np.zeros(shape),
        travelled=np.zeros(shape),
        legs=np.zeros((worlds, 2 * capacity, 2)),
        count=np.zeros((worlds, 1), dtype=np.int64),
    )


class Surroundings(NamedTuple):
    """What people walk in: ``distance`` float32 (h, w) (m, origin (0, 0)), cells per metre,
    and the walls that ORCA knows.
    """

    distance: NDArray[np.float32]
    inverse_resolution: float
    walls: Walls


class Scratch(NamedTuple):
    """Room to work in, for any world with at most as many people and walls.

    ``velocity``, ``force``, ``aim`` (P + 1, 2), ``feels`` (P + 1,); ``nearest``, ``distance2``
    (L,), ``lines`` and ``projected`` (L, 4) with L neighbours and edges.
    """

    velocity: Floats
    force: Floats
    aim: Floats
    feels: Integers
    nearest: Integers
    distance2: Floats
    lines: Floats
    projected: Floats


def make_scratch(capacity: int, config: CrowdConfig, walls: Walls) -> Scratch:
    """Scratch for worlds with up to ``capacity`` people between ``walls``."""
    lines = config.orca_max_neighbors + walls.most
    return Scratch(
        velocity=np.zeros((capacity + 1, 2)),
        force=np.zeros((capacity + 1, 2)),
        aim=np.zeros((capacity + 1, 2)),
        feels=np.zeros(capacity + 1, dtype=np.int64),
        nearest=np.zeros(lines, dtype=np.int64),
        distance2=np.zeros(lines),
        lines=np.zeros((lines, 4)),
        projected=np.zeros((lines, 4)),
    )


class CrowdParameters(NamedTuple):
    """What the kernel needs of ``CrowdConfig``, in its units, for one tick length."""

    tick: float
    max_speed: float
    waypoint_radius: float
    period: float
    neighbor_distance: float
    max_neighbors: int
    horizon: float
    horizon_obstacle: float
    orca_radius: float
    wall_radius: float
    desired: float
    social: float
    obstacle: float
    obstacle_sigma: float
    body_radius: float
    sfm_lambda: float
    sfm_gamma: float
    sfm_n: float
    sfm_n_prime: float
    cutoff: float
    decay: float
    gain: float
    leg_offset: float
    step_length: float
    see_robot: bool
    veer: float

    @classmethod
    def of(cls, config: CrowdConfig, tick: float) -> CrowdParameters:
        """Parameters for ticks of ``tick`` seconds."""
        decay, gain = relaxation(tick, config.model_period)
        return cls(
            tick=tick,
            max_speed=config.max_speed,
            waypoint_radius=config.waypoint_radius,
            period=config.model_period,
            neighbor_distance=config.orca_neighbor_distance,
            max_neighbors=config.orca_max_neighbors,
            horizon=config.orca_time_horizon,
            horizon_obstacle=config.orca_time_horizon_obstacle,
            orca_radius=config.orca_radius,
            wall_radius=config.orca_wall_radius,
            desired=config.sfm_desired,
            social=config.sfm_social,
            obstacle=config.sfm_obstacle,
            obstacle_sigma=config.sfm_obstacle_sigma,
            body_radius=config.sfm_radius,
            sfm_lambda=config.sfm_lambda,
            sfm_gamma=config.sfm_gamma,
            sfm_n=config.sfm_n,
            sfm_n_prime=config.sfm_n_prime,
            cutoff=config.sfm_cutoff,
            decay=decay,
            gain=gain,
            leg_offset=config.leg_offset,
            step_length=config.step_length,
            see_robot=config.see_robot,
            veer=float(np.tan(config.orca_veer)),
        )
