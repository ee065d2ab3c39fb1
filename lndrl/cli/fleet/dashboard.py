"""``lndrl dashboard``: watch a running learner; only reads, may come and go at any time."""

from __future__ import annotations

import os
import sys
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lndrl.cli.options import check_endpoint, check_picture
from lndrl.cli.security import (
    Certificates,
    Namespace,
    PasswordFile,
    User,
    ZenohFile,
    client_transport,
    connecting,
)
from lndrl.errors import UserError

if TYPE_CHECKING:
    from rich.console import Console

    from lndrl.transport import ViewerEndpoint
    from lndrl.view.dashboard.feed import News


def dashboard(
    connect: Annotated[
        str, typer.Option("--connect", metavar="ENDPOINT", help="Where the learner listens.")
    ] = "tcp/127.0.0.1:7447",
    endpoints: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[ENDPOINT_OR_RUN]...",
            help="Instead of --connect: one learner or several, drawn side by side; a run on this "
            "machine by its name.",
            show_default=False,
        ),
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="Show the present and leave.")] = False,
    svg: Annotated[
        Path | None,
        typer.Option(
            "--svg", metavar="FILE", help="Draw the present into FILE.svg.", show_default=False
        ),
    ] = None,
    world: Annotated[
        bool, typer.Option("--world", help="With --svg: the first actor's live world.")
    ] = False,
    json: Annotated[
        bool, typer.Option("--json", help="Print a JSON object per update instead of drawing.")
    ] = False,
    theme: Annotated[
        str, typer.Option("--theme", help="Colours for a dark or a light terminal: auto asks it.")
    ] = "auto",
    certs: Certificates = None,
    user: User = None,
    password_file: PasswordFile = None,
    namespace: Namespace = None,
    zenoh: ZenohFile = None,
) -> None:
    """Watch a running learner from another terminal.

    On a terminal: a live view, ? shows its keys, q leaves. Elsewhere: one line per update. It can
    neither slow nor harm the training, but for what an operator asks for on purpose. When the
    learner goes away it keeps trying.
    """
    from rich.console import Console

    from lndrl.transport import open_viewer
    from lndrl.view.dashboard.feed import Feed, first_news
    from lndrl.view.dashboard.live import json_line, show_json, show_lines, show_live, show_once
    from lndrl.view.dashboard.theme import THEMES

    if theme not in THEMES:
        raise UserError(f"--theme {theme}: unknown; write {', '.join(THEMES)}")
    places = [_place(words) for words in endpoints or ()]
    places = places or [check_endpoint(connect, "--connect")]
    console = Console(highlight=False)
    drawn = console.is_terminal and not console.is_dumb_terminal and not json
    _check(svg, world, len(places), drawn or once or svg is not None)
    security = connecting(_role(certs, user), certs, user, password_file, zenoh)
    with ExitStack() as stack:
        feeds: list[Feed] = []
        found: list[tuple[News, ViewerEndpoint]] = []
        try:
            for place in places:
                open_it = partial(open_viewer, place, client_transport(place, namespace), security)
                viewer = open_it()
                stack.callback(viewer.close)
                news = first_news(viewer, place)
                found.append((news, viewer))
                if once and svg is None:
                    print(json_line(news)) if json else show_once(news, console, theme)
                elif svg is None:
                    feeds.append(Feed(open_it, viewer, news))
                    stack.callback(feeds[-1].close)
            if svg is not None:
                _draw(found, svg, world, theme, console)
            elif json and feeds:
                show_json(feeds[0], _write)
            elif drawn and feeds:
                show_live(feeds, console, theme)
            elif feeds:
                show_lines(feeds[0], _write)
        except BrokenPipeError:
            # The reader (head, less) has seen enough; keep Python from complaining at exit.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _place(words: str) -> str:
    """The endpoint that is written, or that of a run on this machine."""
    from lndrl.cli.runs import RUNS
    from lndrl.config import load_config
    from lndrl.transport import reachable

    for folder in (RUNS / words, Path(words)):
        if (folder / "config.yaml").is_file():
            return reachable(load_config(folder / "config.yaml").transport.endpoint)
    return check_endpoint(words, "ENDPOINT_OR_RUN")


def _check(svg: Path | None, world: bool, runs: int, drawn: bool) -> None:
    """Raises UserError for what does not go together, and for a picture that cannot be written."""
    if svg is not None:
        check_picture(svg, ".svg", option="--svg")
    elif world:
        raise UserError("--world goes with --svg; in a live view, press l")
    if world and runs > 1:
        raise UserError("--world shows one world; name one learner")
    if runs > 1 and not drawn:
        raise UserError("several runs are drawn side by side in a terminal; else name one")


def _draw(
    found: list[tuple[News, ViewerEndpoint]],
    path: Path,
    world: bool,
    theme: str,
    console: Console,
) -> None:
    """Draw the present, as wide and high as the terminal is."""
    from lndrl.view.dashboard.picture import SIZE, picture_lines, save_svg, world_lines
    from lndrl.view.dashboard.theme import chosen
    from lndrl.view.text import printable

    width, height = console.size if console.is_terminal else _asked_size(SIZE)
    news, viewer = found[0]
    if world:
        lines = world_lines(news, viewer.watch, width, height)
    else:
        lines = picture_lines([each for each, _ in found], width, height)
    title = "lndrl dashboard: " + ", ".join(printable(n.status.run_name) for n, _ in found)
    try:
        save_svg(lines, width, path, chosen(theme), title)
    except OSError as error:
        raise UserError(f"--svg {path}: cannot be written ({error.strerror})") from None
    typer.echo(f"{path}: {width} x {height} characters")


def _asked_size(otherwise: tuple[int, int]) -> tuple[int, int]:
    """COLUMNS and LINES of the environment, where they are numbers."""
    given = (os.environ.get("COLUMNS", ""), os.environ.get("LINES", ""))
    columns, lines = (
        int(words) if words.isdecimal() and int(words) > 0 else usual
        for words, usual in zip(given, otherwise, strict=True)
    )
    return columns, lines


def _role(certs: Path | None, user: str | None) -> str:
    """operator for who has its certificate or is a user of that name, else dashboard."""
    from lndrl.transport.security.access import role_of

    if user is not None:
        return "operator" if role_of(user) == "operator" else "dashboard"
    has_one = certs is not None and (certs / "operator.pem").exists()
    return "operator" if has_one else "dashboard"


def _write(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()
