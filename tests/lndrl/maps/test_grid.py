import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lndrl.maps import OccupancyGrid, distance_field, grid, grid_from_scenario
from lndrl.maps.grid import polygon_mask
from lndrl.scenario import Obstacle, Scenario


def scenario(obstacles, size=(4.0, 3.0), resolution=0.1, wall=0.0):
    return Scenario.model_validate(
        {
            "name": "small",
            "size": size,
            "resolution": resolution,
            "wall": wall,
            "obstacles": obstacles,
            "pedestrians": {"count": [0, 0]},
            "robot": [{"start": [0.5, 0.5, 1, 1], "goal": [3, 2, 3.5, 2.5]}],
        }
    )


def test_row_zero_is_the_lowest_y():
    grid = grid_from_scenario(scenario([{"box": [0.0, 0.0, 1.0, 0.5]}]))
    assert grid.shape == (30, 40)
    assert grid.occupied[:5, :10].all()
    assert grid.occupied.sum() == 50
    assert grid.index(0.95, 0.45) == (4, 9)
    assert grid.index(1.05, 0.05) == (0, 10)
    assert grid.center(4, 9) == pytest.approx((0.95, 0.45))
    assert grid.contains(3.99, 2.99) and not grid.contains(4.01, 1.0)
    assert not grid.contains(-0.01, 1.0)
    assert (grid.free == ~grid.occupied).all()


def test_outer_walls_are_as_thick_as_asked():
    grid = grid_from_scenario(scenario([], wall=0.2))
    assert not grid.occupied[2:-2, 2:-2].any()
    assert grid.occupied[:2].all() and grid.occupied[-2:].all()
    assert grid.occupied[:, :2].all() and grid.occupied[:, -2:].all()


def test_circle_has_the_area_of_a_circle():
    grid = grid_from_scenario(scenario([{"circle": [2.0, 1.5, 0.8]}], resolution=0.02))
    assert grid.occupied.sum() * 0.02**2 == pytest.approx(np.pi * 0.64, rel=0.01)


@pytest.mark.parametrize(
    "thin",
    [
        {"box": [1.01, 1.0, 1.02, 2.0]},
        {"circle": [1.02, 1.52, 0.01]},
        {"polygon": [[1.01, 1.01], [1.02, 1.01], [1.02, 1.02]]},
    ],
)
def test_thin_obstacles_do_not_vanish(thin):
    grid = grid_from_scenario(scenario([thin]))
    assert grid.occupied.any()
    if "box" in thin:
        assert grid.occupied[10:20].any(axis=1).all()


def test_polygon_follows_the_winding_free_even_odd_rule():
    # A concave "L": area 3 of a 2 x 2 square.
    corners = [(1.0, 0.5), (3.0, 0.5), (3.0, 1.5), (2.0, 1.5), (2.0, 2.5), (1.0, 2.5)]
    for polygon in (corners, corners[::-1]):
        grid = grid_from_scenario(scenario([{"polygon": polygon}]))
        assert grid.occupied.sum() * 0.01 == pytest.approx(3.0)
        assert not grid.occupied[grid.index(2.5, 2.0)]
        assert grid.occupied[grid.index(1.5, 2.0)]


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.tuples(st.floats(0, 4), st.floats(0, 3)), min_size=3, max_size=7),
    st.floats(0, 4),
    st.floats(0, 3),
)
def test_polygon_mask_matches_ray_parity(polygon, px, py):
    crossings = 0
    for (x0, y0), (x1, y1) in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        if (y0 > py) != (y1 > py):
            crossing = x0 + (py - y0) * (x1 - x0) / (y1 - y0)
            if abs(crossing - px) < 1e-9:
                return
            crossings += px < crossing
    mask = polygon_mask(polygon, np.array([px]), np.array([py]))
    assert mask[0, 0] == (crossings % 2 == 1)


def test_distance_field_is_the_distance_between_centres():
    rng = np.random.default_rng(1)
    occupied = rng.random((23, 31)) < 0.03
    field = distance_field(occupied, 0.05)
    assert field.dtype == np.float32
    rows, columns = np.nonzero(occupied)
    for r, c in rng.integers(0, (23, 31), (50, 2)):
        nearest = np.hypot(rows - r, columns - c).min() * 0.05
        assert field[r, c] == pytest.approx(nearest, abs=1e-6)


def test_distance_field_of_an_empty_grid_is_the_diagonal():
    field = distance_field(np.zeros((3, 4), dtype=bool), 0.5)
    assert field.shape == (3, 4) and np.allclose(field, 2.5)


def test_grid_is_frozen():
    grid = OccupancyGrid(np.zeros((2, 2), dtype=bool), 0.1)
    with pytest.raises(AttributeError):
        grid.resolution = 0.2  # type: ignore[misc]


def drawn_alone(obstacle, step):
    """The grid with one obstacle, and how many cells were looked at for it."""
    looked = []
    draw = grid._covered

    def counting(obstacle, x, y, resolution):
        looked.append(len(x) * len(y))
        return draw(obstacle, x, y, resolution)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(grid, "_covered", counting)
        occupied = grid_from_scenario(scenario([obstacle], (12.0, 10.0), step)).occupied
    return occupied, looked[0]


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_obstacles_are_drawn_around_themselves_only_and_as_on_all_cells(seed):
    rng = np.random.default_rng(seed)
    step = float(rng.choice([0.05, 0.1, 0.13]))
    for _ in range(4):
        x, y = rng.uniform(-1.0, 13.0, 2)
        wide, high = rng.uniform(0.001, rng.choice([0.03, 2.0]), 2)
        corners = rng.uniform((x, y), (x + wide, y + high), (4, 2)).tolist()
        for shape in (
            {"box": [x, y, x + wide, y + high]},
            {"circle": [x, y, wide]},
            {"polygon": corners},
        ):
            occupied, looked = drawn_alone(shape, step)
            rows, columns = occupied.shape
            x_all, y_all = ((np.arange(n) + 0.5) * step for n in (columns, rows))
            whole = grid._covered(Obstacle.model_validate(shape), x_all, y_all, step)
            assert (occupied == whole).all()
            assert looked <= (2 * wide / step + 7) * (2 * max(wide, high) / step + 7)
