"""Maps travel inside their scenarios."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from lndrl.cli.main import run
from lndrl.cli.runs import choose_run
from lndrl.config import (
    REPOSITORY_CONFIGS,
    RunConfig,
    load_config,
    load_scenario,
    parse_config,
)
from lndrl.errors import UserError
from lndrl.maps.embedded import pack, unpack, with_map
from lndrl.maps.ros_map import BEYOND, grid_of_cells
from lndrl.models import effective
from lndrl.scenario import Scenario
from lndrl.world import Place


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


def saved_by_nav2(folder: Path) -> Path:
    """A scenario of a hall, unknown around, as nav2's saver wrote them for years."""
    image = np.full((240, 400), 205, np.uint8)
    image[10:-10, 10:-10] = 0
    image[13:-13, 13:-13] = 254
    Image.fromarray(image).save(folder / "hall.pgm")
    (folder / "hall.yaml").write_text(
        "image: hall.pgm\nmode: trinary\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.25\n"
    )
    path = folder / "hall-scenario.yaml"
    path.write_text("name: hall\nkind: map\nmap: hall.yaml\npedestrians: {count: [0, 0]}\n")
    return path


def test_notes_of_a_map_travel_with_it_to_places_and_commands(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = saved_by_nav2(tmp_path)
    scenario = load_scenario(str(path))
    (note,) = scenario.map_notes
    assert "free_thresh 0.25 makes floor of grey 205, 12.9% of hall.pgm" in note
    sent = parse_config(RunConfig(scenario=scenario).model_dump(mode="json"), "a message")
    assert Place.build(sent.scenario).notes[0] == note
    for command in (
        ["scenarios", str(path)],
        ["evaluate", "straight", "random", "--scenario", str(path), "--episodes", "1",
         "--workers", "0"],
    ):  # fmt: skip
        assert run(command) == 0
        assert capsys.readouterr().err.count(f"note: {note}\n") == 1
    small = load_config(REPOSITORY_CONFIGS / "lndrl.yaml", [f"scenario={path}"])
    (tmp_path / "run.yaml").write_text(small.to_yaml())
    choose_run(str(tmp_path / "run.yaml"), "a", False, [])
    assert f"note: {note}\n" in capsys.readouterr().err


def test_a_map_without_notes_is_hashed_as_before_there_were_any() -> None:
    cells = load_scenario("office").cells
    assert cells is not None and "notes" not in effective(cells)
