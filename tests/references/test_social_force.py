"""The social force beside PySocialForce, and libpedsim's step beside a slow twin.

- Repulsion between people: PySocialForce's ``SocialForce`` has the formula of Moussaid & Helbing
  (2009) that libpedsim has, with the same parameters. It does not wrap the angle between
  interaction and position into [-pi, pi], so its force depends on how the scene is turned: pairs
  are turned until their angle does not wrap, of crowds those count in whose sum none wraps.
- The rest of a step differs and is compared with the published formulas in NumPy: libpedsim
  halves the velocity every 0.4 s and adds the desired direction (PySocialForce: relaxation
  towards 1.3 times the first speed), and pushes from the nearest wall only, with
  exp(-(distance - radius) / sigma) (PySocialForce: sum over points of all walls).
"""

import contextlib
import logging
import tempfile

import numpy as np
import pytest

from lndrl.config import CrowdConfig
from lndrl.maps import distance_field
from lndrl.world.pedestrians import SFM, Crowd
from lndrl.world.social_force import social_forces

_level = logging.getLogger().level
with tempfile.TemporaryDirectory() as elsewhere, contextlib.chdir(elsewhere):
    psf = pytest.importorskip("pysocialforce")  # opens a log in the working folder
logging.getLogger().setLevel(_level)  # importing it turns everybody's debug messages on

LAMBDA, GAMMA, N, N_PRIME = 2.0, 0.35, 2.0, 3.0
FAR = 1e3  # m: PySocialForce has no cut-off


def theirs(position, velocity):
    goals = position + np.array([1.0, 0.0])
    simulator = psf.Simulator(np.hstack([position, velocity, goals]))
    force = next(f for f in simulator.forces if type(f).__name__ == "SocialForce")
    settings = (
        force.config("lambda_importance"),
        force.config("gamma"),
        force.config("n"),
        force.config("n_prime"),
    )
    assert settings == (LAMBDA, GAMMA, N, N_PRIME)
    return force.get_force() / force.factor


def ours(position, velocity):
    force = np.zeros((len(position), 2))
    everybody = np.ones(len(position), dtype=np.int64)
    parameters = (LAMBDA, GAMMA, N, N_PRIME, FAR)
    social_forces(position, velocity, everybody, len(position), *parameters, -1, force)
    return force


def turned(angle, vectors):
    c, s = np.cos(angle), np.sin(angle)
    return vectors @ np.array([[c, s], [-s, c]])


def wraps(position, velocity):
    """(P, P): whether the angle between the pair's interaction and position exceeds pi."""
    toward = position[:, None] - position[None]
    distance = np.hypot(toward[..., 0], toward[..., 1]) + np.eye(len(position))
    toward = toward / distance[..., None]
    interaction = LAMBDA * (velocity[None] - velocity[:, None]) + toward
    angle = [np.arctan2(v[..., 1], v[..., 0]) for v in (interaction, toward)]
    return (np.abs(angle[0] - angle[1]) > np.pi - 1e-6) & ~np.eye(len(position), dtype=bool)


def test_forces_of_pairs_are_those_of_pysocialforce():
    rng = np.random.default_rng(1)
    for _ in range(150):
        position, velocity = rng.uniform(-1.2, 1.2, (2, 2)), rng.normal(0, 0.4, (2, 2))
        for angle in np.linspace(0.01, 2 * np.pi, 32):
            p, v = turned(angle, position), turned(angle, velocity)
            if not wraps(p, v).any():
                break
        else:
            pytest.fail("no way to turn the pair")
        want = turned(-angle, theirs(p, v))
        assert ours(position, velocity) == pytest.approx(want, abs=1e-6)


def test_forces_in_a_crowd_are_those_of_pysocialforce():
    rng = np.random.default_rng(2)
    compared = 0
    for _ in range(80):
        position, velocity = rng.uniform(-2.5, 2.5, (7, 2)), rng.normal(0, 0.15, (7, 2))
        clear = ~wraps(position, velocity).any(axis=1)
        compared += clear.sum()
        want = theirs(position, velocity)
        assert ours(position, velocity)[clear] == pytest.approx(want[clear], abs=1e-6)
    assert compared > 200


def libpedsim_step(position, velocity, goal, config, wall_x, tick):
    """One step of everybody by the published formulas; the wall is the half-plane x < wall_x."""
    new = np.zeros_like(velocity)
    for i in range(len(position)):
        way = goal[i] - position[i]
        force = config.sfm_desired * way / np.linalg.norm(way)
        for j in range(len(position)):
            difference = position[j] - position[i]
            distance = np.linalg.norm(difference)
            if j == i or distance > config.sfm_cutoff:
                continue
            toward = difference / distance
            interaction = config.sfm_lambda * (velocity[i] - velocity[j]) + toward
            b = config.sfm_gamma * np.linalg.norm(interaction)
            along = interaction / np.linalg.norm(interaction)
            theta = np.angle(complex(*toward) / complex(*along))
            left = np.array([-along[1], along[0]])
            slow = np.exp(-distance / b - (config.sfm_n_prime * b * theta) ** 2)
            turn = np.exp(-distance / b - (config.sfm_n * b * theta) ** 2)
            force -= config.sfm_social * (slow * along + np.sign(theta) * turn * left)
        room = position[i, 0] - wall_x
        push = np.exp(-(room - config.sfm_radius) / config.sfm_obstacle_sigma)
        force += config.sfm_obstacle * push * np.array([1.0, 0.0])
        # libpedsim: v = 0.5 v + a h, h = 0.4 s; other ticks by the same exponential.
        decay = 0.5 ** (tick / 0.4)
        velocity_i = decay * velocity[i] + 0.8 * (1.0 - decay) * force
        speed = np.linalg.norm(velocity_i)
        new[i] = velocity_i * min(1.0, config.max_speed / speed)
    return position + tick * new, new


@pytest.mark.parametrize("tick", [0.4, 0.1])
def test_steps_are_those_of_the_published_formulas(tick):
    rng = np.random.default_rng(2)
    occupied = np.zeros((200, 200), dtype=bool)
    occupied[:, :2] = True  # a wall along x = 0 .. 0.1
    field = distance_field(occupied, 0.05)
    config = CrowdConfig(see_robot=False)
    crowd = Crowd(6, 2, config, tick)
    crowd.count = 6
    crowd.model[:] = SFM
    position = np.array([1.2, 3.0]) + rng.uniform(0, 3, (6, 2))
    crowd.position[:6] = position
    crowd.route[:, 0] = position
    crowd.route[:, 1] = goal = np.array([5.0, 5.0]) + rng.uniform(-4, 4, (6, 2))
    crowd.route_length[:] = 2
    crowd.target[:] = 1
    # At rest theta is 0 and its sign, which the model uses, is rounding.
    crowd.velocity[:6] = velocity = rng.normal(0, 0.2, (6, 2))
    for _ in range(4):
        crowd.advance(np.zeros(3), np.zeros(2), field, 20.0)
        position, velocity = libpedsim_step(position, velocity, goal, config, 0.1, tick)
        assert crowd.velocity[:6] == pytest.approx(velocity, abs=2e-6)
        assert crowd.position[:6] == pytest.approx(position, abs=2e-6)
