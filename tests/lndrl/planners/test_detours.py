"""Ways around walls, against Dijkstra's."""

from __future__ import annotations

import heapq
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from lndrl.planners.detours import detour_at, octile, spread, stamp, way_on

CELL, CELLS = 0.2, 21
MIDDLE = CELLS // 2
Floats = NDArray[np.float64]


def spread_slowly(effort: Floats, goal: tuple[float, float]) -> Floats:
    """The same by a queue of cells."""
    row, column = (round(g / CELL) + MIDDLE for g in goal)
    far = np.full(effort.shape, math.inf)
    queue: list[tuple[float, int, int]] = []
    for i, j in np.ndindex(effort.shape):
        if {i, j} & {0, CELLS - 1} or (i, j) == (row, column):
            far[i, j] = octile(i - row, j - column)
            queue.append((float(far[i, j]), i, j))
    heapq.heapify(queue)
    while queue:
        reached, i, j = heapq.heappop(queue)
        for a, b in np.ndindex(3, 3):
            k, m = i + a - 1, j + b - 1
            if (0 <= k < CELLS and 0 <= m < CELLS) and reached <= far[i, j]:
                step = math.hypot(a - 1, b - 1) * 0.5 * (effort[i, j] + effort[k, m])
                if reached + step < far[k, m] - 1e-12:
                    far[k, m] = reached + step
                    heapq.heappush(queue, (far[k, m], k, m))
    for i, j in np.ndindex(far.shape):
        far[i, j] -= octile(i - row, j - column)
    return CELL * far


def detours_of(points: Floats, goal: tuple[float, float]) -> tuple[Floats, Floats]:
    effort, out = np.empty((CELLS, CELLS)), np.empty((CELLS, CELLS))
    stamp(points, CELL, 0.25, 0.45, effort)
    spread(effort, np.array(goal), CELL, out)
    return effort, out


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), number=st.integers(0, 12), far=st.sampled_from([1.0, 6.0]))
def test_detours_are_those_of_the_slow_twin(seed: int, number: int, far: float) -> None:
    random = np.random.default_rng(seed)
    goal = tuple(random.normal(size=2) * far)
    effort, out = detours_of(random.uniform(-2.0, 2.0, (number, 2)), goal)
    np.testing.assert_allclose(out, spread_slowly(effort, goal), atol=1e-6)


def test_a_free_way_has_no_detour() -> None:
    for goal in ((6.0, 1.0), (0.3, -0.5), (-9.0, -9.0)):
        assert np.abs(detours_of(np.empty((0, 2)), goal)[1]).max() < 1e-9


def test_behind_a_panel_the_way_leads_round_it() -> None:
    panel = np.stack((np.full(25, 1.0), np.linspace(-0.4, 1.2, 25)), axis=1)
    _, out = detours_of(panel, (4.0, 0.0))
    goal = np.array([4.0, 0.0])
    assert detour_at(out, CELL, 0.4, 0.2) > 0.2
    assert way_on(out, CELL, goal, 0.4, 0.0) < -0.2  # to the right, the nearer end
    assert detour_at(out, CELL, 1.6, 0.0) < 0.1
    assert way_on(out, CELL, goal, 1.8, 0.0) == pytest.approx(0.0, abs=1e-9)


def test_a_point_blocks_what_is_near_and_makes_dear_what_is_close() -> None:
    effort, _ = detours_of(np.array([[0.6, -0.4]]), (4.0, 0.0))
    x = (np.arange(CELLS) - MIDDLE) * CELL
    apart = np.hypot(x[:, None] - 0.6, x[None] + 0.4)
    assert (effort[apart < 0.24] > 10).all()
    assert ((effort > 1) == (apart < 0.45)).all()


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_whatever_comes_in_nothing_is_written_outside(data: st.DataObject) -> None:
    number = st.sampled_from([0.0, 0.3, -1.5, 1e5, 1e300, math.nan, math.inf, -math.inf])
    points = np.array([[data.draw(number), data.draw(number)] for _ in range(4)])
    goal = np.array([data.draw(number), data.draw(number)])
    cells, other = data.draw(st.integers(0, 7)), data.draw(st.integers(0, 7))
    whole, whole_out = np.full(cells * cells + 16, 7.0), np.full(other * other + 16, 7.0)
    effort = whole[8 : 8 + cells * cells].reshape(cells, cells)
    out = whole_out[8 : 8 + other * other].reshape(other, other)
    stamp(points, CELL, data.draw(st.sampled_from([0.0, 0.5, 1e3])), 0.45, effort)
    spread(effort, goal, CELL, out)
    for array in (whole, whole_out):
        assert (array[:8] == 7).all() and (array[-8:] == 7).all()
    assert (out >= 0.0).all()
    detour_at(out, CELL, goal[0], goal[1])
    way_on(out, CELL, goal, points[0, 0], points[0, 1])
