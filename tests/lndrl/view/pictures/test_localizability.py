"""Drawings of localizability fields: colours are deviations, lines point where to look."""

from __future__ import annotations

import numpy as np
import pytest

from lndrl.config import LaserConfig, LocalizationConfig, load_scenario
from lndrl.localization.localizability import localizability_field
from lndrl.maps import OccupancyGrid, distance_field
from lndrl.maps.localizability import LocalizabilityField
from lndrl.maps.raycast import clearance
from lndrl.view.pictures.localizability import (
    best_headings,
    localizability_figure,
    save_localizability,
)
from lndrl.world import Place


def field_of(place: Place) -> LocalizabilityField:
    return localizability_field(place.grid, place.cells, LaserConfig(), LocalizationConfig())


@pytest.fixture(scope="module")
def sparse() -> Place:
    return Place.build(load_scenario("sparse"))


def test_colours_are_deviations_and_metres_the_maps(sparse) -> None:
    field = field_of(sparse)
    figure = localizability_figure(sparse, field, "a place")
    axes = figure.axes[0]
    assert axes.get_title(loc="left") == "a place"
    image = axes.images[0]
    values = np.asarray(image.get_array())
    assert values.shape == field.free.shape
    assert values[70, 65] == pytest.approx(2.0) and values[12, 10] < 0.1
    assert tuple(image.get_extent()) == (0, 33.0, 0, 20.0)


def test_lines_point_to_what_tells_the_most() -> None:
    """In a corridor with one end in reach: towards that end, from beyond its reach nowhere."""
    occupied = np.zeros((40, 400), bool)
    occupied[:2] = occupied[-2:] = occupied[:, :2] = True
    grid = OccupancyGrid(occupied, 0.1)
    cells = clearance(distance_field(occupied, 0.1), 0.1)
    field = localizability_field(grid, cells, LaserConfig(), LocalizationConfig())
    lines = best_headings(field)
    assert 20 < len(lines) < 60 and lines[:, 0, 0].max() < 13.0
    ahead = lines[:, 1] - lines[:, 0]
    off = np.abs(np.arctan2(ahead[:, 1], -ahead[:, 0]))
    middle = (np.abs(lines[:, 0, 1] - 2.0) < 0.7) & (lines[:, 0, 0] > 1.5)
    assert middle.sum() > 10 and (off[middle] < 0.5).all()
    assert np.hypot(*ahead.T).max() < 1.0


def test_pictures_are_small_files(sparse, tmp_path) -> None:
    file = tmp_path / "sparse.png"
    save_localizability(sparse, field_of(sparse), file)
    assert 5_000 < file.stat().st_size < 150_000
    with pytest.raises(OSError):
        save_localizability(sparse, field_of(sparse), tmp_path / "away" / "sparse.png")
