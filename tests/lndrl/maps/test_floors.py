"""Which floor of a map is furnished, and whether it may lie outdoors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lndrl.config import load_scenario
from lndrl.errors import UserError
from lndrl.models import validate
from lndrl.scenario import Scenario
from lndrl.world import Place

STEP = 0.05
ORIGIN = (-12.3, 4.7)
EDGE = "the floor reaches the edge of the image"


def plan(door: bool = False) -> np.ndarray:
    """A house of 14 x 10 m with two rooms, on a white sheet of 30 x 24 m; row 0 at the bottom."""
    floor = np.ones((480, 600), bool)
    floor[140:344, 160:444] = False
    floor[144:340, 164:440] = True
    floor[144:340, 300:304] = False
    floor[220:244, 300:304] = True
    if door:
        floor[340:344, 200:224] = True
    return floor


def write(
    folder: Path, floor: np.ndarray, yaw: float = 0.0, unknown: np.ndarray | None = None
) -> Path:
    image = np.where(floor, 254, 0).astype(np.uint8)
    if unknown is not None:
        image[unknown] = 205
    Image.fromarray(image[::-1]).save(folder / "sheet.png")
    (folder / "sheet.yaml").write_text(
        f"image: sheet.png\nresolution: {STEP}\norigin: [{ORIGIN[0]}, {ORIGIN[1]}, {yaw}]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    (folder / "house.yaml").write_text("name: house\nkind: map\nmap: sheet.yaml\n")
    return folder / "house.yaml"


def place(path: Path, inside: object = None, **changes: object) -> Place:
    data = load_scenario(str(path)).model_dump()
    return Place.build(validate(Scenario, {**data, "inside": inside, **changes}, "house"))


def ends(place: Place) -> np.ndarray:
    """Corners (n, 2) of everything that was found, in the image's frame (m)."""
    boxes = [b for r in place.scenario.robot for b in (r.start, r.goal)]
    boxes += [b for r in place.scenario.pedestrians.routes for b in (r.start, r.goal)]
    corners = np.array(boxes).reshape(-1, 2) + place.map_origin - ORIGIN
    via = [v for r in place.scenario.pedestrians.routes for v in r.via]
    return np.vstack([corners, np.array(via).reshape(-1, 2) + place.map_origin - ORIGIN])


def indoors(points: np.ndarray) -> np.ndarray:
    low, high = np.array([8.2, 7.2]), np.array([22.0, 17.0])
    return np.all((points > low) & (points < high), axis=1)


def test_a_plan_on_a_white_sheet_is_outdoors_and_says_so(tmp_path) -> None:
    outdoors = place(write(tmp_path, plan()))
    assert not indoors(ends(outdoors)).any()
    assert outdoors.notes[-1].startswith(EDGE)
    assert "inside: [x, y]" in outdoors.notes[-1]


@pytest.mark.parametrize("point", [(9.0, 8.0), (21.0, 16.0)])
def test_inside_chooses_the_floor_around_a_point(tmp_path, point) -> None:
    x, y = ORIGIN
    house = place(write(tmp_path, plan()), inside=[x + point[0], y + point[1]])
    found = ends(house)
    assert indoors(found).all()
    assert np.ptp(found, axis=0).min() > 8.0
    assert house.scenario.start_goal_distance == (11.0, 13.0)
    assert not any(EDGE in note for note in house.notes)
    assert house.scenario.inside == pytest.approx(np.add(point, 0.0) + ORIGIN - house.map_origin)


def test_an_open_door_leads_outdoors_and_that_is_said(tmp_path) -> None:
    x, y = ORIGIN
    house = place(write(tmp_path, plan(door=True)), inside=[x + 9.0, y + 8.0])
    assert house.notes[-1] == (
        "the floor around inside reaches the edge of the image, so people and tasks may lie "
        "outdoors; close the building's doors in the map"
    )


def test_a_turned_sheet_ends_where_its_image_does(tmp_path) -> None:
    yaw = 0.4
    turned = place(write(tmp_path, plan(), yaw))
    assert turned.notes[-1].startswith(EDGE)
    c, s = np.cos(yaw), np.sin(yaw)
    there = np.array([c * 9.0 - s * 8.0, s * 9.0 + c * 8.0]) + ORIGIN
    house = place(write(tmp_path, plan(), yaw), inside=there.tolist())
    assert not any(EDGE in note for note in house.notes)


def test_walls_at_the_edge_and_floor_beside_the_unknown_are_no_end_of_the_image(tmp_path) -> None:
    floor = np.ones((240, 300), bool)
    floor[[0, -1]] = floor[:, [0, -1]] = False  # one cell of wall, then the image ends
    assert place(write(tmp_path, floor)).notes == ()
    floor[1:-1, 0] = True
    assert place(write(tmp_path, floor)).notes[-1].startswith(EDGE)
    unknown = np.zeros((240, 300), bool)
    unknown[:, :5] = True  # a laser's last cells: nobody knows what comes then
    assert place(write(tmp_path, floor, unknown=unknown)).notes == ()
    # A strip of white around a closed building is not the building's floor.
    floor = np.ones((240, 300), bool)
    floor[1:-1, 1:-1] = False
    floor[2:-2, 2:-2] = True
    assert place(write(tmp_path, floor)).notes == ()


def test_own_regions_need_no_note(tmp_path) -> None:
    x, y = ORIGIN
    ends = {"start": [x + 9, y + 8, x + 10, y + 9], "goal": [x + 20, y + 8, x + 21, y + 9]}
    own = place(
        write(tmp_path, plan()),
        robot=[ends],
        pedestrians={"count": [1, 1], "routes": [ends]},
    )
    assert own.notes == ()


@pytest.mark.parametrize(
    ("point", "sentence"),
    [
        ((40.0, 8.0), r"scenario house: inside \[27\.7, 12\.7\] lies off the map; it must lie in"),
        ((8.1, 8.0), r"scenario house: inside \[-4\.2, 12\.7\] lies in a wall or where the map"),
        ((8.3, 8.0), r"inside \[-4\.0, 12\.7\] is too near to a wall for a robot of radius 0\.17"),
    ],
)
def test_points_that_are_on_no_floor_are_refused(tmp_path, point, sentence) -> None:
    x, y = ORIGIN
    with pytest.raises(UserError, match=sentence):
        place(write(tmp_path, plan()), inside=[x + point[0], y + point[1]])


def test_inside_is_for_maps() -> None:
    plain = load_scenario("hybrid").model_dump()
    with pytest.raises(UserError, match="inside needs kind: map; it chooses a floor of a map"):
        validate(Scenario, {**plain, "inside": [1.0, 1.0]}, "h")
