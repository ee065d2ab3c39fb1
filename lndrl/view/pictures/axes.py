"""What all charts of the project look like."""

from __future__ import annotations

from matplotlib.axes import Axes

from lndrl.view.palette import INK, SLATE


def quiet(axes: Axes) -> None:
    """A chart as all here have it: faint grid, two thin edges."""
    axes.grid(axis="y", color=SLATE, alpha=0.22, linewidth=0.7)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set(color=SLATE, linewidth=0.8)
    axes.tick_params(colors=INK, labelsize=8.5, color=SLATE, length=3)
