"""The crowd: waypoints, ORCA or social force per pedestrian, walls, gait. Arrays, no objects.

One kernel moves everybody by one tick. All new velocities come from the old positions, so the
order of pedestrians does not matter. Rules and constants: parameters §4.5.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from lndrl.config import CrowdConfig
from lndrl.maps.raycast import sample_field
from lndrl.world.orca import orca_velocity
from lndrl.world.social_force import obstacle_force, relaxation, social_force

ORCA, SFM = 0, 1
_STANDING = 0.05  # m/s; below it the legs keep their heading
_PASSED = 0.6  # m; a waypoint left behind within this distance counts as reached

# Forward offset of the right leg in step lengths over the eight phases; the left leg mirrors it.
GAIT = np.array([0.0, 0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5])


class CrowdParameters(NamedTuple):
    """What the kernel needs of ``CrowdConfig``, in its units, for one tick length."""

    tick: float
    max_speed: float
    waypoint_radius: float
    period: float
    neighbor_distance: float
    max_neighbors: int
    horizon: float
    orca_radius: float
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
            orca_radius=config.orca_radius,
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
        )


class Crowd:
    """State of up to ``capacity`` pedestrians; the first ``count`` rows are alive.

    ``position``, ``velocity`` (capacity + 1, 2): m and m/s in the map frame, row ``count`` holds
    the robot while the kernel runs. ``route`` (capacity, W, 2) waypoints, ``route_length``,
    ``target`` (index of the waypoint ahead), ``direction`` (+1 or -1 along the route),
    ``shuttle`` (walks back and forth), ``model`` (ORCA or SFM), ``heading`` (rad),
    ``travelled`` (m), ``legs`` (2 * capacity, 2): left and right leg of each.
    """

    def __init__(self, capacity: int, waypoints: int, config: CrowdConfig, tick: float) -> None:
        self.capacity = capacity
        self.count = 0
        self.parameters = CrowdParameters.of(config, tick)
        self.position = np.zeros((capacity + 1, 2))
        self.velocity = np.zeros((capacity + 1, 2))
        self.route = np.zeros((capacity, max(waypoints, 2), 2))
        self.route_length = np.zeros(capacity, dtype=np.int64)
        self.target = np.zeros(capacity, dtype=np.int64)
        self.direction = np.ones(capacity, dtype=np.int64)
        self.shuttle = np.zeros(capacity, dtype=np.bool_)
        self.model = np.zeros(capacity, dtype=np.int64)
        self.heading = np.zeros(capacity)
        self.travelled = np.zeros(capacity)
        self.legs = np.zeros((2 * capacity, 2))
        neighbors = config.orca_max_neighbors
        self._new_velocity = np.zeros((capacity + 1, 2))
        self._neighbors = np.zeros(neighbors + 1, dtype=np.int64)
        self._lines = np.zeros((2, neighbors, 4))

    def place_legs(self) -> None:
        """Recompute the legs from position, heading and distance travelled."""
        p = self.parameters
        place_legs(
            self.count,
            self.position,
            self.heading,
            self.travelled,
            p.step_length,
            p.leg_offset,
            self.legs,
        )

    def advance(
        self, robot_pose: Any, robot_command: Any, distance: Any, inverse_resolution: float
    ) -> None:
        """Move everybody by one tick; they see the robot where ``robot_pose`` says.

        ``robot_pose`` [x, y, yaw] (m, rad), ``robot_command`` [v, w]; ``distance`` is the map's
        distance field (float32, origin (0, 0)).
        """
        advance_crowd(
            self.count,
            self.position,
            self.velocity,
            self.route,
            self.route_length,
            self.target,
            self.direction,
            self.shuttle,
            self.model,
            self.heading,
            self.travelled,
            self.legs,
            robot_pose,
            robot_command,
            distance,
            inverse_resolution,
            self.parameters,
            self._new_velocity,
            self._neighbors,
            self._lines,
        )


@njit(cache=True, nogil=True)
def _choose_target(i, position, route, route_length, target, direction, shuttle, reach):
    """Advance the waypoint of pedestrian ``i`` when reached; True: arrived for good."""
    here = target[i]
    dx = route[i, here, 0] - position[i, 0]
    dy = route[i, here, 1] - position[i, 1]
    distance2 = dx * dx + dy * dy
    last = route_length[i] - 1
    final = (here == last and direction[i] > 0) or (here == 0 and direction[i] < 0)
    reached = distance2 < reach * reach
    if not reached and not final and distance2 < _PASSED * _PASSED:
        # Pushed aside at a corner: do not turn back for a point that lies behind.
        before = here - direction[i]
        if before >= 0 and before <= last:
            along = (route[i, here, 0] - route[i, before, 0]) * dx + (
                route[i, here, 1] - route[i, before, 1]
            ) * dy
            reached = along < 0.0
    if not reached:
        return False
    if final:
        if not shuttle[i]:
            return True
        direction[i] = -direction[i]
    target[i] = here + direction[i]
    return False


@njit(cache=True, nogil=True)
def _walk(i, position, velocity, distance, inverse_resolution, tick, radius):
    """Move pedestrian ``i`` by one tick without entering walls; returns metres walked."""
    x = position[i, 0]
    y = position[i, 1]
    new_x = x + velocity[i, 0] * tick
    new_y = y + velocity[i, 1] * tick
    clearance = radius + 0.5 / inverse_resolution
    room = sample_field(distance, inverse_resolution, new_x, new_y)
    if room < clearance:
        old_room = sample_field(distance, inverse_resolution, x, y)
        if room < old_room:
            # Slide along the wall where one axis alone keeps clear, else stand still.
            if sample_field(distance, inverse_resolution, new_x, y) >= min(clearance, old_room):
                new_y = y
            elif sample_field(distance, inverse_resolution, x, new_y) >= min(clearance, old_room):
                new_x = x
            else:
                new_x, new_y = x, y
            velocity[i, 0] = (new_x - x) / tick
            velocity[i, 1] = (new_y - y) / tick
    position[i, 0] = new_x
    position[i, 1] = new_y
    return np.sqrt((new_x - x) ** 2 + (new_y - y) ** 2)


@njit(cache=True, nogil=True)
def place_legs(count, position, heading, travelled, step_length, leg_offset, legs):
    """Legs (2i: left, 2i + 1: right) by the eight-phase gait; a phase per step length."""
    for i in range(count):
        phase = int(travelled[i] / step_length) % 8
        forward = GAIT[phase] * step_length
        c = np.cos(heading[i])
        s = np.sin(heading[i])
        x = position[i, 0]
        y = position[i, 1]
        legs[2 * i, 0] = x - forward * c - leg_offset * s
        legs[2 * i, 1] = y - forward * s + leg_offset * c
        legs[2 * i + 1, 0] = x + forward * c + leg_offset * s
        legs[2 * i + 1, 1] = y + forward * s - leg_offset * c


@njit(cache=True, nogil=True)
def _sfm_velocity(i, agents, silent, ux, uy, position, velocity, distance, inverse_resolution, p):
    """New velocity by the social force model towards the unit vector (ux, uy), (0, 0): none."""
    force_x, force_y = social_force(
        i,
        position,
        velocity,
        agents,
        p.sfm_lambda,
        p.sfm_gamma,
        p.sfm_n,
        p.sfm_n_prime,
        p.cutoff,
        silent,
    )
    force_x = p.social * force_x + p.desired * ux
    force_y = p.social * force_y + p.desired * uy
    if p.obstacle > 0.0:
        wall_x, wall_y = obstacle_force(
            distance,
            inverse_resolution,
            position[i, 0],
            position[i, 1],
            p.body_radius,
            p.obstacle_sigma,
        )
        force_x += p.obstacle * wall_x
        force_y += p.obstacle * wall_y
    vx = p.decay * velocity[i, 0] + p.gain * force_x
    vy = p.decay * velocity[i, 1] + p.gain * force_y
    speed = np.sqrt(vx * vx + vy * vy)
    if speed > p.max_speed:
        vx *= p.max_speed / speed
        vy *= p.max_speed / speed
    return vx, vy


@njit(cache=True, nogil=True)
def advance_crowd(
    count,
    position,
    velocity,
    route,
    route_length,
    target,
    direction,
    shuttle,
    model,
    heading,
    travelled,
    legs,
    robot_pose,
    robot_command,
    distance,
    inverse_resolution,
    p,
    new_velocity,
    neighbors,
    lines,
):
    """One tick of the whole crowd; shapes as in ``Crowd``, ``p`` is ``CrowdParameters``."""
    agents = count
    silent = -1
    if p.see_robot:
        agents = count + 1
        silent = count
        position[count, 0] = robot_pose[0]
        position[count, 1] = robot_pose[1]
        velocity[count, 0] = robot_command[0] * np.cos(robot_pose[2])
        velocity[count, 1] = robot_command[0] * np.sin(robot_pose[2])
    for i in range(count):
        arrived = _choose_target(
            i, position, route, route_length, target, direction, shuttle, p.waypoint_radius
        )
        dx = route[i, target[i], 0] - position[i, 0]
        dy = route[i, target[i], 1] - position[i, 1]
        length = np.sqrt(dx * dx + dy * dy)
        if model[i] == SFM:
            ux, uy = 0.0, 0.0
            if not arrived and length > 1e-9:
                ux, uy = dx / length, dy / length
            new_velocity[i, 0], new_velocity[i, 1] = _sfm_velocity(
                i, agents, silent, ux, uy, position, velocity, distance, inverse_resolution, p
            )
        else:
            if arrived:
                dx, dy = 0.0, 0.0
            elif length > 1.0:
                dx, dy = dx / length, dy / length
            new_velocity[i, 0], new_velocity[i, 1] = orca_velocity(
                i,
                position,
                velocity,
                agents,
                dx,
                dy,
                p.neighbor_distance,
                p.max_neighbors,
                p.horizon,
                p.orca_radius,
                p.max_speed,
                p.period,
                neighbors,
                lines[0],
                lines[1],
            )
    for i in range(count):
        velocity[i, 0] = new_velocity[i, 0]
        velocity[i, 1] = new_velocity[i, 1]
        travelled[i] += _walk(
            i, position, velocity, distance, inverse_resolution, p.tick, p.body_radius
        )
        if velocity[i, 0] ** 2 + velocity[i, 1] ** 2 > _STANDING * _STANDING:
            heading[i] = np.arctan2(velocity[i, 1], velocity[i, 0])
    place_legs(count, position, heading, travelled, p.step_length, p.leg_offset, legs)
