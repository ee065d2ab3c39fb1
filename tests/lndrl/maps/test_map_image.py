"""Every kind of image that a map may have, against the shades that ROS sees.

The files are put together byte by byte here, and the expected shades are written by hand: what
wrote them must not be what reads them.
"""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lndrl.errors import UserError
from lndrl.maps.map_image import Pixels, read_image

GREY, COLOUR, PALETTE, GREY_ALPHA, COLOUR_ALPHA = 0, 2, 3, 4, 6
WALL, SAVED_UNKNOWN, FLOOR = 0, 205, 254
SHADES = bytes(3 * [WALL] + 3 * [SAVED_UNKNOWN] + 3 * [FLOOR] + [10, 20, 60])  # a palette


def png(depth: int, kind: int, samples: list[int], **chunks: bytes) -> bytes:
    """A PNG of one row whose pixels are ``samples`` (channel by channel) of ``depth`` bits."""

    def chunk(name: str, data: bytes) -> bytes:
        body = name.encode() + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    channels = {GREY: 1, COLOUR: 3, PALETTE: 1, GREY_ALPHA: 2, COLOUR_ALPHA: 4}[kind]
    text = "".join(format(sample, f"0{depth}b") for sample in samples)
    text += "0" * (-len(text) % 8)
    row = b"\0" + int(text, 2).to_bytes(len(text) // 8, "big")
    width = len(samples) // channels
    head = struct.pack(">IIBBBBB", width, 1, depth, kind, 0, 0, 0)
    inner = b"".join(chunk(name, data) for name, data in chunks.items())
    data = chunk("IDAT", zlib.compress(row)) + chunk("IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunk("IHDR", head) + inner + data


def clear(*samples: int) -> bytes:
    """The content of a tRNS chunk: one colour that is transparent."""
    return struct.pack(f">{len(samples)}H", *samples)


def read(folder: Path, data: bytes, name: str = "map.png") -> Pixels:
    (folder / name).write_bytes(data)
    return read_image(folder / name, folder / "map.yaml")


PNGS: list[tuple[str, bytes, list[float], list[float] | None]] = [
    ("grey of 1 bit", png(1, GREY, [0, 1]), [0, 255], None),
    ("of 1 bit, black clear", png(1, GREY, [0, 1], tRNS=clear(0)), [0, 255], [0, 255]),
    ("of 1 bit, white clear", png(1, GREY, [0, 1], tRNS=clear(1)), [0, 255], [255, 0]),
    ("grey of 2 bits", png(2, GREY, [0, 1, 2, 3]), [0, 85, 170, 255], None),
    (
        "of 2 bits, 1 clear",
        png(2, GREY, [0, 1, 2, 3], tRNS=clear(1)),
        [0, 85, 170, 255],
        [255, 0, 255, 255],
    ),
    ("grey of 4 bits", png(4, GREY, [0, 1, 12, 15]), [0, 17, 204, 255], None),
    (
        "of 4 bits, 12 clear",
        png(4, GREY, [0, 1, 12, 15], tRNS=clear(12)),
        [0, 17, 204, 255],
        [255, 255, 0, 255],
    ),
    ("grey of 8 bits", png(8, GREY, [0, 205, 254]), [0, 205, 254], None),
    (
        "of 8 bits, 205 clear",
        png(8, GREY, [0, 205, 254], tRNS=clear(205)),
        [0, 205, 254],
        [255, 0, 255],
    ),
    ("grey of 16 bits", png(16, GREY, [0, 257, 52685, 65278]), [0, 1, 205, 254], None),
    (
        # Pillow made white of everything from 255 on: of 1,000 (nearly black), and of all floor.
        "of 16 bits, white clear",
        png(16, GREY, [0, 1000, 52685, 65535], tRNS=clear(65535)),
        [0, 1000 / 257, 205, 255],
        [255, 255, 255, 0],
    ),
    (
        "of 16 bits, 255 clear",
        png(16, GREY, [0, 255, 256, 65535], tRNS=clear(255)),
        [0, 255 / 257, 256 / 257, 255],
        [255, 0, 255, 255],
    ),
    (
        "grey and alpha of 8 bits",
        png(8, GREY_ALPHA, [0, 255, 205, 128, 254, 0]),
        [0, 205, 254],
        [255, 128, 0],
    ),
    (
        "grey and alpha of 16 bits",
        png(16, GREY_ALPHA, [0, 65535, 52685, 32896, 65278, 0]),
        [0, 205, 254],
        [255, 128, 0],
    ),
    ("palette of 1 bit", png(1, PALETTE, [1, 0], PLTE=SHADES), [205, 0], None),
    ("palette of 2 bits", png(2, PALETTE, [3, 2, 1, 0], PLTE=SHADES), [30, 254, 205, 0], None),
    ("palette of 4 bits", png(4, PALETTE, [3, 0], PLTE=SHADES), [30, 0], None),
    ("palette of 8 bits", png(8, PALETTE, [2, 1], PLTE=SHADES), [254, 205], None),
    (
        "palette with alpha",
        png(8, PALETTE, [0, 1, 2, 3], PLTE=SHADES, tRNS=bytes([255, 0, 128])),
        [0, 205, 254, 30],
        [255, 0, 128, 255],
    ),
    (
        "palette of 2 bits with one clear",
        png(2, PALETTE, [0, 1, 2], PLTE=SHADES, tRNS=bytes([255, 0])),
        [0, 205, 254],
        [255, 0, 255],
    ),
    ("colour of 8 bits", png(8, COLOUR, [0, 0, 0, 10, 20, 60]), [0, 30], None),
    (
        "colour of 8 bits, one clear",
        png(8, COLOUR, [0, 0, 0, 10, 20, 60], tRNS=clear(10, 20, 60)),
        [0, 30],
        [255, 0],
    ),
    ("colour of 16 bits", png(16, COLOUR, [0] * 3 + [52685] * 3), [0, 205], None),
    (
        "colour of 16 bits, one clear",
        png(16, COLOUR, [0] * 3 + [0xCD00, 0xCDFF, 0xCD12], tRNS=clear(0xCD00, 0xCDFF, 0xCD12)),
        [0, 205],
        [255, 0],
    ),
    (
        "colour and alpha of 8 bits",
        png(8, COLOUR_ALPHA, [0, 0, 0, 255, 10, 20, 60, 0]),
        [0, 30],
        [255, 0],
    ),
    (
        "colour and alpha of 16 bits",
        png(16, COLOUR_ALPHA, [0, 0, 0, 65535, 52685, 52685, 52685, 0]),
        [0, 205],
        [255, 0],
    ),
]


@pytest.mark.parametrize(
    ("data", "shade", "alpha"), [k[1:] for k in PNGS], ids=[k[0] for k in PNGS]
)
def test_png(tmp_path: Path, data: bytes, shade: list[float], alpha: list[float] | None) -> None:
    pixels = read(tmp_path, data)
    assert pixels.shade[0].tolist() == pytest.approx(shade, abs=1e-9)
    if alpha is None:
        assert pixels.alpha is None
    else:
        assert pixels.alpha is not None and pixels.alpha[0].tolist() == alpha


@pytest.mark.parametrize(
    ("data", "shade"),
    [
        (b"P2 3 1 255\n0 205 254\n", [0, 205, 254]),
        (b"P2\n# of a saver\n3 1\n15\n0 7 15\n", [0, 119, 255]),
        (b"P2 3 1 1000\n0 500 1000\n", [0, 127.5, 255]),
        (b"P2 3 1 65535\n0 52685 65535\n", [0, 205, 255]),
        (b"P5 3 1 255\n\x00\xcd\xfe", [0, 205, 254]),
        (b"P5 3 1 100\n\x00\x14\x64", [0, 51, 255]),
        (b"P5 2 1 1\n\x00\x01", [0, 255]),
        (b"P5 3 1 1000\n" + struct.pack(">3H", 0, 500, 1000), [0, 127.5, 255]),
        (b"P5 2 1 256\n" + struct.pack(">2H", 0, 256), [0, 255]),
        (b"P5 3 1 65535\n" + struct.pack(">3H", 0, 52685, 65535), [0, 205, 255]),
        (b"P1 4 1\n0 1 0 1\n", [255, 0, 255, 0]),  # in bitmaps 1 is black
        (b"P4 8 1\n\x55", [255, 0] * 4),
        (b"P3 2 1 255\n0 0 0 10 20 60\n", [0, 30]),
        (b"P6 2 1 255\n\x00\x00\x00\x0a\x14\x3c", [0, 30]),
    ],
)
def test_pgm_and_its_relatives(tmp_path: Path, data: bytes, shade: list[float]) -> None:
    pixels = read(tmp_path, data, "map.pgm")
    # Half a step of 65,535 where the file counts to 1,000.
    assert pixels.shade[0].tolist() == pytest.approx(shade, abs=0.003)
    assert pixels.alpha is None


def bmp(bits: int, row: bytes, width: int, palette: bytes = b"") -> bytes:
    """A BMP of one row as every drawing program writes it."""
    start = 54 + len(palette)
    head = struct.pack("<2sIHHI", b"BM", start + len(row), 0, 0, start)
    colours = len(palette) // 4
    about = struct.pack("<IiiHHIIiiII", 40, width, 1, 1, bits, 0, len(row), 2835, 2835, colours, 0)
    return head + about + palette + row


@pytest.mark.parametrize(
    ("data", "shade"),
    [
        (bmp(24, bytes([0, 0, 0, 60, 20, 10, 0, 0]), 2), [0, 30]),
        (bmp(32, bytes([0, 0, 0, 0, 60, 20, 10, 0]), 2), [0, 30]),  # the fourth byte is no alpha
        (bmp(8, bytes([2, 1, 0, 0]), 3, b"\0\0\0\0\xcd\xcd\xcd\0\x3c\x14\x0a\0"), [30, 205, 0]),
        (bmp(1, bytes([0b01000000, 0, 0, 0]), 2, b"\0\0\0\0\xff\xff\xff\0"), [0, 255]),
    ],
)
def test_bmp(tmp_path: Path, data: bytes, shade: list[float]) -> None:
    pixels = read(tmp_path, data, "map.bmp")
    assert pixels.shade[0].tolist() == shade and pixels.alpha is None


def test_a_printers_jpeg_is_as_bright_as_it_looks(tmp_path: Path) -> None:
    """Its four channels are inks, of which much is dark."""
    file = io.BytesIO()
    grey = np.tile(np.repeat(np.array([0, 205], np.uint8), 8), (16, 1))
    Image.fromarray(grey).convert("CMYK").save(file, "JPEG", quality=95)
    pixels = read(tmp_path, file.getvalue(), "map.jpg")
    assert pixels.shade[:, :6].max() < 12 and abs(pixels.shade[:, 10:] - 205).max() < 12


def test_numbers_that_are_no_shades_are_refused(tmp_path: Path) -> None:
    for mode in (np.float32, np.int32):
        Image.fromarray(np.zeros((4, 4), mode)).save(tmp_path / "map.tif")
        with pytest.raises(UserError, match=r"map\.tif: holds numbers that are no shades of grey"):
            read_image(tmp_path / "map.tif", tmp_path / "map.yaml")
