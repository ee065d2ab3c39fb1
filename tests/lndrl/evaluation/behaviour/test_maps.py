"""What is counted in the cells of a map, against a slow twin."""

from __future__ import annotations

import math
from collections import defaultdict

import numpy as np
import pytest

from lndrl.evaluation.behaviour import (
    FEW_EPISODES,
    FEW_STEPS,
    WAITING,
    BehaviourReport,
    Course,
    Numbers,
    cells_of,
    differences,
)
from lndrl.maps.grid import OccupancyGrid
from tests.lndrl.evaluation.behaviour.courses import drawn

SIZE = (7.3, 4.0)


def slowly(courses: list[Course], cell: float) -> dict[str, dict[tuple[int, int], float]]:
    """Step by step, without arrays of cells."""
    rows, columns = math.ceil(SIZE[1] / cell), math.ceil(SIZE[0] / cell)
    found: dict[str, dict[tuple[int, int], float]] = {
        name: defaultdict(float) for name in ("steps", "turned", "waited", "episodes")
    }
    for course in courses:
        through = set()
        for (x, y, yaw), (x_next, y_next, yaw_next) in zip(
            course.poses[:-1].tolist(), course.poses[1:].tolist(), strict=True
        ):
            at = min(int(y // cell), rows - 1), min(int(x // cell), columns - 1)
            turn = math.atan2(math.sin(yaw_next - yaw), math.cos(yaw_next - yaw))
            found["steps"][at] += 1
            found["turned"][at] += abs(turn)
            found["waited"][at] += math.hypot(x_next - x, y_next - y) / course.seconds < WAITING
            through.add(at)
        for at in through:
            found["episodes"][at] += 1
    return found


@pytest.mark.parametrize("cell", [1.0, 0.5, 3.0])
def test_cells_are_those_of_a_slow_twin(cell: float) -> None:
    courses = drawn(1, 30, SIZE)
    cells, slow = cells_of(courses, SIZE, cell), slowly(courses, cell)
    assert cells.steps.shape == (math.ceil(4.0 / cell), math.ceil(7.3 / cell))
    assert cells.courses == 30 and cells.seconds == 0.4
    for name, sums in slow.items():
        wanted = np.zeros(cells.steps.shape)
        for at, value in sums.items():
            wanted[at] = value
        np.testing.assert_allclose(getattr(cells, name), wanted, atol=1e-9)


def test_differences_are_of_means_and_blank_where_too_few_came() -> None:
    first, second = (cells_of(drawn(seed, 60, SIZE), SIZE) for seed in (1, 2))
    maps = differences(first, second)
    few = (first.steps < FEW_STEPS) | (second.steps < FEW_STEPS)
    assert few.any() and not few.all()
    assert (np.isnan(maps["turning"]) == few).all() and (np.isnan(maps["waiting"]) == few).all()
    assert (np.isnan(maps["ways"]) == (first.episodes + second.episodes < FEW_EPISODES)).all()
    row, column = np.argwhere(~few)[0]
    rates = [c.turned[row, column] / c.steps[row, column] / 0.4 for c in (first, second)]
    assert maps["turning"][row, column] == pytest.approx(rates[0] - rates[1])
    shares = [c.waited[row, column] / c.steps[row, column] for c in (first, second)]
    assert maps["waiting"][row, column] == pytest.approx(100 * (shares[0] - shares[1]))
    ways = (first.episodes - second.episodes)[row, column] / 60
    assert maps["ways"][row, column] == pytest.approx(100 * ways)


def test_who_waits_goes_no_other_way() -> None:
    """A robot that stands in a cell for long has come through once, like one that passes."""
    there = np.array([[0.5 + 0.3 * k, 0.5, 0.0] for k in range(20)])
    slow = np.repeat(there, 5, axis=0)
    first, second = (
        cells_of([Course(k, "arrived", poses, 0.4) for k in range(6)], SIZE)
        for poses in (slow, there)
    )
    maps = differences(first, second)
    assert maps["ways"][0, 0] == 0.0
    assert maps["waiting"][0, 0] == pytest.approx(80.0)


def test_numbers_say_what_the_courses_did() -> None:
    quarter = np.array([[1, 1, 3.1], [1, 1, -3.1], [1.0, 1.3, -3.1], [1, 1.6, -3.1]])
    courses = [Course(0, "arrived", quarter, 0.4), Course(1, "lost", quarter[:3], 0.4)]
    found = Numbers.of("one", courses, {0})
    assert found.turn == pytest.approx(2 * (2 * np.pi - 6.2) / 5)  # the short way round
    assert found.waiting == pytest.approx(2 / 5)
    assert found.path == pytest.approx(0.6)
    assert (found.arrived, found.hazard.value) == (0.5, 200.0)
    assert Numbers.of("none", [], set()).path is None


def test_a_path_is_of_episodes_in_which_both_arrived() -> None:
    first = drawn(1, 4, SIZE, ("arrived", "lost"))
    second = drawn(2, 4, SIZE, ("arrived", "arrived", "collided"))
    grid = OccupancyGrid(np.zeros((8, 15), bool), 0.5)
    report = BehaviourReport(("a", "b"), "room", grid, (first, second))
    lengths = [float(courses[0].moved.sum()) for courses in (first, second)]
    assert [each.path for each in report.numbers] == pytest.approx(lengths)
    data = report.to_dict()
    assert [each["method"] for each in data["methods"]] == ["a", "b"]
    assert set(data["maps"]) == {"turning", "waiting", "ways"}
    assert None in data["maps"]["turning"][0]


def test_cells_need_a_size() -> None:
    with pytest.raises(ValueError, match=r"cells of 0\.0 m"):
        cells_of([], SIZE, 0.0)
