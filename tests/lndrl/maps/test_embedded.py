"""Maps travel inside their scenarios."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lndrl.config import RunConfig, load_config, load_scenario, parse_config
from lndrl.errors import UserError
from lndrl.maps.embedded import pack, unpack, with_map
from lndrl.maps.ros_map import BEYOND, grid_of_cells
from lndrl.scenario import Scenario


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 30), st.integers(1, 30))
def test_packing_and_unpacking_give_the_same_grid(seed, rows, columns) -> None:
    cells = np.random.default_rng(seed).integers(0, 3, (rows, columns)).astype(np.uint8)
    ring = np.pad(cells, 1, constant_values=BEYOND)
    grid = grid_of_cells(cells, 0.05, (-3.5, 2.25), ring)
    plain = Scenario(name="s", kind="map", cells=pack(grid), resolution=0.05)
    again = unpack(Scenario.model_validate(plain.model_dump(mode="json")))
    assert again.origin == grid.origin and again.resolution == grid.resolution
    assert (again.occupied == grid.occupied).all()
    assert (again.mapped == grid.mapped).all()
    assert (again.edge is None) == (grid.edge is None)
    if again.edge is not None and grid.edge is not None:
        assert np.array_equal(again.edge, grid.edge) and grid.mapped[grid.edge].all()


def test_a_loaded_scenario_needs_its_files_no_longer(tmp_path) -> None:
    office = load_scenario("office")
    assert office.cells is not None and office.size == pytest.approx((30.0, 20.0))
    config = parse_config(RunConfig(scenario=office).model_dump(mode="json"), "a message")
    assert config.scenario == office
    path = tmp_path / "run.yaml"
    path.write_text(RunConfig(scenario=office).to_yaml())
    assert load_config(path).content_hash() == config.content_hash()


def test_damaged_cells_are_refused() -> None:
    office = load_scenario("office")
    assert office.cells is not None
    for data in ("!!", office.cells.data[:-8] + "AAAAAAA=", office.cells.data[:400]):
        cells = office.cells.model_copy(update={"data": data})
        with pytest.raises(UserError, match=r"scenario office: cells\.data"):
            unpack(office.model_copy(update={"cells": cells}))
    cells = office.cells.model_copy(update={"rows": 3})
    with pytest.raises(UserError, match=r"3 x 600 of 0, 1, 2 and 3 are needed"):
        unpack(office.model_copy(update={"cells": cells}))


def test_other_scenarios_stay_as_they_are() -> None:
    hybrid = load_scenario("hybrid")
    assert with_map(hybrid) is hybrid
