"""The localizability field against a slow twin, numerical slopes, and what must hold of any map."""

from __future__ import annotations

import numpy as np
import pytest

from lndrl.errors import UserError
from lndrl.maps import OccupancyGrid, distance_field
from lndrl.maps.localizability import (
    DIRECTIONS,
    HEADINGS,
    LocalizabilityField,
    Sensor,
    deviation_at,
    grid_hash,
    least_information,
    look_around,
    measure_places,
    wall_normals,
)
from lndrl.maps.raycast import clearance, raycast

RESOLUTION = 0.1
SENSOR = Sensor(beams=60, field_of_view=np.pi, range_max=5.0, sigma=0.2, farthest=2.0)


def field_of(occupied, sensor=SENSOR, spacing=0.5, unknown=None):
    grid = OccupancyGrid(np.asarray(occupied, bool), RESOLUTION, unknown=unknown)
    distance = distance_field(grid.occupied, RESOLUTION)
    return LocalizabilityField.build(grid, clearance(distance, RESOLUTION), sensor, spacing)


def room(rows=60, columns=80):
    occupied = np.zeros((rows, columns), bool)
    occupied[:2] = occupied[-2:] = occupied[:, :2] = occupied[:, -2:] = True
    return occupied


def cluttered():
    occupied = room()
    occupied[20:30, 24:40] = True
    occupied[44:48, 60:64] = True
    return occupied


def slow_deviation(occupied, x, y, heading, sensor=SENSOR):
    """One place and heading, beam by beam, with matrices."""
    grid = OccupancyGrid(occupied, RESOLUTION)
    normals = wall_normals(grid)
    distance = distance_field(occupied, RESOLUTION)
    step = 2 * np.pi / DIRECTIONS
    count = round(sensor.field_of_view / step)
    information = np.zeros((3, 3))
    for k in range(count):
        angle = 2 * np.pi * heading / HEADINGS + (k - count // 2 + 0.5) * step
        pose = np.array([x, y, angle])
        metres = float(raycast(grid, distance, pose, np.zeros(1), sensor.range_max)[0])
        if metres >= sensor.range_max:
            continue
        dx, dy = np.cos(angle), np.sin(angle)
        before = metres - 0.25 * RESOLUTION
        nx, ny = normals[grid.index(x + before * dx, y + before * dy)].astype(float)
        jacobian = np.array([nx, ny, metres * (ny * dx - nx * dy)])
        information += np.outer(jacobian, jacobian) * sensor.beams / count / sensor.sigma**2
    values, vectors = np.linalg.eigh(information)
    if values[0] < 1e-8 * values[2]:  # some motion changes nothing: does it move the position?
        blind = vectors[:, values < 1e-8 * max(values[2], 1e-300)]
        if np.hypot(blind[0], blind[1]).max() > 1e-4:
            return sensor.farthest
    covariance = np.linalg.pinv(information, rcond=1e-9)[:2, :2]
    return min(np.sqrt(np.linalg.eigvalsh(covariance)[-1]), sensor.farthest)


def test_a_slow_twin_finds_the_same():
    occupied = cluttered()
    field = field_of(occupied)
    rng = np.random.default_rng(3)
    rows, columns = np.nonzero(field.free)
    ratio = []
    for pick in rng.choice(len(rows), 25, replace=False):
        r, c, heading = rows[pick], columns[pick], int(rng.integers(HEADINGS))
        slow = slow_deviation(occupied, (c + 0.5) * 0.5, (r + 0.5) * 0.5, heading)
        ratio.append(field.deviation[r, c, heading] / slow)
    # A ray through a corner may fall to either side: there float32 ranges see another normal.
    assert np.median(np.abs(np.log(ratio))) < 1e-4 and np.abs(np.log(ratio)).max() < 0.05


@pytest.mark.parametrize("slant", [0.0, 0.35, np.pi / 4])
def test_slopes_are_those_that_ranges_have(slant):
    """Ranges change by -J / (n . d) along x, y, yaw: measured over two cells, on slanting walls."""
    rows, columns = np.mgrid[0:160, 0:160]
    x, y = (columns + 0.5) * 0.05, (rows + 0.5) * 0.05
    nx, ny = np.cos(slant), np.sin(slant)
    occupied = nx * (x - 4.0) + ny * (y - 4.0) > 2.0
    grid = OccupancyGrid(occupied, 0.05)
    distance = distance_field(occupied, 0.05)
    cells = clearance(distance, 0.05)
    sums = np.zeros((DIRECTIONS + 1, 6))
    look_around(cells, grid.mapped, wall_normals(grid), 0.05, 4.0, 4.0, 5.0, sums)
    terms = np.diff(sums, axis=0)
    angle = (np.arange(DIRECTIONS) + 0.5) * 2 * np.pi / DIRECTIONS
    facing = nx * np.cos(angle) + ny * np.sin(angle)

    def ranges(dx, dy, turn):
        pose = np.array([4.0 + dx, 4.0 + dy, turn])
        return raycast(grid, distance, pose, angle, 5.0).astype(float)

    seen = (ranges(0, 0, 0) < 3.0) & (facing > 0.5)
    assert seen.sum() > 60
    step, turn = 0.1, 0.05
    slopes = np.stack([
        (ranges(step, 0, 0) - ranges(-step, 0, 0)) / (2 * step),
        (ranges(0, step, 0) - ranges(0, -step, 0)) / (2 * step),
        (ranges(0, 0, turn) - ranges(0, 0, -turn)) / (2 * turn),
    ]) * facing  # fmt: skip
    numerical = np.einsum("in,jn->ij", slopes[:, seen], slopes[:, seen])
    xx, xy, yy, xt, yt, tt = terms[seen].sum(axis=0)
    exact = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])
    assert np.abs(numerical - exact).max() < 0.08 * np.abs(exact).max()


def test_a_corridor_tells_nothing_along_its_axis():
    occupied = np.zeros((40, 300), bool)
    occupied[:2] = occupied[-2:] = True
    field = field_of(occupied)
    middle = field.deviation[:, 30]  # 15 m from either end, which is open
    assert (middle[field.free[:, 30]] == SENSOR.farthest).all()
    occupied[:, :2] = True  # an end: who looks at it within range knows how far it is
    ended = field_of(occupied)
    assert ended.deviation[4, 5, HEADINGS // 2] < 0.2
    assert ended.deviation[4, 5, 0] == SENSOR.farthest  # who looks away does not
    assert ended.deviation[4, 30, HEADINGS // 2] == SENSOR.farthest  # nor who is too far off


def test_in_the_middle_of_nothing_nothing_is_known():
    field = field_of(room(140, 140))
    assert field.deviation[14, 14].min() == SENSOR.farthest
    assert field.deviation[2, 2].min() < 0.1


def test_turning_the_map_turns_the_field():
    occupied = cluttered()
    field, turned = field_of(occupied), field_of(np.rot90(occupied, -1).copy())
    # Rows grow upwards: rot90 by -1 turns a map counter-clockwise, headings by a quarter.
    expected = np.roll(np.rot90(field.deviation, -1), HEADINGS // 4, axis=2)
    both = np.rot90(field.free, -1)
    assert (both == turned.free).all()
    # Rays through corners may fall to either side.
    apart = np.abs(expected - turned.deviation)[both]
    assert np.quantile(apart, 0.98) < 1e-3 and apart.max() < 0.05


def test_walls_where_nothing_was_never_take_information_away():
    occupied = np.zeros((90, 90), bool)
    occupied[:2, :] = True
    bare = field_of(occupied)
    occupied[:, :2] = True
    occupied[70:74, 40:60] = True
    more = field_of(occupied)
    both = bare.free & more.free
    # What stood there already is hidden nowhere: all that is new lies above or to the left of it.
    r = np.nonzero(both)[0]
    assert (more.deviation[both] <= bare.deviation[both] + 2e-3)[r < 10].all()
    assert more.deviation[both].mean() < 0.9 * bare.deviation[both].mean()


def test_the_unknown_stops_beams_and_tells_nothing():
    occupied = room()
    known = field_of(occupied)
    unknown = np.zeros_like(occupied)
    unknown[:, -2:] = True
    part = field_of(occupied, unknown=unknown)
    r, c = 5, 14  # 0.7 m from that wall
    assert known.deviation[r, c, 0] < 0.1
    assert part.deviation[r, c, 0] > 2 * known.deviation[r, c, 0]
    assert part.deviation[r, c, 8] == pytest.approx(known.deviation[r, c, 8], rel=1e-3)


def test_twice_the_error_is_twice_the_deviation():
    once = field_of(cluttered())
    twice = field_of(cluttered(), SENSOR._replace(sigma=0.4))
    some = once.deviation < 0.5
    assert twice.deviation[some] == pytest.approx(2 * once.deviation[some], rel=1e-5)
    four = field_of(cluttered(), SENSOR._replace(beams=240))
    assert four.deviation[some] == pytest.approx(0.5 * once.deviation[some], rel=1e-5)


def test_between_places_and_headings_it_is_interpolated():
    field = field_of(cluttered())
    step = 2 * np.pi / HEADINGS
    here, there = field.deviation[4, 5], field.deviation[4, 6]
    assert field.at(2.75, 2.25, 3 * step) == pytest.approx(here[3])
    assert field.at(2.75, 2.25, 3.5 * step - 4 * np.pi) == pytest.approx((here[3] + here[4]) / 2)
    assert field.at(3.0, 2.25, -step) == pytest.approx((here[-1] + there[-1]) / 2)


@pytest.mark.parametrize(
    "pose",
    [(-0.1, 1, 0), (1, 6.1, 0), (np.nan, 1, 0), (1, np.inf, 0), (1, 1, np.nan), (1e300, 1, 0)],
)
def test_off_the_map_nothing_is_known(pose):
    assert field_of(cluttered()).at(*pose) == SENSOR.farthest


def test_kernels_stay_inside_their_arrays():
    """Small and foreign arrays, which compiled code would read past without a word."""
    grid = OccupancyGrid(cluttered(), RESOLUTION)
    cells = clearance(distance_field(grid.occupied, RESOLUTION), RESOLUTION)
    sums = np.zeros((DIRECTIONS + 1, 6))
    look_around(cells, grid.mapped[:3, :3], wall_normals(grid)[:2], 0.1, 4.0, 3.0, 5.0, sums)
    assert not sums.any()
    for first in (-7, 0, DIRECTIONS - 1, 5 * DIRECTIONS):
        assert least_information(sums, first, DIRECTIONS) == 0.0
    out = np.full((200, 200, 4), np.nan, np.float32)
    measure_places(
        cells, grid.mapped, wall_normals(grid), 0.1, 0.5, 60.0, 2 * np.pi, 5.0, 0.2, 2.0, out
    )
    assert np.isnan(out[20:]).all() and not np.isnan(out[2:10, 4]).all()
    assert deviation_at(np.ones((1, 1, 1), np.float32), 1.0, 0.0, 0.0, 2.0, 1.0, 1.0, -9.0) == 1.0


def test_a_field_says_which_map_it_is_of():
    grid = OccupancyGrid(cluttered(), RESOLUTION)
    field = field_of(cluttered())
    field.check(grid, "careful+map")
    other = OccupancyGrid(room(), RESOLUTION)
    assert len({grid_hash(grid), grid_hash(other), grid_hash(OccupancyGrid(room(), 0.2))}) == 3
    with pytest.raises(
        UserError, match=rf"^planner: .* map {field.map_hash}, .* {grid_hash(other)}"
    ):
        field.check(other, "planner")


def test_without_floor_and_without_walls():
    assert (field_of(np.ones((20, 20), bool)).deviation == SENSOR.farthest).all()
    assert (field_of(np.zeros((20, 20), bool)).deviation == SENSOR.farthest).all()


def test_large_maps_have_places_farther_apart():
    occupied = np.zeros((3000, 3000), bool)
    field = field_of(occupied, SENSOR._replace(range_max=0.2))
    assert field.spacing > 1.0 and field.deviation.shape[0] <= 246
