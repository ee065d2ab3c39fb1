"""The crowd: waypoints, ORCA or social force per pedestrian, walls, gait. Arrays, no objects.

One kernel moves everybody by one tick. All new velocities come from the old positions, so the
order of pedestrians does not matter. Rules and constants: parameters §4.5.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lndrl.config import CrowdConfig
from lndrl.kernels import kernel
from lndrl.maps.raycast import sample_field
from lndrl.world.elementary import angle_of
from lndrl.world.orca import orca_velocity
from lndrl.world.orca_walls import Walls, build_walls, tile_of, wall_lines
from lndrl.world.people import (
    ORCA,
    SFM,
    CrowdParameters,
    People,
    Scratch,
    Surroundings,
    make_people,
    make_scratch,
)
from lndrl.world.social_force import obstacle_force, social_forces

__all__ = [
    "GAIT",
    "ORCA",
    "SFM",
    "Crowd",
    "advance_people",
    "place_legs",
    "wall_reach",
    "walls_for",
]

_STANDING = 0.05  # m/s; below it the legs keep their heading
_PASSED = 0.6  # m; a waypoint left behind within this distance counts as reached

# Forward offset of the right leg in step lengths over the eight phases; the left leg mirrors it.
GAIT = np.array([0.0, 0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5])


def walls_for(outlines: Any, config: CrowdConfig) -> Walls:
    """What a crowd with ``config`` knows of closed ``outlines`` (see ``build_walls``)."""
    return build_walls(outlines if config.orca_walls else (), wall_reach(config))


def wall_reach(config: CrowdConfig) -> float:
    """Metres to the farthest wall that somebody who knows the walls looks at."""
    return config.orca_time_horizon_obstacle * config.max_speed + config.orca_wall_radius


class Crowd:
    """Up to ``capacity`` pedestrians of one world; the first ``count`` rows are alive.

    ``people`` is their state; its arrays are also attributes of the crowd. ``walls`` are what
    ORCA avoids (default: none), ``state`` arrays from elsewhere to work in.
    """

    def __init__(
        self,
        capacity: int,
        waypoints: int,
        config: CrowdConfig,
        tick: float,
        walls: Walls | None = None,
        state: People | None = None,
    ) -> None:
        self.capacity = capacity
        self.parameters = CrowdParameters.of(config, tick)
        self.walls = build_walls((), 0.0) if walls is None else walls
        self.people = make_people(1, capacity, waypoints).world(0) if state is None else state
        self.position = self.people.position
        self.velocity = self.people.velocity
        self.route = self.people.route
        self.route_length = self.people.route_length
        self.target = self.people.target
        self.direction = self.people.direction
        self.shuttle = self.people.shuttle
        self.model = self.people.model
        self.heading = self.people.heading
        self.travelled = self.people.travelled
        self.legs = self.people.legs
        self.scratch = make_scratch(capacity, config, self.walls)
        self._distance: NDArray[np.float32] | None = None
        self._workplace: tuple[Any, ...] = ()

    @property
    def count(self) -> int:
        """How many pedestrians there are."""
        return int(self.people.count[0])

    @count.setter
    def count(self, count: int) -> None:
        if not 0 <= count <= self.capacity:
            raise ValueError(f"{count} pedestrians in a crowd with room for {self.capacity}")
        self.people.count[0] = count

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
        self,
        robot_pose: NDArray[np.float64],
        robot_command: NDArray[np.float64],
        distance: NDArray[np.float32],
        inverse_resolution: float,
    ) -> None:
        """Move everybody by one tick; they see the robot where ``robot_pose`` says.

        ``robot_pose`` [x, y, yaw] (m, rad), ``robot_command`` [v, w]; ``distance`` is the map's
        distance field (float32, origin (0, 0)).
        """
        if self._distance is not distance:
            # Plain tuples: numba looks at a NamedTuple of a call from Python for about 4 us.
            self._workplace = (
                tuple(self.people),
                (distance, inverse_resolution, tuple(self.walls)),
                tuple(self.parameters),
                tuple(self.scratch),
            )
            self._distance = distance
        _advance(self._workplace, robot_pose, robot_command)


@kernel(error_model="numpy", _nrt=False, forceinline=True)
def _choose_target(i, position, route, route_length, target, direction, shuttle, reach):
    """Advance the waypoint of pedestrian ``i`` when reached; True: arrived for good."""
    here = min(max(target[i], 0), route.shape[1] - 1)
    dx = route[i, here, 0] - position[i, 0]
    dy = route[i, here, 1] - position[i, 1]
    distance2 = dx * dx + dy * dy
    if distance2 >= max(reach, _PASSED) ** 2:
        return False
    last = min(route_length[i], route.shape[1]) - 1
    step = direction[i]
    final = (here == last and step > 0) or (here == 0 and step < 0)
    reached = distance2 < reach * reach
    if not reached and not final and distance2 < _PASSED * _PASSED:
        # Pushed aside at a corner: do not turn back for a point that lies behind.
        before = here - step
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
        direction[i] = -step
    target[i] = here + direction[i]
    return False


@kernel(error_model="numpy", _nrt=False, forceinline=True)
def _aim(count, people, reach, feels, aim):
    """Where everybody wants to go: preferred velocity (ORCA) or direction (SFM), into ``aim``.

    Returns whether anybody follows the social force model; ``feels`` says who.
    """
    position, route, model = people.position, people.route, people.model
    social = False
    for i in range(count):
        arrived = _choose_target(
            i,
            position,
            route,
            people.route_length,
            people.target,
            people.direction,
            people.shuttle,
            reach,
        )
        here = min(max(people.target[i], 0), route.shape[1] - 1)
        dx = route[i, here, 0] - position[i, 0]
        dy = route[i, here, 1] - position[i, 1]
        length = np.sqrt(dx * dx + dy * dy)
        feels[i] = model[i] == SFM
        social = social or model[i] == SFM
        if arrived or length < 1e-9:
            dx, dy = 0.0, 0.0
        elif length > 1.0 or model[i] == SFM:
            dx, dy = dx / length, dy / length
        aim[i, 0] = dx
        aim[i, 1] = dy
    return social


@kernel(error_model="numpy", _nrt=False, forceinline=True)
def _keep_right(i, position, agents, reach, slope, aim):
    """Turn the aim of ``i`` to the right by atan(slope) while somebody within ``reach`` is ahead.

    Two who meet head-on push each other straight back and never pass otherwise.
    """
    x, y = position[i, 0], position[i, 1]
    ax, ay = aim[i, 0], aim[i, 1]
    for other in range(agents):
        dx, dy = position[other, 0] - x, position[other, 1] - y
        if dx * dx + dy * dy < reach * reach and dx * ax + dy * ay > 0.0:
            scale = 1.0 / np.sqrt(1.0 + slope * slope)
            aim[i, 0] = scale * (ax + slope * ay)
            aim[i, 1] = scale * (ay - slope * ax)
            return


@kernel(error_model="numpy", _nrt=False, forceinline=True)
def _sfm_velocity(i, position, velocity, force, aim, distance, inverse_resolution, p):
    """New velocity by repulsion ``force``, ``aim`` (a unit vector or none) and walls."""
    fx = p.social * force[i, 0] + p.desired * aim[i, 0]
    fy = p.social * force[i, 1] + p.desired * aim[i, 1]
    if p.obstacle > 0.0:
        wall_x, wall_y = obstacle_force(
            distance,
            inverse_resolution,
            position[i, 0],
            position[i, 1],
            p.body_radius,
            p.obstacle_sigma,
        )
        fx += p.obstacle * wall_x
        fy += p.obstacle * wall_y
    vx = p.decay * velocity[i, 0] + p.gain * fx
    vy = p.decay * velocity[i, 1] + p.gain * fy
    speed = np.sqrt(vx * vx + vy * vy)
    if speed > p.max_speed:
        vx *= p.max_speed / speed
        vy *= p.max_speed / speed
    return vx, vy


@kernel(error_model="numpy", _nrt=False, forceinline=True)
def _orca_velocity(i, agents, people, walls, p, scratch):
    """New velocity by ORCA towards ``scratch.aim``, among people and walls."""
    position, velocity, aim = people.position, people.velocity, scratch.aim
    if p.veer > 0.0:
        _keep_right(i, position, agents, 2.0 * p.orca_radius, p.veer, aim)
    x, y = position[i, 0], position[i, 1]
    tile = tile_of(x, y, walls.rows, walls.columns, walls.left, walls.bottom)
    firm = 0
    if tile >= 0 and walls.starts[tile] < walls.starts[tile + 1]:
        firm = wall_lines(
            x,
            y,
            velocity[i, 0],
            velocity[i, 1],
            walls.edges,
            walls.members,
            walls.starts[tile],
            walls.starts[tile + 1],
            p.wall_radius,
            p.horizon_obstacle,
            p.max_speed,
            scratch.nearest,
            scratch.distance2,
            scratch.lines,
        )
    return orca_velocity(
        i,
        position,
        velocity,
        agents,
        aim[i, 0],
        aim[i, 1],
        firm,
        p.neighbor_distance,
        p.max_neighbors,
        p.horizon,
        p.orca_radius,
        p.max_speed,
        p.period,
        scratch.nearest,
        scratch.distance2,
        scratch.lines,
        scratch.projected,
    )


@kernel(error_model="numpy", _nrt=False, forceinline=True)
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


@kernel(error_model="numpy", _nrt=False, forceinline=True)
def _put_legs(i, position, travelled, c, s, step_length, leg_offset, legs):
    """Legs of pedestrian ``i``, who looks along the unit vector (c, s)."""
    phase = int(travelled[i] / step_length) % 8
    forward = GAIT[phase] * step_length
    x = position[i, 0]
    y = position[i, 1]
    legs[2 * i, 0] = x - forward * c - leg_offset * s
    legs[2 * i, 1] = y - forward * s + leg_offset * c
    legs[2 * i + 1, 0] = x + forward * c + leg_offset * s
    legs[2 * i + 1, 1] = y + forward * s - leg_offset * c


@kernel(error_model="numpy", _nrt=False)
def place_legs(count, position, heading, travelled, step_length, leg_offset, legs):
    """Legs (2i: left, 2i + 1: right) by the eight-phase gait; a phase per step length."""
    for i in range(min(count, len(heading), len(legs) // 2)):
        c, s = np.cos(heading[i]), np.sin(heading[i])
        _put_legs(i, position, travelled, c, s, step_length, leg_offset, legs)


@kernel(error_model="numpy", _nrt=False, forceinline=True)
def _move(count, people, new_velocity, distance, inverse_resolution, p):
    """Everybody walks a tick with ``new_velocity``, as far as walls let them; then the legs."""
    position, velocity, heading = people.position, people.velocity, people.heading
    travelled, legs = people.travelled, people.legs
    for i in range(count):
        velocity[i, 0] = new_velocity[i, 0]
        velocity[i, 1] = new_velocity[i, 1]
        travelled[i] += _walk(
            i, position, velocity, distance, inverse_resolution, p.tick, p.body_radius
        )
        vx, vy = velocity[i, 0], velocity[i, 1]
        speed = np.sqrt(vx * vx + vy * vy)
        if speed > _STANDING:
            heading[i] = angle_of(vy, vx)
            c, s = vx / speed, vy / speed
        else:
            c, s = np.cos(heading[i]), np.sin(heading[i])
        _put_legs(i, position, travelled, c, s, p.step_length, p.leg_offset, legs)


# Without reference counts (``_nrt``): taking arrays out of tuples would cost more than the tick.
@kernel(error_model="numpy", _nrt=False)
def advance_people(people, robot_pose, robot_command, surroundings, p, scratch):
    """One tick of one world's crowd: ``People``, pose [x, y, yaw], command [v, w],
    ``Surroundings``, ``CrowdParameters``, ``Scratch``.
    """
    position, velocity, new_velocity = people.position, people.velocity, scratch.velocity
    feels, aim, force = scratch.feels, scratch.aim, scratch.force
    distance, inverse_resolution = surroundings.distance, surroundings.inverse_resolution
    # What there is room for, whatever the state says.
    count = max(0, min(people.count[0], len(people.heading), len(feels) - 1))
    agents = count
    silent = -1
    if p.see_robot:
        agents = count + 1
        silent = count
        feels[count] = 0
        position[count, 0] = robot_pose[0]
        position[count, 1] = robot_pose[1]
        velocity[count, 0] = robot_command[0] * np.cos(robot_pose[2])
        velocity[count, 1] = robot_command[0] * np.sin(robot_pose[2])
    if _aim(count, people, p.waypoint_radius, feels, aim):
        social_forces(
            position,
            velocity,
            feels,
            agents,
            p.sfm_lambda,
            p.sfm_gamma,
            p.sfm_n,
            p.sfm_n_prime,
            p.cutoff,
            silent,
            force,
        )
    for i in range(count):
        if feels[i] != 0:
            vx, vy = _sfm_velocity(
                i, position, velocity, force, aim, distance, inverse_resolution, p
            )
        else:
            vx, vy = _orca_velocity(i, agents, people, surroundings.walls, p, scratch)
        new_velocity[i, 0] = vx
        new_velocity[i, 1] = vy
    _move(count, people, new_velocity, distance, inverse_resolution, p)


@kernel()
def _advance(workplace, robot_pose, robot_command):
    people, around, parameters, scratch = workplace
    advance_people(
        People(*people), robot_pose, robot_command,
        Surroundings(around[0], around[1], Walls(*around[2])),
        CrowdParameters(*parameters), Scratch(*scratch),
    )  # fmt: skip
