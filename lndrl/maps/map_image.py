"""Pixels of a map's image as ROS sees them, whatever way the file stores them.

Pillow opens the file, but what it makes of transparency is not asked: a 16-bit grey image with a
transparent colour would turn white from 256 of 65,535 on, and in one of 2 or 4 bits another
colour than the file's would become transparent.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lndrl.errors import UserError
from lndrl.scenario import MOST_CELLS

Floats = NDArray[np.float64]

_GREYS_OF_16_BITS = ("I;16", "I;16B", "I;16L", "I;16N", "I")  # "I" is a PGM's own


class Pixels(NamedTuple):
    """``shade`` float64 (rows, columns), 0 to 255 (of 16 bits with fractions): the mean of the
    colours; row 0 on top. ``alpha`` likewise, 0 transparent; None where the image has none.
    """

    shade: Floats
    alpha: Floats | None


def read_image(image: Path, named_by: Path) -> Pixels:
    """Pixels of ``image``, which the YAML file ``named_by`` names.

    Raises UserError for a file that is missing, damaged, of another size than it says, too large,
    or of numbers that are no shades.
    """
    try:
        with Image.open(image) as opened:
            if opened.size[0] * opened.size[1] > MOST_CELLS:
                raise UserError(
                    f"{image}: {opened.size[0]} x {opened.size[1]} pixels are more than "
                    f"{MOST_CELLS:.0e}; cut the map or make it coarser"
                )
            _check_length(opened, image)
            bits = _grey_bits(opened)
            opened.load()
            return _pixels(opened, bits, image)
    except FileNotFoundError:
        raise UserError(f"{image}: no such file; {named_by} names it as its image") from None
    except Image.DecompressionBombError:
        raise UserError(f"{image}: more pixels than can be read; cut the map") from None
    except (OSError, ValueError, SyntaxError) as error:
        raise UserError(
            f"{image}: is not a whole PGM or PNG image of the size it says ({error})"
        ) from None


def _check_length(opened: Image.Image, image: Path) -> None:
    """Refuse a binary PGM with more or fewer bytes than its header asks for."""
    tile = getattr(opened, "tile", None)
    if opened.format != "PPM" or not tile or image.read_bytes()[:2] != b"P5":
        return
    start = tile[0][2]  # where the pixels begin
    wide = 2 if opened.mode.startswith("I") else 1
    columns, rows = opened.size
    held, asked = image.stat().st_size - start, columns * rows * wide
    if held != asked:
        raise UserError(
            f"{image}: holds {held} bytes of pixels, but its header says {columns} x {rows}, "
            f"which needs {asked}"
        )


def _grey_bits(opened: Image.Image) -> int:
    """Bits of a sample as the file holds it; known before the pixels are loaded."""
    if opened.mode in _GREYS_OF_16_BITS:
        return 16
    tile = getattr(opened, "tile", None)
    raw = tile[0][3] if opened.format == "PNG" and tile else ""
    return {"1": 1, "L;2": 2, "L;4": 4, "RGB;16B": 16}.get(raw if isinstance(raw, str) else "", 8)


def _pixels(opened: Image.Image, bits: int, image: Path) -> Pixels:
    clear = opened.info.get("transparency")
    if opened.mode in ("P", "PA"):
        # Indices into a palette, whose own alpha Pillow does understand.
        opened = opened.convert("RGBA" if clear is not None or opened.mode == "PA" else "RGB")
        clear = None
    elif opened.mode in _GREYS_OF_16_BITS and opened.format in ("PNG", "PPM"):
        return _transparent(np.asarray(opened).astype(np.float64), clear, 16)
    elif opened.mode in ("F", *_GREYS_OF_16_BITS):
        raise UserError(
            f"{image}: holds numbers that are no shades of grey (a {opened.format} image of mode "
            f"{opened.mode}); save it as a PNG or PGM of 8 or 16 bits"
        )
    elif opened.mode not in ("1", "L", "LA", "RGB", "RGBA"):
        opened = opened.convert("RGB")
    values = np.asarray(opened).astype(np.float64)
    if opened.mode == "1":
        return _transparent(values * 255.0, clear, 8)  # Pillow has scaled ``clear`` as well
    if opened.mode in ("LA", "RGBA"):
        return Pixels(values[..., :-1].mean(axis=2), values[..., -1])
    return _transparent(values, clear, bits)


def _transparent(values: Floats, clear: object, bits: int) -> Pixels:
    """Grey or colour ``values``, the colour ``clear`` (samples of ``bits``) being transparent.

    Grey of 16 bits is 0 to 65,535, everything else 0 to 255.
    """
    alpha = None
    if isinstance(clear, (int, tuple)):
        colour = np.array(clear, np.float64)
        if values.ndim == 3 and bits == 16:
            colour = colour // 256  # Pillow keeps the upper byte of each colour
        elif bits < 8:
            colour = colour * (255 // (2**bits - 1))
        same = values == colour
        alpha = np.where(same.all(axis=2) if values.ndim == 3 else same, 0.0, 255.0)
    if values.ndim == 3:
        values = values.mean(axis=2)
    elif bits == 16:
        values = values * (255.0 / 65535.0)
    return Pixels(values, alpha)
