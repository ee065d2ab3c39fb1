"""``lndrl demo``: the shipped policy walks through a crowd, in the terminal or into a GIF."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lndrl.cli.again import same_command
from lndrl.cli.help import say_next
from lndrl.cli.options import ScenarioName, ShieldOption, check_picture, shield_config
from lndrl.cli.signals import telling
from lndrl.errors import UserError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.live import Live

    from lndrl.navigation import EpisodeRecord
    from lndrl.navigation.snapshot import WorldSnapshot

    Show = Callable[[WorldSnapshot], None]
    Play = Callable[[Callable[[], str]], AbstractContextManager[None]]

SHOWN_EVERY = 0.1
"""s between two pictures, at least; the world goes on by a control step (0.4 s) in each."""
RECORDED_EVERY = 0.4
"""s between pictures of the recorded walk: as fast as it walked."""
LINE_EVERY = 4.0
"""s of the world between two lines where there is no terminal to draw on."""
_LINES_BESIDE = 4
"""Lines that a terminal needs for all but the picture."""
_ARRIVED = {"arrived": "arrived", "collided": "touched somebody or something", "lost": "got lost"}


@telling(lambda: f"the walk was not over; begin again with: {same_command()}")
def demo(
    scenario: ScenarioName = None,
    seed: Annotated[
        int, typer.Option(metavar="SEED", help="Another seed, another start, goal and crowd.")
    ] = 0,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE.gif", help="Write an animation instead.", show_default=False),
    ] = None,
    shield: ShieldOption = False,
) -> None:
    """Let the policy that comes with the program walk through a crowd.

    It is drawn in the terminal, up to four times as fast as it walks. Nothing has to be trained.
    """
    if out is not None:
        check_picture(out, ".gif")
    if seed < 0:
        raise UserError(f"--seed {seed}: must be 0 or more")
    from rich.console import Console

    console = Console(highlight=False)
    if out is not None:
        snapshots: list[WorldSnapshot] = []
        with _told_what_is_awaited(snapshots.append) as show:
            record = _walk(scenario, seed, shield, show)
        _film(snapshots, out)
    else:
        with _told(console) as show:
            record = _walk(scenario, seed, shield, show)
    typer.echo(_how_it_went(record, out))
    say_next("lndrl", "train", "--run", "first", then="one of your own")


@contextmanager
def _told(console: Console) -> Iterator[Show]:
    """Pictures where there is a terminal to draw on, lines elsewhere."""
    if not console.is_terminal or console.is_dumb_terminal:
        with _lines() as draw, _told_what_is_awaited(draw) as show:
            yield show
        return
    from rich.live import Live

    with Live(console=console, auto_refresh=False, vertical_overflow="crop") as live:
        screen = _Screen(console, live)
        with _told_what_is_awaited(screen.draw, screen.recorded) as show:
            yield show


def _walk(scenario: str | None, seed: int, shield: bool, show: Show) -> EpisodeRecord:
    """One episode of the shipped policy; ``show`` gets its start and every control step."""
    from lndrl.config.shipped import SHIPPED_POLICY
    from lndrl.evaluation import EpisodeRunner, settings_for
    from lndrl.planners import planner_source

    source = planner_source(SHIPPED_POLICY, shield=shield_config(shield, None))
    config = settings_for(source, scenario).model_copy(update={"seed": seed})
    (record,) = EpisodeRunner(source, config)([0], lambda world: show(world.snapshot()))
    return record


@contextmanager
def _told_what_is_awaited(draw: Show, play: Play | None = None) -> Iterator[Show]:
    """``draw``; until it is called, a line on stderr says what is loaded or compiled meanwhile.

    ``play`` shows something while kernels are compiled, which takes a minute or more.
    """
    from lndrl import kernels
    from lndrl.view.progress import StatusLine

    with ExitStack() as waiting, ExitStack() as meanwhile:
        line = waiting.enter_context(StatusLine())
        line.update("loading the policy and its world")
        words = ""

        def report(ready: int, needed: int) -> None:
            nonlocal words
            first, words = not words, kernels.words(ready, needed)
            if play is None:
                line.update(f"{words}; only the first start on a machine does that")
            elif first:
                waiting.close()
                meanwhile.enter_context(play(lambda: words))

        def show(snapshot: WorldSnapshot) -> None:
            # The start can be drawn before the first step is compiled, which is still awaited.
            if snapshot.steps:
                meanwhile.close()
                waiting.close()
            if snapshot.steps or not words:
                if play is not None:
                    waiting.close()  # two that redraw one terminal write into each other
                draw(snapshot)

        with kernels.told(report):
            yield show


class _Screen:
    """Draws on a terminal, each picture over the last; the last one stays."""

    def __init__(self, console: Console, live: Live) -> None:
        self._console, self._live = console, live
        self._colours = console.color_system is not None and not console.no_color
        self._last = 0.0

    def draw(self, snapshot: WorldSnapshot) -> None:
        """The picture of a moment, ``SHOWN_EVERY`` s after the last at the earliest."""
        from lndrl.view.walk import walk_words

        time.sleep(max(0.0, self._last + SHOWN_EVERY - time.monotonic()))
        self._last = time.monotonic()
        self._show(snapshot, walk_words(snapshot))

    @contextmanager
    def recorded(self, words: Callable[[], str]) -> Iterator[None]:
        """Play the recorded walk, again and again, from a thread; ``words`` say how far it is."""
        from lndrl.policy.shipped import WALK_FILE
        from lndrl.view.recorded import recorded_walk

        walk, _ = recorded_walk(WALK_FILE)
        over = threading.Event()

        def play() -> None:
            for snapshot in itertools.cycle(walk):
                said = f"recorded; yours follows: {words()}"
                self._show(snapshot, said)
                if over.wait(RECORDED_EVERY):
                    return

        thread = threading.Thread(target=play, name="lndrl-demo", daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()

    def _show(self, snapshot: WorldSnapshot, said: str) -> None:
        from rich.console import Group
        from rich.text import Text

        from lndrl.view.walk import walk_legend, walk_picture

        width, height = self._console.size
        picture = walk_picture(snapshot, width - 1, height - _LINES_BESIDE, self._colours)
        words = Text(said, no_wrap=True, overflow="ellipsis")
        self._live.update(Group(picture, words, walk_legend(self._colours)), refresh=True)


@contextmanager
def _lines() -> Iterator[Show]:
    """A line every ``LINE_EVERY`` s of the world, for pipes and terminals that cannot draw."""
    from lndrl.view.walk import walk_words

    due = 0.0

    def draw(snapshot: WorldSnapshot) -> None:
        nonlocal due
        if snapshot.time >= due - 1e-9:
            due = snapshot.time + LINE_EVERY
            typer.echo(walk_words(snapshot))

    yield draw


def _film(snapshots: list[WorldSnapshot], out: Path) -> None:
    from lndrl.view.pictures.film import save_gif
    from lndrl.view.progress import progress_bar

    try:
        with progress_bar(len(snapshots), f"drawing {out.name}", "pictures") as advance:
            save_gif(snapshots, out, progress=lambda _: advance())
    except OSError as error:
        raise UserError(f"--out {out}: cannot be written ({error.strerror})") from None


def _how_it_went(record: EpisodeRecord, out: Path | None) -> str:
    where = f"{out}: " if out is not None else ""
    ended = _ARRIVED.get(record.outcome, "ran out of time")
    return (
        f"{where}{ended} after {record.time:.1f} s and {record.distance:.1f} m, "
        f"position error {record.position_error:.2f} m"
    )
