#!/usr/bin/env bash
# Pillow 13.0.0: a 16-bit grey PNG, as drawing programs save floor plans, keeps only its darkest 256
# of 65536 shades when it is converted: convert("L") and convert("RGBA") clip at 255 instead of
# scaling. With a transparent colour (tRNS, here white = 65535), whatever is brighter than 254 of 65535
# turns transparent as well: a wall at a quarter of the brightness becomes nothing at all. In grey of
# 2 and 4 bits the same chunk makes nothing transparent: samples are scaled to 8 bits, its value is not.
# The PNG specification (sections 11.3.2.1 and 13.13) says: exactly the samples equal to tRNS are
# transparent, and samples are scaled linearly.
#
# For maps: read mode "I;16" as an array and scale it; compare with tRNS before scaling.
# Exit 0: it is as described. Exit 1: it has changed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet pillow==13.0.0
"$folder/venv/bin/python" - <<'PYTHON'
import io
import struct
import zlib

import PIL
from PIL import Image


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def grey(bits: int, samples: list[int], transparent: int | None) -> Image.Image:
    """A one-line greyscale PNG (colour type 0), read by Pillow."""
    packed = 0
    for sample in samples:
        packed = packed << bits | sample
    spare = -len(samples) * bits % 8
    line = b"\0" + (packed << spare).to_bytes((len(samples) * bits + spare) // 8, "big")
    header = struct.pack(">IIBBBBB", len(samples), 1, bits, 0, 0, 0, 0)
    extra = b"" if transparent is None else chunk(b"tRNS", struct.pack(">H", transparent))
    data = chunk(b"IHDR", header) + extra + chunk(b"IDAT", zlib.compress(line)) + chunk(b"IEND", b"")
    return Image.open(io.BytesIO(b"\x89PNG\r\n\x1a\n" + data))


def row(image: Image.Image, mode: str) -> list:
    converted = image.convert(mode)
    return [converted.getpixel((x, 0)) for x in range(image.width)]


SHADES = [0, 128, 255, 256, 16384, 65535]  # 16384 is a dark grey: a wall
seen = {
    "Pillow": PIL.__version__,
    "16 bits, mode": grey(16, SHADES, None).mode,
    "16 bits as L": row(grey(16, SHADES, None), "L"),
    "16 bits as L, scaled": [round(shade / 257) for shade in SHADES],
    "16 bits, white transparent, alpha": [p[3] for p in row(grey(16, SHADES, 65535), "RGBA")],
    "2 bits, white transparent, alpha": [p[3] for p in row(grey(2, [0, 1, 2, 3], 3), "RGBA")],
    "8 bits, white transparent, alpha": [p[3] for p in row(grey(8, [0, 254, 255], 255), "RGBA")],
}
expected = {
    "Pillow": "13.0.0",
    "16 bits, mode": "I;16",
    "16 bits as L": [0, 128, 255, 255, 255, 255],
    "16 bits as L, scaled": [0, 0, 1, 1, 64, 255],
    "16 bits, white transparent, alpha": [255, 255, 0, 0, 0, 0],
    "2 bits, white transparent, alpha": [255, 255, 255, 255],
    "8 bits, white transparent, alpha": [255, 255, 0],
}
for what, value in seen.items():
    print(f"{what}: {value}")
raise SystemExit(0 if seen == expected else "it has changed")
PYTHON
