"""The product of beams: logarithms, recovery's average, beam skipping; and the kinds of field."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lndrl.config import LaserConfig, LocalizationConfig
from lndrl.localization import AMCL
from lndrl.localization.belief import make_settings
from lndrl.localization.field import beam_factor, obstacle_distance
from lndrl.localization.field_prob import converged, skip_beams, weigh_logarithms
from lndrl.localization.likelihood import LikelihoodMap
from lndrl.maps.grid import OccupancyGrid


def weigh(weights, logs, beams):
    """Kernel on logarithms; its input starts at 1."""
    weights = np.array(weights, dtype=np.float64)
    likelihood = (np.array(logs) + 1.0).astype(np.float32)
    return weights, weigh_logarithms(weights, likelihood, len(weights), beams)


def test_weights_are_multiplied_and_the_average_is_per_beam():
    rng = np.random.default_rng(0)
    prior = rng.uniform(0.1, 1.0, 50)
    prior /= prior.sum()
    logs = np.round(rng.uniform(-30, -5, 50), 3)
    weights, average = weigh(prior, logs, 12)
    expected = prior * np.exp(logs)
    assert weights == pytest.approx(expected / expected.sum(), rel=1e-4)
    assert average == pytest.approx(expected.sum() ** (1 / 12), rel=1e-5)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-3e4, 0.0), min_size=1, max_size=30), st.integers(0, 700))
def test_no_product_is_too_small(logs, beams):
    weights, average = weigh(np.full(len(logs), 1 / len(logs)), logs, beams)
    assert weights.sum() == pytest.approx(1.0)
    assert (weights >= 0).all() and np.isfinite(average)


def test_hopeless_weights_become_equal():
    for prior, logs in (
        ([0.5, 0.5], [-np.inf, -np.inf]),
        ([0.0, 0.0], [-3.0, -4.0]),
        ([np.nan, np.nan], [-3.0, -4.0]),
    ):
        weights, average = weigh(prior, logs, 5)
        assert weights.tolist() == [0.5, 0.5] and average == 0.0
    # The best logarithm belongs to a particle without weight: the others decide.
    assert weigh([0.0, 0.4, 0.6], [0.0, -2000.0, -2000.0], 5)[0] == pytest.approx([0, 0.4, 0.6])


def skipping(ends, threshold=0.3, error_threshold=0.9):
    """Four particles at the origin of an empty table whose right half is near obstacles."""
    table = np.zeros((40, 40), dtype=np.float32)
    table[:, 20:] = 1.0
    field = SimpleNamespace(table=table.ravel(), rows=40, columns=40, skip_level=0.5)
    cells = np.zeros((4, 4), dtype=np.float32)
    cells[:2] = 10.0
    cells[2] = 1.0
    cells[0, 3] = 16.0
    beams = np.zeros((2, len(ends)), dtype=np.float32)
    beams[0] = ends
    used = skip_beams.py_func(field, cells, 4, beams, len(ends), threshold, error_threshold)
    return used, beams[0].tolist()


def test_beams_that_few_particles_explain_are_put_last():
    # 12 m: seen by all four; 5: by the fourth alone; 1: by none.
    used, order = skipping([5.0, 12.0, 1.0, 13.0])
    assert used == 2 and sorted(order[:2]) == [12.0, 13.0] and sorted(order[2:]) == [1.0, 5.0]
    assert skipping([5.0, 12.0, 1.0, 13.0], threshold=0.2)[0] == 3
    assert skipping([5.0, 1.0, 2.0, 13.0], error_threshold=0.75)[0] == 4
    assert skipping([5.0, 1.0, 2.0, 13.0], error_threshold=0.76)[0] == 1
    assert skipping([1.0, 1.0])[0] == 2 and skipping([])[0] == 0


def test_converged_means_every_particle_is_near_the_mean():
    particles = np.zeros((5, 100))
    particles[0, 0] = 0.49
    assert converged(particles, 100)
    particles[1, 1] = -0.52
    assert not converged(particles, 100)


def distances(kind):
    occupied = np.zeros((30, 30), dtype=bool)
    occupied[10:20, 10:20] = True
    config = LocalizationConfig(laser_field=kind)
    return obstacle_distance(OccupancyGrid(occupied, 0.1), config)


def test_kinds_of_field_differ_inside_obstacles_only():
    solid, boundaries, surfaces = map(distances, ("solid", "boundaries", "surfaces"))
    outside = np.ones((30, 30), dtype=bool)
    outside[10:20, 10:20] = False
    assert (solid[~outside] == 0).all()
    assert np.allclose(boundaries[outside], solid[outside])
    assert boundaries[15, 10:20] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4, 0.4, 0.3, 0.2, 0.1, 0])
    # The edge lies between two cells: both are half a cell off it.
    assert np.allclose(surfaces[outside], solid[outside] - 0.05)
    assert surfaces[15, 8:12] == pytest.approx([0.15, 0.05, 0.05, 0.15])
    assert solid[15, 5] == pytest.approx(0.5) and surfaces[15, 14] == pytest.approx(0.45)


@pytest.mark.parametrize("kind", ["solid", "boundaries", "surfaces"])
def test_fields_of_maps_with_one_kind_of_cell(kind):
    config = LocalizationConfig(laser_field=kind)
    empty = OccupancyGrid(np.zeros((4, 5), dtype=bool), 0.1)
    assert (obstacle_distance(empty, config) == 2.0).all()
    full = obstacle_distance(OccupancyGrid(np.ones((4, 5), dtype=bool), 0.1), config)
    assert np.isfinite(full).all() and (full >= 0).all()
    # A wall at the border of the map is solid to its outer side: it has one boundary.
    wall = np.zeros((6, 6), dtype=bool)
    wall[:2] = True
    border = obstacle_distance(OccupancyGrid(wall, 0.1), config)
    assert border[0, 2] == pytest.approx({"solid": 0, "boundaries": 0.1, "surfaces": 0.15}[kind])


def test_tables_hold_what_the_model_adds_up():
    distance = np.array([0.0, 0.1, 0.5, 2.0])
    pz = 0.95 * np.exp(-(distance**2) / (2 * 0.2**2)) + 0.05 / 12.0
    assert beam_factor(distance, LocalizationConfig(), 12.0) == pytest.approx(pz**3)
    prob = LocalizationConfig(
        laser_model_type="likelihood_field_prob", laser_likelihood_exponent=0.5
    )
    assert beam_factor(distance, prob, 12.0) == pytest.approx(0.5 * np.log(pz))
    never = LocalizationConfig(
        laser_model_type="likelihood_field_prob", laser_z_rand=0.0, laser_sigma_hit=0.01
    )
    assert np.isfinite(beam_factor(distance, never, 12.0)).all()
    field = LikelihoodMap.build(OccupancyGrid(np.eye(30, dtype=bool), 0.1), prob)
    assert field.skip_level == pytest.approx(beam_factor(np.array([0.5]), prob, 12.0)[0], rel=1e-6)
    assert math.isclose(field.table.max(), 0.5 * math.log(pz[0]), rel_tol=1e-6)


@pytest.mark.parametrize(
    ("wanted", "laser_range", "used"),
    [(12.0, 12.0, 12.0), (12.0, 8.0, 8.0), (6.0, 12.0, 6.0), (-1.0, 8.0, 8.0), (-1.0, 30.0, 30.0)],
)
@pytest.mark.parametrize("model", ["likelihood_field", "likelihood_field_prob"])
def test_the_map_and_the_filter_know_the_same_maximum_range(
    model: str, wanted: float, laser_range: float, used: float
) -> None:
    """ROS: the smaller of the laser's own and what is wanted, the laser's own for -1."""
    plain = {"laser_model_type": model, "laser_max_range": wanted, "laser_likelihood_max_dist": 50}
    config = LocalizationConfig.model_validate(plain)
    laser = LaserConfig(range_max=laser_range)
    field = LikelihoodMap.build(OccupancyGrid(np.eye(30, dtype=bool), 0.1), config, laser)
    assert make_settings(config, laser).range_max == field.range_max == used
    p = 0.05 / used  # far from every wall
    far = p**3 if model == "likelihood_field" else np.log(p)
    assert field.table[0, 0] == pytest.approx(far, rel=1e-5)
    AMCL(field, config, laser)
    with pytest.raises(ValueError, match=f"readings below {used:g} m, not 3 m"):
        AMCL(field, config, LaserConfig(range_max=3.0))
