"""Robots that cannot change their velocities at once: the rule, the world, many at a time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lndrl.config import RobotConfig, WorldConfig
from lndrl.errors import UserError
from lndrl.models import effective, validate
from lndrl.randomness import stream_state
from lndrl.world.odometry import accelerate, drive, follow, poses_along, velocities

speeds = st.floats(-2.0, 2.0)
rates = st.floats(0.05, 20.0)
INFINITE = (math.inf, math.inf, math.inf)


@given(speeds, speeds, rates, rates)
def test_the_rule_against_a_thousand_small_steps(
    speed: float, command: float, gain: float, loss: float
) -> None:
    slow = speed
    for _ in range(1000):
        most = (loss if slow * (command - slow) < 0.0 else gain) * 0.0004
        change = command - slow
        if slow * command < 0.0 and abs(slow) < most:
            slow = 0.0  # standing, before it goes the other way
        else:
            slow += math.copysign(min(abs(change), most), change)
    step = 0.0004 * max(gain, loss)
    assert follow(speed, command, gain, loss, 0.4) == pytest.approx(slow, abs=3.0 * step)


@given(speeds, speeds, speeds, speeds)
def test_without_limits_a_command_holds_at_once(a: float, b: float, c: float, d: float) -> None:
    velocity = np.array([a, b])
    accelerate(velocity, np.array([c, d]), INFINITE, 0.1)
    assert velocity.tolist() == [c, d]


@given(speeds, speeds, speeds, speeds, rates, rates, rates)
def test_many_at_a_time_do_what_one_does(
    a: float, b: float, c: float, d: float, gain: float, loss: float, turn: float
) -> None:
    limits, command = (gain, loss, turn), np.array([c, d])
    pose, velocity, one = np.zeros(3), np.array([a, b]), []
    for _ in range(4):
        accelerate(velocity, command, limits, 0.1)
        drive(pose, velocity[0], velocity[1], 0.1)
        one.append(velocity.copy())
    many = velocities(np.array([a, b]), np.tile(command, (3, 1)), limits, 0.1, 4)
    assert many[1] == pytest.approx(np.array(one))
    along = poses_along(many, 0.1, np.array([0.0, 0.15, 0.4]))[2]
    assert along[0] == pytest.approx(np.zeros(3))
    assert along[2, :2] == pytest.approx(pose[:2], abs=1e-12)
    assert math.cos(along[2, 2] - pose[2]) == pytest.approx(1.0)
    half = along[1]
    middle = np.zeros(3)
    drive(middle, one[0][0], one[0][1], 0.1)
    drive(middle, one[1][0], one[1][1], 0.05)
    assert half[:2] == pytest.approx(middle[:2], abs=1e-12)


def test_limits_are_named_or_given_and_off_by_default() -> None:
    assert WorldConfig().robot.acceleration.limits == INFINITE
    named = WorldConfig.model_validate({"robot": "turtlebot2"}).robot
    assert named.acceleration.limits == (1.0, 1.0, 2.0)
    own = RobotConfig.model_validate({"acceleration": {"linear": 0.5, "braking": 2.0}})
    assert own.acceleration.limits == (0.5, 2.0, math.inf)
    with pytest.raises(UserError, match="preset 'turtlebot9' is unknown; known: immediate, turtle"):
        validate(WorldConfig, {"robot": "turtlebot9"}, "here")
    with pytest.raises(UserError, match=r"robot.acceleration.linear = 0"):
        validate(WorldConfig, {"robot": {"acceleration": {"linear": 0}}}, "here")


def test_a_world_without_limits_hashes_as_before() -> None:
    """The bench was frozen before there was a key for them."""
    assert "robot" not in effective(WorldConfig())
    assert "robot" in effective(WorldConfig.model_validate({"robot": "turtlebot2"}))


def test_the_state_of_slip_is_the_velocity_s() -> None:
    """Wheels slip by what they do, not by what they are told."""
    from lndrl.world.robot import make_robots, robot_of, take_command

    robot = robot_of(make_robots(1, 0.1), 0)
    robot.odometry_random[:] = stream_state(3)
    take_command(robot, 0.6, 0.0)
    assert robot.command.tolist() == [0.6, 0.0] and robot.velocity.tolist() == [0.0, 0.0]
