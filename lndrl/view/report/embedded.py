"""Drawings that live inside a page: charts in its colours, pictures as data."""

from __future__ import annotations

import base64
import io
import re

from matplotlib import rc_context
from matplotlib.figure import Figure

from lndrl.view.palette import BLUE, GREEN, INK, PAPER, PINK, SLATE, VERMILLION
from lndrl.view.report.parts import Picture, Tone

_PIXELS = 96  # of a page, per inch
_THEMED = {
    INK: "var(--ink)",
    SLATE: "var(--grid)",
    PAPER: "var(--card)",
    BLUE: "var(--blue)",
    GREEN: "var(--green)",
    VERMILLION: "var(--red)",
    PINK: "var(--pink)",
}
"""Colours that words are written in too: on light and on dark they must be read."""
_ID = re.compile(r'\b(id="|xlink:href="#|url\(#)')


def chart(name: str, figure: Figure, alt: str, caption: str) -> Picture:
    """``figure`` as SVG within the page: its ink and paper are the page's, light or dark.

    ``name`` is unique on the page, for SVG's own anchors.
    """
    buffer = io.StringIO()
    # One salt: the same chart, the same bytes.
    with rc_context({"svg.hashsalt": "lndrl", "svg.fonttype": "path"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None}, transparent=True)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r' xmlns(:xlink)?="[^"]*"', "", text)
    text = _ID.sub(lambda match: f"{match[1]}{name}-", text)
    for colour, variable in _THEMED.items():
        text = re.sub(colour, variable, text, flags=re.IGNORECASE)
    width, height = _size(figure)
    # The page says what it shows, and how large it is.
    text = re.sub(r"<svg\b[^>]*?(viewBox=\"[^\"]*\")[^>]*>", r"<svg \1>", text, count=1)
    return Picture(alt, caption, width, height, svg=re.sub(r"\n\s*", "\n", text))


def drawing(
    figure: Figure,
    alt: str,
    caption: str,
    *,
    dpi: int = 150,
    wide: bool = False,
    badge: str = "",
    tone: Tone = "",
) -> Picture:
    """``figure`` as a PNG within the page: maps are made of too many strokes for SVG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi, pil_kwargs={"optimize": True})
    uri = f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"
    width, height = _size(figure)
    return Picture(alt, caption, width, height, uri=uri, wide=wide, badge=badge, tone=tone)


def _size(figure: Figure) -> tuple[int, int]:
    across, up = figure.get_size_inches()
    return round(across * _PIXELS), round(up * _PIXELS)
