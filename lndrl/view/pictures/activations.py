"""What the first laser layer of a network answers, beside scene and scan (the paper's Fig. 6)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from lndrl.navigation.snapshot import WorldSnapshot
from lndrl.view.palette import BLUE, INK, PAPER, SKY, SLATE
from lndrl.view.pictures.axes import quiet
from lndrl.view.pictures.fitting import shortened
from lndrl.view.pictures.world import (
    CLOSE_UP,
    View,
    close_view,
    draw_floor,
    draw_goal,
    draw_laser,
    draw_people,
    draw_robot,
)

_SHADES = "viridis"
_SIZE = (12.6, 6.4)  # inches
_SCENE, _LEFT = 0.385, 0.3  # of the width; inches
_AROUND = 1.0  # m beyond what is seen


@dataclass(frozen=True)
class Activations:
    """One moment and a layer's answer to it.

    ``scans`` (frames, beams) m, the newest last; ``values`` (channels, positions) after the ReLU;
    ``beams`` (positions,) the beam in the middle of what each position reads.
    """

    snapshot: WorldSnapshot
    scans: NDArray[np.float32]
    values: NDArray[np.float32]
    beams: NDArray[np.float64]

    def angles(self, beams: NDArray[np.float64]) -> NDArray[np.float64]:
        """Degrees from straight ahead, left positive, of beams by number."""
        seen, count = self.snapshot.field_of_view, self.scans.shape[1]
        return np.degrees(seen * (np.asarray(beams, np.float64) / count - 0.5))


def activations_figure(activations: Activations, title: str = "") -> Figure:
    """Scene on the left; on the right over the beams' angle: scan, mean activation, channels."""
    figure = Figure(figsize=_SIZE, facecolor=PAPER)
    FigureCanvasAgg(figure)
    width, height = _SIZE
    side = _SCENE * width
    scene = figure.add_axes((_LEFT / width, 1.1 / height, _SCENE, side / height))
    mean = activations.values.mean(axis=0)
    norm = Normalize(0.0, max(float(mean.max()), 1e-9))
    draw_scene(activations, scene, norm)
    scene.set_title(shortened(title, 10.5, side), loc="left", size=10.5, color=INK, pad=7)
    _colour_bar(figure, norm, (_LEFT / width, 0.72 / height, _SCENE, 0.11 / height))
    left, across = _SCENE + 1.1 / width, 0.985 - _SCENE - 1.8 / width
    scan = figure.add_axes((left, 4.35 / height, across, 1.6 / height))
    line = figure.add_axes((left, 2.85 / height, across, 1.15 / height), sharex=scan)
    image = figure.add_axes((left, 0.62 / height, across, 1.9 / height), sharex=scan)
    _draw_scan(activations, scan)
    _draw_mean(activations, mean, line)
    _draw_channels(figure, activations, image)
    for axes in (scan, line):
        axes.tick_params(labelbottom=False)
    image.set_xlabel("angle from straight ahead (°), left is left", size=9, color=INK)
    return figure


def draw_scene(activations: Activations, axes: Axes, norm: Normalize) -> None:
    """Draw what is around the robot; echoes in the colour of the mean activation there."""
    snapshot = activations.snapshot
    left, right, bottom, top = _view(activations)
    draw_floor(snapshot, axes)
    draw_laser(snapshot, axes)
    draw_goal(snapshot, axes)
    draw_people(snapshot, axes)
    draw_robot(snapshot, axes, max(snapshot.robot_radius, 0.014 * (right - left)))
    angle = snapshot.pose_true[2] + np.radians(activations.angles(activations.beams))
    count = activations.scans.shape[1]
    nearest = np.clip(np.rint(activations.beams), 0, count - 1).astype(np.int64)
    ranges = activations.scans[-1][nearest].astype(np.float64)
    ends = snapshot.pose_true[:2] + ranges[:, None] * np.stack(
        [np.cos(angle), np.sin(angle)], axis=1
    )
    mean = activations.values.mean(axis=0)
    axes.scatter(
        ends[:, 0], ends[:, 1], c=mean, cmap=_SHADES, norm=norm, s=15, linewidths=0, zorder=6
    )
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal", xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set(color=SLATE, linewidth=0.8)


def save_activations(
    activations: Activations, path: Path | str, title: str = "", dpi: int = 120
) -> None:
    """Write the picture; raises OSError where ``path`` cannot be written."""
    activations_figure(activations, title).savefig(path, dpi=dpi)


def _view(activations: Activations) -> View:
    """A square around the robot that holds nine of ten beams: false ones reach through walls."""
    reach = float(np.percentile(activations.scans[-1], 90)) + _AROUND
    snapshot = activations.snapshot
    return close_view(snapshot, min(max(2 * reach, CLOSE_UP), *snapshot.size))


def _draw_scan(activations: Activations, axes: Axes) -> None:
    angles = activations.angles(np.arange(activations.scans.shape[1], dtype=np.float64))
    *older, newest = activations.scans
    for scan in older:
        axes.plot(angles, scan, color=SKY, linewidth=0.7, alpha=0.6)
    axes.plot(angles, newest, color=BLUE, linewidth=1.0)
    # Left is left: angles count counter-clockwise.
    axes.set_xlim(angles[-1], angles[0])
    axes.set_ylim(0.0, 1.04 * activations.snapshot.range_max)
    axes.set_yticks(np.linspace(0.0, activations.snapshot.range_max, 5))
    axes.set_ylabel("range (m)", size=9, color=INK)
    words = f"scan, {len(angles)} beams"
    _dress(axes, f"{words}; paler: the {len(older)} before it" if older else words)


def _draw_mean(activations: Activations, mean: NDArray[np.float32], axes: Axes) -> None:
    axes.plot(activations.angles(activations.beams), mean, color=INK, linewidth=1.0)
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("activation", size=9, color=INK)
    _dress(axes, f"first laser layer, mean of its {len(activations.values)} channels")


def _draw_channels(figure: Figure, activations: Activations, axes: Axes) -> None:
    channels = len(activations.values)
    step = (activations.beams[1] - activations.beams[0]) / 2
    edges = activations.angles(
        np.array([activations.beams[0] - step, activations.beams[-1] + step])
    )
    picture = axes.imshow(
        activations.values,
        aspect="auto",
        interpolation="nearest",
        origin="lower",
        extent=(edges[0], edges[1], -0.5, channels - 0.5),
        cmap=_SHADES,
        vmin=0.0,
    )
    # imshow takes its own extent for the limits, which belong to the scan.
    angles = activations.angles(np.array([0.0, activations.scans.shape[1] - 1.0]))
    axes.set_xlim(angles[1], angles[0])
    axes.set_ylabel("channel", size=9, color=INK)
    axes.set_yticks(range(0, channels, 8))
    axes.set_xticks(range(-90, 91, 30))
    _dress(axes, "every channel")
    axes.grid(visible=False)
    box = axes.get_position()
    bar = figure.add_axes((box.x1 + 0.008, box.y0, 0.009, box.height))
    figure.colorbar(picture, cax=bar)
    bar.tick_params(colors=INK, labelsize=8, color=SLATE, length=3)


def _colour_bar(figure: Figure, norm: Normalize, box: tuple[float, float, float, float]) -> None:
    bar = figure.add_axes(box)
    figure.colorbar(ScalarMappable(norm, _SHADES), cax=bar, orientation="horizontal")
    bar.tick_params(colors=INK, labelsize=8, color=SLATE, length=3)
    bar.set_xlabel("mean activation where a beam ends", size=9, color=INK)


def _dress(axes: Axes, title: str) -> None:
    axes.set_title(title, loc="left", size=9.5, color=INK, pad=4)
    quiet(axes)


__all__ = ["Activations", "activations_figure", "draw_scene", "save_activations"]
