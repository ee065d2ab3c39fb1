import numpy as np
import pytest

from lndrl.maps import distance_field
from lndrl.world.social_force import obstacle_force, relaxation, social_force

LAMBDA, GAMMA, N, N_PRIME, CUTOFF = 2.0, 0.35, 2.0, 3.0, 8.0


def slow_social_force(i, position, velocity, silent=-1):
    """Moussaid & Helbing 2009 as written in libpedsim, with vectors and angles."""
    total = np.zeros(2)
    for j in range(len(position)):
        difference = position[j] - position[i]
        distance = np.linalg.norm(difference)
        if j == i or distance > CUTOFF:
            continue
        toward = difference / distance
        other = np.zeros(2) if j == silent else velocity[j]
        interaction = LAMBDA * (velocity[i] - other) + toward
        length = np.linalg.norm(interaction)
        direction = interaction / length
        theta = np.angle(complex(*toward) / complex(*direction))
        b = GAMMA * length
        left = np.array([-direction[1], direction[0]])
        total -= np.exp(-distance / b - (N_PRIME * b * theta) ** 2) * direction
        total -= np.sign(theta) * np.exp(-distance / b - (N * b * theta) ** 2) * left
    return total


def test_social_force_matches_the_slow_twin():
    rng = np.random.default_rng(1)
    for _ in range(60):
        position = rng.uniform(-5, 5, (9, 2))
        velocity = rng.normal(0, 0.4, (9, 2))
        silent = int(rng.integers(-1, 9))
        for i in (0, 4):
            got = social_force(i, position, velocity, 9, LAMBDA, GAMMA, N, N_PRIME, CUTOFF, silent)
            want = slow_social_force(i, position, velocity, silent)
            assert got == pytest.approx(want, abs=1e-7)


def test_rows_beyond_the_agents_are_not_felt():
    position = np.array([[0.0, 0.0], [0.5, 0.1]])
    velocity = np.zeros((2, 2))
    args = (LAMBDA, GAMMA, N, N_PRIME, CUTOFF, -1)
    assert social_force(0, position, velocity, 1, *args) == (0.0, 0.0)
    assert social_force(0, position, velocity, 2, *args)[0] < 0.0


def test_obstacle_force_points_away_from_the_wall_and_fades():
    occupied = np.zeros((60, 60), dtype=bool)
    occupied[:, :2] = True
    field = distance_field(occupied, 0.1)
    strength = []
    for clearance in (0.3, 0.6, 1.2):
        fx, fy = obstacle_force(field, 10.0, 0.2 + clearance, 3.0, 0.2, 0.8)
        assert fx == pytest.approx(np.exp(-(clearance - 0.2) / 0.8), rel=0.02)
        assert fy == pytest.approx(0.0, abs=1e-6)
        strength.append(fx)
    assert strength[0] > strength[1] > strength[2]


def test_relaxation_is_libpedsims_rule_at_its_own_step_and_consistent_below_it():
    assert relaxation(0.4, 0.4) == pytest.approx((0.5, 0.4))
    decay, gain = relaxation(0.1, 0.4)
    v, force = 0.3, 0.7
    for _ in range(4):
        v = decay * v + gain * force
    assert v == pytest.approx(0.5 * 0.3 + 0.4 * 0.7)
