"""Patches multiplied group by group, cells run by run: the same as all at once."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lndrl.policy.sparse import MapStructure, cells, convolution, drawn_structure, patches
from lndrl.policy.sparse.structure import STAND_IN

Rows = NDArray[np.float32]
IN, OUT = 5, 7  # channels


def structure(pooling: int) -> MapStructure:
    generator = np.random.default_rng(3)
    maps = np.zeros((12, 3, STAND_IN[2], STAND_IN[2]), np.float32)
    maps[:, 0] = generator.random(maps[:, 0].shape) < 0.02
    maps[[0, 6, 11]] = 0.0
    return drawn_structure(maps, pooling)


def convolved(s: MapStructure) -> tuple[Rows, ...]:
    """What the second convolution makes of random rows, and its gradients."""
    generator = np.random.default_rng(4)

    def draw(*shape: int) -> Rows:
        return generator.normal(size=shape).astype(np.float32)

    level = s.levels[1]
    rows, weight = draw(len(s.levels[0].stand_in), IN), draw(OUT, IN, 3, 3)
    places = int(level.stand_in.max()) + 1
    at_points = convolution.weight_at_points(weight)
    done = convolution.convolve_patches(
        rows, at_points, draw(places, OUT), draw(places, OUT), level
    )
    gradient = draw(*done.out.shape)
    by_rows, by_weight = convolution.gradients(
        gradient, rows, done.winner, done.live, at_points, level
    )
    return done.out, done.winner.astype(np.float32), by_rows, by_weight


@pytest.mark.parametrize("pooling", [1, 2])
def test_groups_change_nothing(pooling: int, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = convolved(structure(pooling))
    monkeypatch.setattr(patches, "_GROUP", 200)
    parted = structure(pooling)
    cut = parted.levels[1].patches
    assert cut is not None and len(cut.group_ends) > 2
    for one, other in zip(whole, convolved(parted), strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-5, atol=1e-4)


def test_runs_of_cells_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    s = structure(2)
    generator = np.random.default_rng(6)
    number, count = len(s.cell_stand_in), len(s.order) - len(s.cell_stand_in)
    rows, empty = (generator.normal(size=(n, IN)).astype(np.float32) for n in (count, number))
    weight = generator.normal(size=(number, OUT, IN)).astype(np.float32)
    by_cell = weight.transpose(0, 2, 1)
    gradient = generator.normal(size=(s.samples + 1, OUT)).astype(np.float32)
    found = []
    for most in (1, 40, 10**6):
        monkeypatch.setattr(cells, "_RUN", most)
        forward = [cells.multiply_cells(rows, each, by_cell, s) for each in (empty, None)]
        found.append([*forward, *cells.gradients(gradient, rows, empty, weight, s)])
    for one, *others in zip(*found, strict=True):
        assert all((other == one).all() for other in others)
    expected = [np.zeros_like(each) for each in found[0]]
    together = np.concatenate((rows, empty))
    for cell, (begin, end) in enumerate(cells.groups(s)):
        for place in range(begin, end):
            sample, row = s.sample[place], s.order[place]
            product = weight[cell] @ together[row]
            expected[0][sample] += product
            expected[1][sample] += product * (place > begin)
            back = gradient[sample] @ weight[cell]
            if place == begin:
                expected[3][cell] = back
            else:
                expected[2][row] = back
            expected[4][cell] += np.outer(gradient[sample], together[row])
    for one, other in zip(found[0], expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-4)


def test_cells_without_anybody_have_their_empty_responses() -> None:
    s = drawn_structure(np.zeros((2, 3, STAND_IN[2], STAND_IN[2]), np.float32))
    number = len(s.cell_stand_in)
    empty, weight = np.ones((number, IN), np.float32), np.ones((number, IN, OUT), np.float32)
    out = cells.multiply_cells(np.empty((0, IN), np.float32), empty, weight, s)
    assert (out[-1] == IN * number).all() and (out[:-1] == 0.0).all()
