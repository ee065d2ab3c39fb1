"""Whether all words of a figure can be read."""

from __future__ import annotations

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text


def words_cut_off(figure: Figure, dpi: float = 90.0) -> list[str]:
    """Texts that reach beyond the figure, by half a point or more, when drawn at ``dpi``."""
    figure.set_dpi(dpi)
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    canvas.draw()
    width, height = canvas.get_width_height()
    slack = dpi / 144
    # Marks beyond an axis's limits are kept, but not drawn.
    axes = [axis for each in figure.axes for axis in (each.xaxis, each.yaxis)]
    ticks = [tick for axis in axes for tick in {*axis.get_major_ticks(), *axis.get_minor_ticks()}]
    drawn = {id(tick) for axis in axes for tick in axis._update_ticks()}  # type: ignore[union-attr]
    beyond = [tick for tick in ticks if id(tick) not in drawn]
    hidden = {id(label) for tick in beyond for label in (tick.label1, tick.label2)}
    cut = []
    for text in figure.findobj(Text):
        assert isinstance(text, Text)
        if id(text) in hidden or not text.get_visible() or not text.get_text().strip():
            continue
        box = text.get_window_extent(canvas.get_renderer())
        if min(box.x0, box.y0) < -slack or box.x1 > width + slack or box.y1 > height + slack:
            cut.append(text.get_text())
    return cut
