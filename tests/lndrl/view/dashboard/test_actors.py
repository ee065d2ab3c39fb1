from __future__ import annotations

from typing import Any

import pytest
from rich.cells import cell_len

from lndrl.transport.status import ActorStatus, parse_status
from lndrl.view.dashboard.actors import actors, matching, ordered, worst_first
from lndrl.view.dashboard.view import View


def actor(name: str, **facts: Any) -> ActorStatus:
    return ActorStatus(id=name, **facts)


FLEET = [
    actor("a10", host="north", rate=5.0, steps=10, lag=1),
    actor("a9", host="south", rate=9.0, steps=30, lag=4),
    actor("new", state="gone", gone_for=20.0, host="north"),
    actor("old", state="gone", gone_for=400.0, host="south", rate=0.0),
    actor("ancient", state="gone", gone_for=4000.0, host="south"),
    actor("tired", state="slow", host="south", rate=1.0, steps=20),
]


def names(found: list[ActorStatus]) -> list[str]:
    return [each.id for each in found]


def test_who_has_been_gone_for_long_stands_last() -> None:
    assert names(worst_first(FLEET))[:4] == ["new", "tired", "a9", "a10"]
    assert {*names(worst_first(FLEET))[4:]} == {"old", "ancient"}


@pytest.mark.parametrize(
    ("order", "first"), [("name", "a9"), ("host", "a10"), ("lag", "a9"), ("rate", "ancient")]
)
def test_orders(order: str, first: str) -> None:
    assert names(ordered(FLEET, order))[0] == first


def test_filter_looks_at_name_host_and_state() -> None:
    assert names(matching(FLEET, "SOUTH slow")) == ["tired"]
    assert names(matching(FLEET, "a1")) == ["a10"]
    assert "ancient" not in names(matching(FLEET, ""))
    assert "ancient" in names(matching(FLEET, "gone"))


def status_of(fleet: list[ActorStatus]) -> Any:
    rows = [each.model_dump() for each in fleet]
    return parse_status({"time": 1.0, "steps": 1, "total_steps": 2, "actors": rows})


def test_gone_actors_fade_out() -> None:
    panel = actors(status_of(FLEET), 100, 20)
    style = {
        line.plain.split()[0]: {str(span.style) for span in line.spans}
        for line in panel.lines[1:-1]
    }
    assert "#D55E00" in style["new"] and "dim" not in style["new"]
    assert "dim" in style["old"] and "#D55E00" not in style["old"]
    assert "1 gone for long" in panel.lines[-1].plain


def test_every_actor_is_reached_by_scrolling() -> None:
    fleet = [actor(f"n{i}") for i in range(300)]
    status, seen, scroll = status_of(fleet), set(), 0
    while True:
        panel = actors(status, 60, 12, View(scroll=scroll))
        assert len(panel.lines) <= 12 and {cell_len(x.plain) for x in panel.lines} == {60}
        shown = [line.plain.split()[0] for line in panel.lines[1 : 1 + panel.shown]]
        seen |= set(shown)
        if shown[-1] == "n299":
            break
        scroll += panel.shown
    assert seen == {each.id for each in fleet}
