"""A live world on a screen of any size, and an onlooker who waits for it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lndrl.errors import UserError
from lndrl.navigation import WorldSnapshot
from lndrl.navigation.live import Framer
from lndrl.navigation.reward import REWARD_PARTS
from lndrl.transport import MemoryNetwork
from lndrl.view.dashboard.view import View, press
from lndrl.view.dashboard.worlds import Onlooker, world_panel
from lndrl.view.dashboard.worlds import onlooker as onlookers
from lndrl.view.walk import LOST_MARK

Make = Callable[..., WorldSnapshot]


def moment(world: Make, outcome: str = "", steps: int = 10, episode: int = 0) -> WorldSnapshot:
    return replace(
        world(steps=steps, outcome=outcome),
        episode=episode,
        position_error=2.4 if outcome == "lost" else 0.07,
        angle_error=0.1,
        lost_distance=2.0,
        lost_angle=0.785,
        part_names=REWARD_PARTS,
        parts=np.array([3.5, -1.0, 0.0, 0.0, 0.0, -5.0]),
        actions=np.array([(v, w) for v in (0.0, 0.2, 0.4, 0.6) for w in np.linspace(-0.9, 0.9, 7)]),
        probabilities=np.eye(28)[24] * 0.8 + np.eye(28)[3] * 0.2,
        action=24,
    )


class Stage:
    """An actor's endpoint in memory, and an onlooker of it."""

    def __init__(self) -> None:
        self.network = MemoryNetwork()
        self.framer = Framer("run", "actor-0")
        self.onlooker = Onlooker("actor-0", self.network.viewer().watch)
        deadline = time.monotonic() + 10.0
        while not self.network.watchers and time.monotonic() < deadline:
            time.sleep(0.005)

    def show(self, snapshot: WorldSnapshot) -> bool:
        (seat,) = self.network.watchers
        seat.frame = self.framer.frame(snapshot, 12)
        return self.onlooker.look()


@pytest.mark.parametrize("size", [(36, 8), (40, 18), (76, 19), (116, 33), (196, 53)])
@pytest.mark.parametrize("colours", [True, False])
def test_it_fits_whatever_the_size(world: Make, size: tuple[int, int], colours: bool) -> None:
    stage = Stage()
    for snapshot in (None, moment(world), moment(world, "lost")):
        if snapshot is not None:
            assert stage.show(snapshot)
        panel = world_panel(stage.onlooker, *size, colours)
        assert [line.cell_len for line in panel.lines] == [size[0]] * size[1]
    text = "\n".join(line.plain for line in panel.lines)
    assert "LOST after 4.0 s" in text
    if size[0] >= 76 and size[1] >= 19:
        for words in (*REWARD_PARTS, "2.40 m", "lost at 2 m 45°", "1 lost", "[80", "turning"):
            assert words in text
    stage.onlooker.close()


def test_where_it_got_lost_is_marked(world: Make) -> None:
    stage = Stage()

    def marks() -> int:
        lines = world_panel(stage.onlooker, 116, 33).lines
        return sum(LOST_MARK in str(s.style) for x in lines for s in x.spans)

    stage.show(moment(world))
    before = marks()
    stage.show(moment(world, "lost"))
    assert before == 0 and marks() > 3
    stage.onlooker.close()


def test_the_end_of_an_episode_stays_for_a_moment(
    world: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage = Stage()
    stage.show(moment(world, "lost", episode=1))
    assert not stage.show(moment(world, steps=1, episode=2))
    assert stage.onlooker.snapshot is not None and stage.onlooker.snapshot.outcome == "lost"
    monkeypatch.setattr(stage.onlooker, "_held_until", 0.0)
    assert stage.show(moment(world, steps=2, episode=2))
    assert stage.onlooker.snapshot.outcome == ""
    assert stage.onlooker.ends == {"lost": 1}
    stage.onlooker.close()


def test_silence_is_said_and_listening_begins_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(onlookers, "SILENT_AFTER", 0.05)
    asked: list[str] = []

    def watch(actor_id: str) -> Any:
        asked.append(actor_id)
        raise UserError("there is no connection")

    seen = Onlooker("actor-0", watch)
    deadline = time.monotonic() + 10.0
    while len(asked) < 3 and time.monotonic() < deadline:
        seen.look()
        time.sleep(0.01)
    assert len(asked) >= 3
    text = "\n".join(line.plain for line in world_panel(seen, 60, 10).lines)
    assert "there is no connection" in text
    seen.close()


def test_whoever_looks_away_is_no_longer_there() -> None:
    stage = Stage()
    assert len(stage.network.watchers) == 1
    stage.onlooker.close()
    deadline = time.monotonic() + 10.0
    while stage.network.watchers and time.monotonic() < deadline:
        time.sleep(0.005)
    assert not stage.network.watchers


def test_keys_of_a_live_world() -> None:
    view, asked = press(View(), "l")
    assert view.watching and asked == "watch"
    assert press(view, "right") == (view, "next")
    assert press(view, "up") == (view, "previous")
    assert press(view, "s") == (view, ""), "what sorts the table does nothing here"
    assert press(view, "q")[1] == "leave" and press(view, "c")[1] == "checkpoint"
    assert press(view, " ")[0].paused
    for key in ("l", "escape"):
        after, asked = press(view, key)
        assert not after.watching and asked == ""
