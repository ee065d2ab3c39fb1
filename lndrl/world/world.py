"""The truth of one world: robot, crowd, laser, odometer, contacts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lndrl.config import WorldConfig
from lndrl.randomness import Stream, stream_state, uniform
from lndrl.world.contacts import Contacts, Hit
from lndrl.world.laser import Laser
from lndrl.world.odometry import draw_slip, move_robot
from lndrl.world.pedestrians import Crowd
from lndrl.world.place import Place
from lndrl.world.placement import place_crowd

Floats = NDArray[np.float64]


class World:
    """One simulated world; knows nothing of beliefs and policies.

    Map frame, metres, radians, seconds; arrays are float64 and updated in place. ``pose_true``
    and ``start_pose`` [x, y, yaw], ``goal`` [x, y], ``command`` [v, w], ``pose_odometry``
    [x, y, yaw] with slip from (0, 0, 0) at the start. ``pedestrian_position``,
    ``pedestrian_velocity`` ``(P, 2)`` and ``leg_position`` ``(2P, 2)`` are views of this
    episode's P pedestrians. Call ``reset`` before anything else.
    """

    def __init__(self, place: Place, config: WorldConfig) -> None:
        people = place.scenario.pedestrians
        waypoints = 2 + max((len(route.via) for route in people.routes), default=0)
        self.place = place
        self.config = config
        self.crowd = Crowd(people.count[1], waypoints, config.crowd, config.tick)
        self.laser = Laser(config.laser, place.rays)
        self.pose_true = np.zeros(3)
        self.pose_odometry = np.zeros(3)
        self.start_pose = np.zeros(3)
        self.goal = np.zeros(2)
        self.command = np.zeros(2)
        self.time = 0.0
        self.collided_with: Hit = ""
        self._contacts = Contacts(
            place.scenario, config.robot_radius, config.crowd.leg_radius, 2 * people.count[1]
        )
        self._slip = np.ones(2)
        self._inverse_resolution = 1.0 / place.grid.resolution
        self._laser_state = stream_state(0)
        self._odometry_state = stream_state(0)
        self._set_views()

    def reset(self, seed: int, world_id: int, episode: int) -> None:
        """Start the episode that (seed, world_id, episode) stand for, bit for bit the same.

        Raises UserError when the scenario offers no start and goal (see ``Place.draw_task``).
        """
        layout = stream_state(seed, world_id, episode, Stream.LAYOUT)
        people = stream_state(seed, world_id, episode, Stream.PEDESTRIANS)
        self._laser_state = stream_state(seed, world_id, episode, Stream.LASER)
        self._odometry_state = stream_state(seed, world_id, episode, Stream.ODOMETRY)
        start, goal = self.place.draw_task(layout)
        self.start_pose[:] = (*start, np.pi * (2.0 * uniform(layout) - 1.0))
        self.pose_true[:] = self.start_pose
        self.goal[:] = goal
        self.pose_odometry[:] = 0.0
        self.command[:] = 0.0
        self._slip[:] = 1.0
        self.time = 0.0
        self.collided_with = ""
        place_crowd(self.crowd, self.place, self.config.crowd, self.pose_true, people)
        self._set_views()

    def begin_step(self, v: float, w: float) -> None:
        """Command v (m/s), w (rad/s) for the coming ticks; draws the odometer's slip."""
        self.command[0] = v
        self.command[1] = w
        draw_slip(self._slip, self.config.odometry_deviation, self._odometry_state)

    def tick(self) -> bool:
        """``config.tick`` seconds pass: people move, then the robot; True when it now touches
        something (``collided_with`` says what).
        """
        self.crowd.advance(
            self.pose_true, self.command, self.place.distance, self._inverse_resolution
        )
        move_robot(self.pose_true, self.pose_odometry, self.command, self._slip, self.config.tick)
        self.time += self.config.tick
        self.collided_with = self._contacts.hit(
            self.pose_true, self.leg_position, self.place.distance, self.place.grid.resolution
        )
        return self.collided_with != ""

    def scan(self) -> NDArray[np.float32]:
        """Ranges of all beams with noise (m, in [0, range_max]), a new ``(beams,)`` array."""
        return self.scan_sparse(1)

    def scan_sparse(self, stride: int) -> NDArray[np.float32]:
        """Ranges of beams 0, stride, 2 * stride, ... with noise (m), a new array."""
        return self.laser.scan(
            self.pose_true,
            self.leg_position,
            self.config.crowd.leg_radius,
            self._laser_state,
            stride,
        )

    def _set_views(self) -> None:
        count = self.crowd.count
        self.pedestrian_count = count
        self.pedestrian_position: Floats = self.crowd.position[:count]
        self.pedestrian_velocity: Floats = self.crowd.velocity[:count]
        self.leg_position: Floats = self.crowd.legs[: 2 * count]
