"""Episodes as pictures in time: an animation and a strip of moments."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from lndrl.errors import UserError
from lndrl.navigation.snapshot import WorldSnapshot
from lndrl.view.palette import (
    BELIEF_DARK,
    ECHO,
    FLOOR,
    INK,
    LEG,
    OUTCOME,
    OUTCOME_WORD,
    PAPER,
    SERIES,
    WALL,
)
from lndrl.view.pictures.fitting import add_legend
from lndrl.view.pictures.world import (
    LEGEND_STYLE,
    View,
    draw_world,
    legend_handles,
    world_figure,
)

FIGURE_WIDTH = 12.0
COLOURS = 128
"""Colours of an animation; more hardly shows and costs size."""
HOLD_LAST = 1.5
"""s that an animation rests on its last picture, so that the outcome can be read."""
NARROWEST_VIEW = 8.0


def save_gif(
    snapshots: Sequence[WorldSnapshot],
    path: Path | str,
    fps: float = 10.0,
    close_up: bool = True,
    pixels: int = 960,
    progress: Callable[[int], None] | None = None,
    figure: Callable[[int], Figure] | None = None,
) -> None:
    """Write an endless animation, ``pixels`` wide, one picture per snapshot.

    ``progress`` is told how many pictures are drawn; each takes a few tenths of a second.
    ``figure``, ``FIGURE_WIDTH`` inches wide, of the snapshot with that number; by default
    ``world_figure`` of it. Raises UserError without snapshots, OSError where ``path`` cannot be
    written.
    """
    if not snapshots:
        raise UserError(f"{path}: there is nothing to show; an animation needs a snapshot")
    dpi = pixels / FIGURE_WIDTH
    draw = figure or (lambda k: world_figure(snapshots[k], FIGURE_WIDTH, close_up))

    def drawn(k: int) -> Image.Image:
        return image_of(draw(k), dpi)

    palette = _palette([drawn(i) for i in sorted({0, len(snapshots) // 2})])
    frames = []
    for k in range(len(snapshots)):
        frames.append(drawn(k).quantize(palette=palette, dither=Image.Dither.NONE))
        if progress is not None:
            progress(len(frames))
    shown = max(round(1000 / fps), 20)
    last = shown + round(1000 * HOLD_LAST)
    frames[0].save(
        path,
        format="GIF",
        save_all=True,
        append_images=frames[1:],
        duration=[*[shown] * (len(frames) - 1), last] if len(frames) > 1 else last,
        loop=0,
        optimize=True,
        disposal=1,
    )


def _palette(samples: Sequence[Image.Image]) -> Image.Image:
    """One palette for all pictures.

    Still parts then stay equal from picture to picture, which keeps the file small. Swatches of
    the drawing's own colours stand beside the samples, or small things would lose theirs.
    """
    width, height = samples[0].size
    swatches = [*SERIES, BELIEF_DARK, ECHO, LEG, INK, WALL]
    swatch = max(width // len(swatches), 1)
    together = Image.new("RGB", (width, (height + 60) * len(samples)), PAPER)
    for i, image in enumerate(samples):
        together.paste(image, (0, i * (height + 60)))
        for j, colour in enumerate(swatches):
            pure = Image.new("RGB", (swatch, 30), colour)
            half = Image.blend(pure, Image.new("RGB", pure.size, FLOOR), 0.5)
            together.paste(pure, (j * swatch, i * (height + 60) + height))
            together.paste(half, (j * swatch, i * (height + 60) + height + 30))
    return together.quantize(COLOURS, dither=Image.Dither.NONE)


def image_of(figure: Figure, dpi: float) -> Image.Image:
    """The figure's pixels."""
    figure.set_dpi(dpi)
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


def save_strip(
    snapshots: Sequence[WorldSnapshot], path: Path | str, count: int = 4, dpi: int = 130
) -> None:
    """Write up to ``count`` moments of one episode, evenly spaced, first and last included.

    All show the same part of the place: all that the paths, the goal and the robot need. Raises
    UserError without snapshots, OSError where ``path`` cannot be written.
    """
    if not snapshots:
        raise UserError(f"{path}: there is nothing to show; a strip needs a snapshot")
    chosen = np.unique(np.linspace(0, len(snapshots) - 1, max(count, 1)).round().astype(int))
    moments = [snapshots[i] for i in chosen]
    view = strip_view(snapshots)
    ratio = (view[3] - view[2]) / (view[1] - view[0])
    columns = len(moments) if ratio > 0.75 or len(moments) < 4 else (len(moments) + 1) // 2
    rows = -(-len(moments) // columns)
    margin, gap, head, legend = 0.1, 0.14, 0.32, 0.42
    width = FIGURE_WIDTH
    cell = (width - 2 * margin - gap * (columns - 1)) / columns
    height = rows * (cell * ratio + head) + legend
    figure = Figure(figsize=(width, height), facecolor=PAPER)
    FigureCanvasAgg(figure)
    for i, moment in enumerate(moments):
        row, column = divmod(i, columns)
        x = margin + column * (cell + gap)
        y = legend + (rows - 1 - row) * (cell * ratio + head)
        axes = figure.add_axes((x / width, y / height, cell / width, cell * ratio / height))
        draw_world(moment, axes, view, title=False)
        axes.set_title(f"{moment.time:.1f} s", loc="left", size=10, color=INK, pad=4)
        if moment.outcome:
            word = OUTCOME_WORD.get(moment.outcome, moment.outcome)
            colour = OUTCOME.get(moment.outcome, INK)
            axes.set_title(word, loc="right", size=10, color=colour, weight="bold", pad=4)
    add_legend(figure, legend_handles(), 6, **LEGEND_STYLE)
    figure.savefig(path, dpi=dpi)


def strip_view(snapshots: Sequence[WorldSnapshot], margin: float = 2.0) -> View:
    """The part of the place that holds start, goal and all paths, at least 8 m a side."""
    parts = [[s.goal, s.start_pose[:2], s.pose_true[:2], s.pose_estimated[:2]] for s in snapshots]
    last = snapshots[-1]
    points = np.vstack([*parts, last.path.reshape(-1, 2), last.path_estimated.reshape(-1, 2)])
    size = np.asarray(snapshots[0].size)
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    lacking = np.maximum(NARROWEST_VIEW - (high - low), 0.0) / 2
    low = np.maximum(low - lacking, 0.0)
    high = np.minimum(high + lacking, size)
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])
