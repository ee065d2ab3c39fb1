"""The picture of why a planner gets lost: from reports made by hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from lndrl.config import load_scenario
from lndrl.evaluation.lost import RISKS, Limits, LostReport, Trace
from lndrl.scenario import Scenario
from lndrl.view.palette import OUTCOME
from lndrl.view.pictures.lost import lost_figure, save_lost
from tests.lndrl.evaluation.lost.traces import trace_of
from tests.lndrl.view.pictures.uncut import words_cut_off

LONG = "the-third-floor-of-the-west-wing-as-it-was-mapped-in-march-with-all-doors-open"


def room(name: str, size: tuple[float, float] = (12.0, 8.0)) -> Scenario:
    width, height = size
    return Scenario.model_validate(
        {
            "name": name,
            "size": size,
            "pedestrians": {"count": [0, 0]},
            "robot": [
                {
                    "start": [1, 1, 2, height - 1],
                    "goal": [width - 2, 1, width - 1, height - 1],
                }
            ],
        }
    )


def report(names: list[str], outcome: str = "lost", planner: str = "dwa") -> LostReport:
    traces: list[Trace] = []
    for name in names:
        for episode in range(3):
            off = [0.1] * 12 + ([4.0, 4.0] if outcome == "lost" else [0.1, 0.1])
            trace = trace_of(outcome, off, 0.2 * episode, name, episode, y=3.0)
            traces.append(trace)
    limits = Limits(2.0, math.pi / 4, 1)
    return LostReport(planner, "the world of a bench", 0, tuple(names), limits, traces)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_no_word_is_cut_off(count: int) -> None:
    names = [f"{LONG}-{k}" for k in range(count)]
    rooms = [room(name, (12.0, 6.0 + 8.0 * k)) for k, name in enumerate(names)]
    assert words_cut_off(lost_figure(report(names, planner=f"runs/{LONG}"), rooms)) == []


def test_maps_do_not_lie_on_each_other() -> None:
    names = list("abcdefg")
    rooms = [room(name, (12.0, 5.0 + 4.0 * (k % 3))) for k, name in enumerate(names)]
    figure = lost_figure(report(names), rooms)
    boxes = [axes.get_position() for axes in figure.axes]
    assert len(boxes) == len(names) + len(RISKS) + 1
    for i, one in enumerate(boxes):
        for other in boxes[:i]:
            apart = one.x0 >= other.x1 or other.x0 >= one.x1
            assert apart or one.y0 >= other.y1 - 1e-9 or other.y0 >= one.y1 - 1e-9


def test_a_loss_is_marked_where_the_robot_was(tmp_path: Path) -> None:
    (axes, *_) = lost_figure(report(["room"]), [room("room")]).axes
    drawn = [np.asarray(collection.get_offsets()) for collection in axes.collections]
    places = np.concatenate([offsets for offsets in drawn if len(offsets) == 3])
    assert [6.0, 3.0] in places.tolist()  # the moment of the report, half a metre a step
    save_lost(report(["room"]), [room("room")], tmp_path / "lost.png")
    with Image.open(tmp_path / "lost.png") as image:
        pixels = np.asarray(image.convert("RGB")).reshape(-1, 3)
    pink = np.rint(255 * np.array(to_rgb(OUTCOME["lost"])))
    assert (np.abs(pixels - pink).max(axis=1) < 4).sum() > 20


def test_a_bin_with_next_to_no_steps_does_not_flatten_the_rest() -> None:
    """One loss in two steps among no echoes; an arrow at the top stands for it."""
    traces = [trace_of("arrived", [0.1] * 2001, echoes=0.9), trace_of("lost", [0.1, 0.1, 9.0])]
    limits = Limits(2.0, math.pi / 4)
    made = LostReport("dwa", "the world of a bench", 0, ("room",), limits, traces)
    echoes = lost_figure(made, [room("room")]).axes[1 + list(RISKS).index("echoes")]
    assert made.to_dict()["hazard_by"]["echoes"][0]["per_1000"] == 500.0
    assert 0.5 < echoes.get_ylim()[1] < 10.0


def test_nobody_lost_and_layouts_without_a_map_are_drawn() -> None:
    names = ["room", "random"]
    scenarios = [room("room"), load_scenario("random")]
    figure = lost_figure(report(names, "arrived"), scenarios)
    assert words_cut_off(figure) == []
    assert "layouts above each other" in figure.axes[1].get_title(loc="left")
    with pytest.raises(OSError):
        save_lost(report(["room"]), [room("room")], Path("/no/where.png"))
