"""ROS maps: every mode, both images, both byte widths, any yaw, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from lndrl.errors import UserError
from lndrl.maps.ros_map import FREE, OCCUPIED, UNKNOWN, grid_of_cells, load_ros_map

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


def refusal(path: Path) -> str:
    with pytest.raises(UserError) as caught:
        load_ros_map(path)
    return str(caught.value)


def test_first_row_is_the_top_and_origin_is_the_lower_left(tmp_path) -> None:
    grid = load_ros_map(write_map(tmp_path, hall()))
    assert grid.shape == (40, 60) and grid.resolution == 0.1
    assert grid.origin == pytest.approx((-2.0, 3.0))
    block = [grid.occupied[grid.index(-2.0 + x, 3.0 + y)] for x, y in ((0.55, 0.55), (1.45, 0.95))]
    assert all(block)
    assert not grid.occupied[grid.index(-2.0 + 1.0, 3.0 + 1.15)]
    assert not grid.occupied[grid.index(-2.0 + 1.0, 3.0 + 3.2)]  # the mirrored place


def test_unknown_is_no_floor_and_its_rim_is_a_wall(tmp_path) -> None:
    grid = load_ros_map(write_map(tmp_path, hall()))
    assert grid.unknown is not None
    inside = grid.index(-2.0 + 5.45, 3.0 + 2.5)
    rim = grid.index(-2.0 + 5.05, 3.0 + 2.5)
    assert grid.occupied[inside] and grid.unknown[inside] and not grid.mapped[inside]
    assert grid.occupied[rim] and not grid.unknown[rim] and grid.mapped[rim]
    assert not (grid.free & grid.occupied).any()


@pytest.mark.parametrize("kind", ["P2", "P5"])
@pytest.mark.parametrize("most", [255, 65535])
def test_all_kinds_of_pgm_read_the_same(tmp_path, kind, most) -> None:
    expected = load_ros_map(write_map(tmp_path, hall()))
    image = hall().astype(np.int64) * (257 if most > 255 else 1)
    write_pgm(tmp_path / "hall.pgm", image, kind, most)
    grid = load_ros_map(tmp_path / "hall.yaml")
    assert (grid.occupied == expected.occupied).all()
    assert grid.unknown is not None and expected.unknown is not None
    assert (grid.unknown == expected.unknown).all()


@pytest.mark.parametrize("mode", ["L", "RGB", "LA", "RGBA", "P", "I;16"])
def test_png_in_every_mode(tmp_path, mode) -> None:
    expected = load_ros_map(write_map(tmp_path, hall()))
    picture = Image.fromarray(hall())
    if mode == "I;16":
        picture = Image.fromarray(hall().astype(np.uint16) * 257)
    else:
        picture = picture.convert(mode)
    picture.save(tmp_path / "hall.png")
    grid = load_ros_map(write_map(tmp_path, image="hall.png"))
    assert (grid.occupied == expected.occupied).all()


def test_negate_swaps_floor_and_wall(tmp_path) -> None:
    expected = load_ros_map(write_map(tmp_path, hall()))
    write_pgm(tmp_path / "hall.pgm", 255 - hall())
    grid = load_ros_map(write_map(tmp_path, None, negate=1))
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


def test_raw_mode_holds_percent(tmp_path) -> None:
    image = np.zeros((40, 60), np.uint8)
    image[[0, -1]] = 100
    image[:, [0, -1]] = 100
    image[20, 20:26] = [0, 19, 40, 66, 100, 255]
    cells = _cells(write_map(tmp_path, image, mode="raw"))
    assert cells[19, 20:26].tolist() == [FREE, FREE, UNKNOWN, OCCUPIED, OCCUPIED, UNKNOWN]


def test_transparent_pixels_are_unknown_in_scale_mode_only(tmp_path) -> None:
    picture = np.dstack([hall(), hall(), hall(), np.full_like(hall(), 255)])
    picture[20, 20, 3] = 0
    Image.fromarray(picture).save(tmp_path / "hall.png")
    assert _cells(write_map(tmp_path, image="hall.png"))[19, 20] == FREE
    assert _cells(write_map(tmp_path, image="hall.png", mode="scale"))[19, 20] == UNKNOWN


def _cells(path: Path) -> np.ndarray:
    """Cells before the rims are closed."""
    from lndrl.maps import ros_map
    from lndrl.models import load_yaml, validate

    about = validate(ros_map.MapFile, load_yaml(path), str(path))
    values, opaque = ros_map._read_image(path.parent / about.image, path)
    return ros_map.classify(values, opaque, about)[::-1]


@pytest.mark.parametrize("yaw", [0.3, -1.2, np.pi / 2, np.pi, 2.5, 2 * np.pi + 0.3])
def test_yaw_turns_the_map_about_its_origin(tmp_path, yaw) -> None:
    straight = load_ros_map(write_map(tmp_path, hall()))
    turned = load_ros_map(write_map(tmp_path, None, origin=[-2.0, 3.0, yaw]))
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
    grid = load_ros_map(write_map(tmp_path, image))
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
