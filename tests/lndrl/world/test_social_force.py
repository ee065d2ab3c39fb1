import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from lndrl.maps import distance_field
from lndrl.world.social_force import obstacle_force, relaxation, social_forces

LAMBDA, GAMMA, N, N_PRIME, CUTOFF = 2.0, 0.35, 2.0, 3.0, 8.0


def slow_social_force(i, position, velocity, silent=-1):
    """Moussaid & Helbing 2009 as written in libpedsim, with vectors and angles."""
    total = np.zeros(2)
    for j in range(len(position)):
        difference = position[j] - position[i]
        distance = np.linalg.norm(difference)
        if j == i or distance > CUTOFF:
            continue
        if distance > 0.0:
            toward = difference / distance
        else:  # nothing tells them apart but their order
            toward = np.array([1.0, 0.0]) if i < j else np.array([-1.0, 0.0])
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


PARAMETERS = (LAMBDA, GAMMA, N, N_PRIME, CUTOFF)


def forces(position, velocity, feels=None, agents=None, silent=-1):
    agents = len(position) if agents is None else agents
    feels = np.ones(len(position), np.int64) if feels is None else feels
    force = np.full((len(position), 2), np.nan)
    social_forces(position, velocity, feels, agents, *PARAMETERS, silent, force)
    return force[:agents]


def test_social_force_matches_the_slow_twin():
    rng = np.random.default_rng(1)
    for k in range(200):
        spread = (1.0, 5.0)[k % 2]
        position = rng.uniform(-spread, spread, (9, 2))
        velocity = rng.normal(0, 0.4, (9, 2))
        silent = int(rng.integers(-1, 9))
        got = forces(position, velocity, silent=silent)
        for i in range(9):
            if i != silent:
                want = slow_social_force(i, position, velocity, silent)
                assert got[i] == pytest.approx(want, abs=1e-6)


def test_those_at_one_point_match_the_slow_twin_and_part():
    rng = np.random.default_rng(7)
    position, velocity = rng.uniform(-1, 1, (6, 2)), rng.normal(0, 0.4, (6, 2))
    position[3], velocity[3] = position[1], velocity[1]
    position[5] = position[0]
    got = forces(position, velocity)
    for i in range(6):
        assert got[i] == pytest.approx(slow_social_force(i, position, velocity), abs=1e-6)
    alone = forces(position[[1, 3]], velocity[[1, 3]])
    assert alone.tolist() == [[-1.0, 0.0], [1.0, 0.0]]


def test_only_those_who_feel_are_pushed_and_everybody_pushes():
    rng = np.random.default_rng(2)
    position, velocity = rng.uniform(-2, 2, (7, 2)), rng.normal(0, 0.4, (7, 2))
    everybody = forces(position, velocity)
    feels = np.array([1, 0, 0, 1, 0, 1, 0])
    assert forces(position, velocity, feels)[feels > 0] == pytest.approx(
        everybody[feels > 0], abs=1e-12
    )


def test_rows_beyond_the_agents_are_not_felt():
    position = np.array([[0.0, 0.0], [0.5, 0.1]])
    velocity = np.zeros((2, 2))
    assert forces(position, velocity, agents=1).tolist() == [[0.0, 0.0]]
    assert forces(position, velocity)[0, 0] < 0.0


@given(st.integers(0, 10_000), st.integers(2, 12))
def test_forces_cancel_in_sum_and_turn_with_the_scene(seed, agents):
    rng = np.random.default_rng(seed)
    position, velocity = rng.uniform(-3, 3, (agents, 2)), rng.normal(0, 0.5, (agents, 2))
    force = forces(position, velocity)
    assert np.abs(force.sum(axis=0)).max() < 1e-12 * agents
    angle = rng.uniform(-np.pi, np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turned = forces(position @ turn.T + 7.0, velocity @ turn.T + 0.3)
    # Head on, theta is +-pi/2 and more sensitive than anything else; still far below walking.
    assert turned == pytest.approx(force @ turn.T, abs=1e-6)


def slow_obstacle_force(field, x, y, radius, sigma, cell):
    """exp(-clearance beyond the body) along the field's slope, with scipy's interpolation."""
    rows, columns = field.shape
    grid = (np.arange(rows) + 0.5) * cell, (np.arange(columns) + 0.5) * cell
    at = RegularGridInterpolator(grid, field.astype(np.float64))
    slope = np.array(
        [at([y, x + cell])[0] - at([y, x - cell])[0], at([y + cell, x])[0] - at([y - cell, x])[0]]
    ) / (2 * cell)
    return np.exp(-(at([y, x])[0] - 0.5 * cell - radius) / sigma) * slope


def test_obstacle_force_matches_the_slow_twin():
    rng = np.random.default_rng(5)
    field = distance_field(rng.random((40, 60)) < 0.02, 0.1)
    for _ in range(300):
        x, y = rng.uniform(0.16, 5.84), rng.uniform(0.16, 3.84)
        want = slow_obstacle_force(field, x, y, 0.2, 0.8, 0.1)
        assert obstacle_force(field, 10.0, x, y, 0.2, 0.8) == pytest.approx(want, abs=1e-6)


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
