"""ROS maps: every mode, both images, both byte widths, any yaw, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from lndrl.errors import UserError
from lndrl.maps.grid import OccupancyGrid
from lndrl.maps.map_image import read_image
from lndrl.maps.ros_map import (
    FREE,
    OCCUPIED,
    UNKNOWN,
    Cells,
    MapFile,
    classify,
    grid_of_cells,
    load_ros_map,
)
from lndrl.models import load_yaml, validate

KEYS = {
    "image": "hall.pgm",
    "resolution": 0.1,
    "origin": [-2.0, 3.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}


def hall() -> np.ndarray:
    """Grey values, row 0 on top: walls around, a block in the lower left, unknown on the right."""
    image = np.full((40, 60), 254, np.uint8)
    image[[0, -1]] = 0
    image[:, [0, -1]] = 0
    image[30:35, 5:15] = 0  # y 0.5 .. 1.0 from the bottom, x 0.5 .. 1.5
    image[10:20, 50:59] = 205
    return image


def write_pgm(path: Path, image: np.ndarray, kind: str = "P5", most: int = 255) -> None:
    rows, columns = image.shape
    head = f"{kind}\n# made by hand\n{columns} {rows}\n{most}\n".encode()
    if kind == "P2":
        text = "\n".join(" ".join(str(v) for v in row) for row in image.tolist())
        path.write_bytes(head + text.encode() + b"\n")
    else:
        path.write_bytes(head + image.astype(">u2" if most > 255 else "u1").tobytes())


def write_map(folder: Path, values: np.ndarray | None = None, **changes: object) -> Path:
    """A map with the given keys; None leaves a key out."""
    if values is not None:
        write_pgm(folder / "hall.pgm", values)
    keys = {k: v for k, v in {**KEYS, **changes}.items() if v is not None}
    path = folder / "hall.yaml"
    path.write_text("\n".join(f"{k}: {v}" for k, v in keys.items()))
    return path


def read(path: Path) -> OccupancyGrid:
    return load_ros_map(path).grid


def refusal(path: Path) -> str:
    with pytest.raises(UserError) as caught:
        load_ros_map(path)
    return str(caught.value)


def test_first_row_is_the_top_and_origin_is_the_lower_left(tmp_path) -> None:
    grid = read(write_map(tmp_path, hall()))
    assert grid.shape == (40, 60) and grid.resolution == 0.1
    assert grid.origin == pytest.approx((-2.0, 3.0))
    block = [grid.occupied[grid.index(-2.0 + x, 3.0 + y)] for x, y in ((0.55, 0.55), (1.45, 0.95))]
    assert all(block)
    assert not grid.occupied[grid.index(-2.0 + 1.0, 3.0 + 1.15)]
    assert not grid.occupied[grid.index(-2.0 + 1.0, 3.0 + 3.2)]  # the mirrored place


def test_unknown_is_no_floor_and_its_rim_is_a_wall(tmp_path) -> None:
    grid = read(write_map(tmp_path, hall()))
    assert grid.unknown is not None
    inside = grid.index(-2.0 + 5.45, 3.0 + 2.5)
    rim = grid.index(-2.0 + 5.05, 3.0 + 2.5)
    assert grid.occupied[inside] and grid.unknown[inside] and not grid.mapped[inside]
    assert grid.occupied[rim] and not grid.unknown[rim] and grid.mapped[rim]
    assert not (grid.free & grid.occupied).any()


@pytest.mark.parametrize("kind", ["P2", "P5"])
@pytest.mark.parametrize("most", [255, 65535])
def test_all_kinds_of_pgm_read_the_same(tmp_path, kind, most) -> None:
    expected = read(write_map(tmp_path, hall()))
    image = hall().astype(np.int64) * (257 if most > 255 else 1)
    write_pgm(tmp_path / "hall.pgm", image, kind, most)
    grid = read(tmp_path / "hall.yaml")
    assert (grid.occupied == expected.occupied).all()
    assert grid.unknown is not None and expected.unknown is not None
    assert (grid.unknown == expected.unknown).all()


@pytest.mark.parametrize("mode", ["L", "RGB", "LA", "RGBA", "P", "I;16"])
def test_png_in_every_mode(tmp_path, mode) -> None:
    expected = read(write_map(tmp_path, hall()))
    picture = Image.fromarray(hall())
    if mode == "I;16":
        picture = Image.fromarray(hall().astype(np.uint16) * 257)
    else:
        picture = picture.convert(mode)
    picture.save(tmp_path / "hall.png")
    grid = read(write_map(tmp_path, image="hall.png"))
    assert (grid.occupied == expected.occupied).all()


def test_negate_swaps_floor_and_wall(tmp_path) -> None:
    expected = read(write_map(tmp_path, hall()))
    write_pgm(tmp_path / "hall.pgm", 255 - hall())
    grid = read(write_map(tmp_path, None, negate=1))
    assert (grid.occupied == expected.occupied).all()


def test_thresholds_decide_in_trinary_mode(tmp_path) -> None:
    image = hall()
    image[20, 20:26] = [255, 206, 205, 90, 89, 0]  # p = 0, .192, .196, .647, .651, 1
    write_map(tmp_path, image)
    write_pgm(tmp_path / "hall.pgm", image)
    cells = _cells(tmp_path / "hall.yaml")
    assert cells[40 - 1 - 20, 20:26].tolist() == [
        FREE,
        FREE,
        UNKNOWN,
        UNKNOWN,
        OCCUPIED,
        OCCUPIED,
    ]


@pytest.mark.parametrize("negate", [0, 1])
def test_raw_mode_holds_percent_whatever_negate_says(tmp_path: Path, negate: int) -> None:
    image = np.zeros((40, 60), np.uint8)
    image[[0, -1]] = 100
    image[:, [0, -1]] = 100
    image[20, 20:26] = [0, 19, 40, 66, 100, 255]
    path = write_map(tmp_path, image, mode="raw", negate=negate)
    assert _cells(path)[19, 20:26].tolist() == [FREE, FREE, UNKNOWN, OCCUPIED, OCCUPIED, UNKNOWN]
    notes = load_ros_map(path).notes
    assert len(notes) == negate
    assert all("hall.yaml: mode raw takes no notice of negate, as in ROS 2" in n for n in notes)


@pytest.mark.parametrize("mode", ["trinary", "scale"])
def test_a_pixel_that_is_not_opaque_is_unknown(tmp_path: Path, mode: str) -> None:
    picture = np.dstack([hall(), hall(), hall(), np.full_like(hall(), 255)])
    picture[20, 20:23, 3] = [0, 254, 255]
    Image.fromarray(picture).save(tmp_path / "hall.png")
    cells = _cells(write_map(tmp_path, image="hall.png", mode=mode))
    assert cells[19, 20:23].tolist() == [UNKNOWN, UNKNOWN, FREE]


def test_transparency_does_not_matter_in_raw_mode(tmp_path: Path) -> None:
    picture = np.dstack([np.full((40, 60), 100, np.uint8)] * 3 + [np.zeros((40, 60), np.uint8)])
    picture[1:-1, 1:-1, :3] = 0
    Image.fromarray(picture).save(tmp_path / "hall.png")
    cells = _cells(write_map(tmp_path, image="hall.png", mode="raw"))
    assert (cells[1:-1, 1:-1] == FREE).all() and (cells[0] == OCCUPIED).all()


def test_a_16_bit_image_with_a_transparent_colour_keeps_its_walls(tmp_path: Path) -> None:
    """Pillow makes everything brighter than 254 of 65,535 white when asked for its alpha."""
    image = hall().astype(np.uint16) * 257
    image[image == 0] = 300  # a wall that is nearly black
    Image.fromarray(image).save(tmp_path / "hall.png", transparency=65535)
    grid = read(write_map(tmp_path, image="hall.png"))
    expected = read(write_map(tmp_path, hall()))
    assert (grid.occupied == expected.occupied).all()
    assert (grid.mapped == expected.mapped).all()


def test_where_servers_read_alpha_otherwise_the_share_is_told(tmp_path: Path) -> None:
    """Mean of the four channels: 205 opaque is 217.5 and floor to them, here it is unknown."""
    Image.fromarray(hall()).convert("RGBA").save(tmp_path / "hall.png")
    path = write_map(tmp_path, image="hall.png")
    (note,) = load_ros_map(path).notes
    share = (hall() == 205).mean()
    assert share == pytest.approx(90 / 2400)
    assert "hall.yaml: ROS 1, and ROS 2 up to Iron, average alpha with the colours" in note
    assert "read 3.8% of hall.png otherwise; without alpha all read the same" in note
    Image.fromarray(hall()).save(tmp_path / "hall.png")
    assert load_ros_map(path).notes == ()
    opaque = np.where(hall() == 205, 254, hall())
    Image.fromarray(opaque).convert("RGBA").save(tmp_path / "hall.png")
    assert load_ros_map(path).notes == ()  # black, white and alpha: (0 + 255) / 4 is wall as well


def test_unknown_that_a_threshold_makes_floor_is_told_with_share_and_remedy(
    tmp_path: Path,
) -> None:
    """nav2's saver wrote free_thresh: 0.25 for years, and 205 (p = 0.196) for unknown."""
    path = write_map(tmp_path, hall(), free_thresh=0.25)
    grid, notes = load_ros_map(path)
    assert grid.unknown is None  # as in ROS: it is floor
    assert notes == (
        "hall.yaml: free_thresh 0.25 makes floor of grey 205, 3.8% of hall.pgm; map_saver writes "
        "it for unknown, and free_thresh: 0.196 keeps it that",
    )
    assert load_ros_map(write_map(tmp_path, hall(), free_thresh=0.196)).notes == ()
    assert load_ros_map(write_map(tmp_path, hall() // 2 + 127, free_thresh=0.25)).notes == ()
    write_pgm(tmp_path / "hall.pgm", hall().astype(np.int64) * 257, "P5", 65535)
    assert load_ros_map(write_map(tmp_path, free_thresh=0.25)).notes == notes


def _cells(path: Path) -> Cells:
    """Cells before the rims are closed."""
    about = validate(MapFile, load_yaml(path), str(path))
    return classify(read_image(path.parent / about.image, path), about)[::-1]


@pytest.mark.parametrize("yaw", [0.3, -1.2, np.pi / 2, np.pi, 2.5, 2 * np.pi + 0.3])
def test_yaw_turns_the_map_about_its_origin(tmp_path, yaw) -> None:
    straight = read(write_map(tmp_path, hall()))
    turned = read(write_map(tmp_path, None, origin=[-2.0, 3.0, yaw]))
    rng = np.random.default_rng(0)
    c, s = np.cos(yaw), np.sin(yaw)
    agree = 0
    for x, y in rng.uniform((0.3, 0.3), (5.7, 3.7), (400, 2)):
        there = (-2.0 + c * x - s * y, 3.0 + s * x + c * y)
        here = straight.occupied[straight.index(-2.0 + x, 3.0 + y)]
        agree += here == turned.occupied[turned.index(*there)]
    assert agree >= 390  # cells' borders move by up to half a cell
    area = straight.free.sum() * 0.01
    assert turned.free.sum() * 0.01 == pytest.approx(area, rel=0.02)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(3, 25), st.integers(3, 25), st.floats(0.0, 1.0))
def test_nobody_leaves_a_map(seed, rows, columns, unknown) -> None:
    """Around every floor cell stand floor or walls; the grid's edge is no floor."""
    rng = np.random.default_rng(seed)
    cells = rng.choice(3, (rows, columns), p=[0.5, 0.5 * (1 - unknown), 0.5 * unknown])
    grid = grid_of_cells(cells.astype(np.uint8), 0.1, (0.0, 0.0))
    assert grid.free.sum() == (cells == FREE).sum()
    edge = np.ones(grid.shape, bool)
    edge[1:-1, 1:-1] = False
    assert not (edge & grid.free).any()
    for r, c in np.argwhere(grid.free):
        around = np.s_[r - 1 : r + 2, c - 1 : c + 2]
        assert (grid.free[around] | grid.mapped[around]).all()


def test_what_lies_beyond_the_known_is_cut_off(tmp_path) -> None:
    image = np.full((100, 120), 205, np.uint8)
    image[20:60, 30:90] = hall()
    grid = read(write_map(tmp_path, image))
    assert grid.shape == (40, 60)
    assert grid.origin == pytest.approx((-2.0 + 3.0, 3.0 + 4.0))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"resolution": None}, "hall.yaml: resolution is missing"),
        ({"image": None}, "hall.yaml: image is missing"),
        ({"free_thresh": None}, "hall.yaml: free_thresh is missing"),
        ({"origin": [0, 0]}, "hall.yaml: origin"),
        ({"resolution": -0.1}, "hall.yaml: resolution = -0.1"),
        ({"origin": [0, 0, 90]}, "hall.yaml: origin: the yaw 90 is more than two turns; it is in"),
        ({"free_thresh": 0.7}, "free_thresh 0.7 must be below occupied_thresh 0.65"),
        ({"mode": "colour"}, "hall.yaml: mode = 'colour'"),
        ({"image": "away.pgm"}, "away.pgm: no such file; "),
        ({"negate": 1}, "no pixel is free floor"),
    ],
)
def test_wrong_files_are_refused_with_a_sentence(tmp_path, changes, sentence) -> None:
    image = hall()
    image[image > 250] = 255 if "negate" not in changes else 205
    image[image == 0] = 0 if "negate" not in changes else 205
    said = refusal(write_map(tmp_path, image, **changes))
    assert sentence in said and "\n" not in said


def test_damaged_images_are_refused(tmp_path) -> None:
    path = write_map(tmp_path, hall())
    image = tmp_path / "hall.pgm"
    whole = image.read_bytes()
    image.write_bytes(whole[:-100])
    assert "hall.pgm: holds 2300 bytes of pixels, but its header says 60 x 40" in refusal(path)
    image.write_bytes(whole + b"more")
    assert "which needs 2400" in refusal(path)
    image.write_bytes(b"P5\n60 forty\n255\n")
    assert "hall.pgm: is not a whole PGM or PNG image" in refusal(path)
    image.write_bytes(b"")
    assert "hall.pgm: is not a whole PGM or PNG image" in refusal(path)
    write_pgm(image, hall()[:20], "P2")
    image.write_bytes(image.read_bytes().replace(b"60 20", b"60 40"))
    assert "hall.pgm: is not a whole PGM or PNG image" in refusal(path)
    assert "away.yaml: no such file" in refusal(tmp_path / "away.yaml")
