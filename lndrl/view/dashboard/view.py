"""What keys have made of the picture: focus, zoom, pause, order, filter; a pure state machine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

PANELS = ("outcomes", "ppo", "validation", "actors", "machines", "events")
"""What Tab goes through, from top to bottom."""
ORDERS = ("worst", "name", "host", "rate", "lag", "steps")
"""What ``s`` goes through; see ``actors.ordered``."""
SCROLLED = ("actors", "events")
ASK_AGAIN_WITHIN = 10.0
"""s in which the second S of a stop must follow the first."""

KEYS = (
    ("?", "this help"),
    ("q", "leave; the training goes on"),
    ("space", "hold the picture, and let it go on"),
    ("Tab, arrows", "to the next panel, to the one before"),
    ("Enter", "the panel on the whole screen, and back"),
    ("PgUp PgDn Home End", "scroll actors or events; arrows do, too, on the whole screen"),
    ("s", "actors by: worst first, name, host, steps/s, lag, steps"),
    ("/", "only actors whose name, host or state has these words; Esc: all"),
    ("l", "the live world of the first actor shown; arrows: of the next; l or Esc: back"),
    ("1 to 9", "of several runs: the one that c and S ask, and that scrolls"),
    ("c", "ask the learner for a checkpoint; takes the role operator"),
    ("S", "twice: stop the run, which leaves a checkpoint; takes the role operator"),
)
"""Keys as the help shows them."""

_FORWARD, _BACKWARD = ("tab", "right", "down"), ("shift-tab", "left", "up")


@dataclass(frozen=True)
class View:
    """The state of one dashboard. ``focus`` is one of PANELS, or empty before Tab is pressed."""

    focus: str = ""
    zoomed: bool = False
    helping: bool = False
    paused: bool = False
    order: str = ORDERS[0]
    needle: str = ""
    """Words that the shown actors must have."""
    typing: bool = False
    """Whether keys go into ``needle``."""
    scroll: int = 0
    """Rows of actors above the first one shown."""
    back: int = 0
    """Newer events below the last one shown."""
    run: int = 0
    """Which of several runs is asked, and shown where there is room for one only."""
    watching: bool = False
    """Whether an actor's live world is shown instead of the panels."""
    stop_asked: float | None = None
    """Monotonic s of the first S."""


@dataclass(frozen=True)
class Extent:
    """How much of what scrolls the last picture had room for."""

    actors: int = 0
    """Actors that pass the filter."""
    actor_rows: int = 1
    events: int = 0
    event_rows: int = 1
    runs: int = 1


def press(
    view: View,
    key: str,
    extent: Extent | None = None,
    panels: Sequence[str] = PANELS,
    now: float = 0.0,
) -> tuple[View, str]:
    """The view after ``key`` (see ``keys.NAMES``), and what is asked for: nothing, or one word.

    The words are leave, checkpoint, stop, and of live worlds watch, next and previous. ``panels``
    are those that there are, ``now`` is in monotonic s.
    """
    extent = extent or Extent()
    if view.typing:
        return _type(view, key), ""
    if view.helping:
        return replace(view, helping=False), ""
    asked = view.stop_asked
    view = replace(view, stop_asked=None)  # any other key is a no
    if key == "S":
        if asked is not None and now - asked <= ASK_AGAIN_WITHIN:
            return view, "stop"
        return replace(view, stop_asked=now), ""
    if key == "c":
        return view, "checkpoint"
    if key == "l":
        return replace(view, watching=not view.watching), "" if view.watching else "watch"
    if view.watching:
        return _at_a_world(view, key, extent)
    return _looking(view, key, extent, panels)


def _at_a_world(view: View, key: str, extent: Extent) -> tuple[View, str]:
    """What keys do while a live world is shown."""
    if key == "escape":
        return replace(view, watching=False), ""
    if key in _FORWARD or key in _BACKWARD:
        return view, "next" if key in _FORWARD else "previous"
    changed, asked = _looking(view, key, extent, ())
    if key in ("q", "Q", "?", " "):
        return changed, asked
    if changed.run != view.run:
        return changed, "watch"
    return view, ""


def _looking(view: View, key: str, extent: Extent, panels: Sequence[str]) -> tuple[View, str]:
    """What keys do that only change what is seen."""
    if key in ("q", "Q"):
        return view, "leave"
    if key == "?":
        return replace(view, helping=True), ""
    if key == " ":
        return replace(view, paused=not view.paused), ""
    if key == "s":
        after = ORDERS[(ORDERS.index(view.order) + 1) % len(ORDERS)]
        return replace(view, order=after, scroll=0), ""
    if key == "/":
        return replace(view, typing=True, focus="actors", scroll=0), ""
    if key == "escape":
        return _back_out(view), ""
    if key in "123456789" and int(key) <= extent.runs:
        return replace(view, run=int(key) - 1, scroll=0, back=0), ""
    if key == "enter":
        return replace(view, zoomed=not view.zoomed, focus=view.focus or "actors"), ""
    if (rows := _rows(view, key, extent)) is not None:
        return _scrolled(view, rows, extent), ""
    if key in _FORWARD or key in _BACKWARD:
        return replace(view, focus=_neighbour(view.focus, key in _FORWARD, panels)), ""
    return view, ""


def _type(view: View, key: str) -> View:
    if key == "enter":
        return replace(view, typing=False)
    if key == "escape":
        return replace(view, typing=False, needle="")
    if key == "backspace":
        return replace(view, needle=view.needle[:-1])
    if len(key) == 1 and key.isprintable():
        return replace(view, needle=view.needle + key, scroll=0)
    return view


def _back_out(view: View) -> View:
    """Undo the nearest thing: the filter, the whole screen, the focus."""
    if view.needle:
        return replace(view, needle="")
    if view.zoomed:
        return replace(view, zoomed=False)
    return replace(view, focus="")


def _rows(view: View, key: str, extent: Extent) -> int | None:
    """By how many rows ``key`` scrolls down; None for one that does not."""
    page = max(extent.event_rows if view.focus == "events" else extent.actor_rows, 1)
    total = max(extent.events, extent.actors)
    keys = {"pagedown": page, "pageup": -page, "home": -total, "end": total, "j": 1, "k": -1}
    if view.zoomed and view.focus in SCROLLED:
        keys |= {"down": 1, "up": -1}
    return keys.get(key)


def _scrolled(view: View, rows: int, extent: Extent) -> View:
    if view.focus == "events":
        most = max(extent.events - extent.event_rows, 0)
        return replace(view, back=min(max(view.back - rows, 0), most))
    most = max(extent.actors - extent.actor_rows, 0)
    return replace(view, scroll=min(max(view.scroll + rows, 0), most))


def _neighbour(focus: str, forward: bool, panels: Sequence[str]) -> str:
    if focus not in panels:
        return panels[0 if forward else -1]
    return panels[(panels.index(focus) + (1 if forward else -1)) % len(panels)]
