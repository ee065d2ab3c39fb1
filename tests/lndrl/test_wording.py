"""Numbers in sentences read as a person would say them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from learner.intake.ledger import Tally
from lndrl.cli.main import run
from lndrl.errors import UserError
from lndrl.maps.grid import distance_field
from lndrl.scenario import Pedestrians
from lndrl.wording import counted, people, span
from lndrl.world.furnish import find_people, find_tasks


def test_one_is_no_plural() -> None:
    assert [counted(n, "chunk") for n in (0, 1, 2048)] == ["0 chunks", "1 chunk", "2,048 chunks"]
    assert counted(1, "line is", "lines are") == "1 line is"
    assert str(Tally(1, 64)) == "64 samples in 1 chunk"


def test_a_range_of_one_number_is_that_number() -> None:
    assert (span(11.0, 13.0), span(4, 4), span(0.5, 0.5000001)) == ("11 to 13", "4", "0.5")
    crowds = [people(count) for count in ((4, 4), (1, 1), (0, 1), (8, 12), (0, 0))]
    assert crowds == ["4 people", "1 person", "0 to 1 people", "8 to 12 people", "no people"]


def hall(width: float, height: float) -> np.ndarray:
    occupied = np.ones((round(height * 20), round(width * 20)), np.bool_)
    occupied[2:-2, 2:-2] = False
    return distance_field(occupied, 0.05)


def test_a_small_floor_is_told_its_people_in_words() -> None:
    _, note = find_people(Pedestrians(count=(12, 16)), hall(6.0, 5.6), 0.05)
    assert note.startswith("4 people instead of 12 to 16 people: ")


def test_a_wanted_distance_of_one_number_is_told_as_one() -> None:
    with pytest.raises(UserError, match=r"no connected start and goal that are 30 m apart"):
        find_tasks(hall(12.0, 12.0), 0.05, 0.17, (30.0, 30.0), "hall")


def test_a_place_of_one_task_is_listed_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "room.yaml"
    path.write_text(
        "name: room\nsize: [8, 4]\nrobot: [{start: [1, 1, 2, 3], goal: [6, 1, 7, 3]}]\n"
        "pedestrians: {count: [1, 1], routes: [{start: [1, 1, 2, 3], goal: [6, 1, 7, 3]}]}\n"
    )
    assert run(["scenarios", str(path)]) == 0
    assert "1 task, 1 route of pedestrians; " in capsys.readouterr().out
    assert titles(tmp_path / "room.png", path) == ["room   8 × 4 m, 1 person"]


def titles(file: Path, path: Path) -> list[str]:
    """What the command writes over its picture."""
    with pytest.MonkeyPatch.context() as patch:
        seen: list[str] = []
        patch.setattr("lndrl.view.pictures.scenario.save_scenario", lambda *a: seen.append(a[2]))
        assert run(["scenarios", str(path), "--out", str(file)]) == 0
    return seen
