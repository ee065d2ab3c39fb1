"""``lndrl dashboard``: watch a running learner; only reads, may come and go at any time."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from lndrl.cli.options import check_endpoint
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


def dashboard(
    connect: Annotated[
        str, typer.Option("--connect", metavar="ENDPOINT", help="Where the learner listens.")
    ] = "tcp/127.0.0.1:7447",
    once: Annotated[bool, typer.Option("--once", help="Show the present and leave.")] = False,
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

    endpoint = check_endpoint(connect, "--connect")
    if theme not in THEMES:
        raise UserError(f"--theme {theme}: unknown; write {', '.join(THEMES)}")
    transport = client_transport(endpoint, namespace)
    role = _role(certs, user)
    security = connecting(role, certs, user, password_file, zenoh)
    viewer = open_viewer(endpoint, transport, security)
    feed = None
    console = Console(highlight=False)
    try:
        news = first_news(viewer, endpoint)
        if once:
            print(json_line(news)) if json else show_once(news, console, theme)
            return
        feed = Feed(lambda: open_viewer(endpoint, transport, security), viewer, news)
        if json:
            show_json(feed, _write)
        elif console.is_terminal and not console.is_dumb_terminal:
            show_live(feed, console, theme)
        else:
            show_lines(feed, _write)
    except BrokenPipeError:
        # The reader (head, less) has seen enough; keep Python from complaining at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    finally:
        feed.close() if feed is not None else viewer.close()


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
