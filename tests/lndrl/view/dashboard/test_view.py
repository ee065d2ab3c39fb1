from __future__ import annotations

from dataclasses import replace

import pytest

from lndrl.view.dashboard.view import ORDERS, PANELS, Extent, View, press

EXTENT = Extent(actors=300, actor_rows=20, events=50, event_rows=10)


def after(view: View, *keys: str) -> View:
    for key in keys:
        view, asked = press(view, key, EXTENT)
        assert asked == ""
    return view


def test_tab_and_arrows_go_round_the_panels() -> None:
    seen = []
    view = View()
    for _ in range(len(PANELS) + 1):
        view = after(view, "tab")
        seen.append(view.focus)
    assert seen == [*PANELS, PANELS[0]]
    assert after(view, "left").focus == PANELS[-1] == after(View(), "shift-tab").focus
    assert after(view, "right").focus == after(view, "down").focus == PANELS[1]
    some = [panel for panel in PANELS if panel != "validation"]
    assert press(View(focus="ppo"), "tab", EXTENT, some)[0].focus == "actors"


def test_enter_zooms_and_escape_backs_out_step_by_step() -> None:
    view = after(View(), "enter")
    assert view.zoomed and view.focus == "actors"
    assert not after(view, "enter").zoomed
    view = replace(view, needle="slow")
    view = after(view, "escape")
    assert view.needle == "" and view.zoomed
    view = after(view, "escape")
    assert not view.zoomed and view.focus == "actors"
    assert after(view, "escape").focus == ""


def test_the_filter_takes_all_letters_until_enter_or_escape() -> None:
    view = after(View(scroll=5), "/", *"quiS", "backspace", "?")
    assert (view.needle, view.typing, view.scroll) == ("qui?", True, 0)
    assert after(view, "enter").needle == "qui?" and not after(view, "enter").typing
    assert after(view, "escape").needle == "" and not after(view, "escape").typing


def test_orders_go_round() -> None:
    view = View(scroll=9)
    seen = []
    for _ in ORDERS:
        view = after(view, "s")
        seen.append(view.order)
    assert seen == [*ORDERS[1:], ORDERS[0]] and view.scroll == 0


@pytest.mark.parametrize(
    ("keys", "scroll"),
    [
        (["pagedown"], 20),
        (["pagedown", "pageup"], 0),
        (["end"], 280),
        (["end", "pagedown"], 280),
        (["end", "home"], 0),
        (["j", "j", "k"], 1),
        (["enter", "down", "down", "up"], 1),
        (["up"], 0),
    ],
)
def test_scrolling_stays_within_the_table(keys: list[str], scroll: int) -> None:
    assert after(View(focus="actors"), *keys).scroll == scroll


def test_events_scroll_back_in_time() -> None:
    view = after(View(focus="events", zoomed=True), "up", "up")
    assert view.back == 2 and view.scroll == 0
    assert after(view, "home").back == 40
    assert after(view, "end").back == 0


def test_q_leaves_but_not_from_help_or_while_typing() -> None:
    assert press(View(), "q")[1] == "leave"
    assert press(View(helping=True), "q") == (View(), "")
    assert press(View(typing=True), "q") == (View(typing=True, needle="q"), "")


def test_a_stop_is_asked_twice() -> None:
    view, asked = press(View(), "S", EXTENT, now=100.0)
    assert asked == "" and view.stop_asked == 100.0
    assert press(view, "S", EXTENT, now=109.0)[1] == "stop"
    assert press(view, "S", EXTENT, now=111.0) == (View(stop_asked=111.0), "")
    other, _ = press(view, "tab", EXTENT, now=101.0)
    assert press(other, "S", EXTENT, now=102.0)[1] == "", "any other key is a no"
    assert press(View(typing=True), "S", EXTENT) == (View(typing=True, needle="S"), "")
    assert press(View(), "c", EXTENT) == (View(), "checkpoint")
