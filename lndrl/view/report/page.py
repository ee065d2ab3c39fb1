"""A page as HTML, whole or not at all."""

from __future__ import annotations

import os
from functools import cache
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from lndrl.errors import UserError
from lndrl.view.report.parts import Page

_ROOM = "lndrl.view.report"


def check_page(out: Path, named: str = "--out") -> None:
    """Raise UserError unless a page can be written to ``out``: before the work, not after."""
    if out.suffix.lower() not in (".html", ".htm"):
        raise UserError(f"{named} {out}: must end in .html")
    if not out.parent.is_dir():
        raise UserError(f"{named} {out}: folder {out.parent} does not exist")
    if out.is_dir():
        raise UserError(f"{named} {out}: is a folder; name a file")
    if not os.access(out.parent, os.W_OK):
        raise UserError(f"{named} {out}: folder {out.parent} cannot be written; name another file")


def render(page: Page) -> str:
    """``page`` as one HTML document that asks for nothing else."""
    style = files(_ROOM).joinpath("templates", "page.css").read_text("utf-8")
    return _environment().get_template("page.html").render(page=page, style=style)


def write_page(page: Page, out: Path) -> None:
    """Write ``page`` whole or not at all; raises UserError where the disk refuses."""
    temporary = out.with_name(f".{out.name}.partial")
    try:
        temporary.write_text(render(page), encoding="utf-8")
        temporary.replace(out)
    except OSError as error:
        raise UserError(f"{out}: cannot be written ({error.strerror})") from None
    finally:
        temporary.unlink(missing_ok=True)


@cache
def _environment() -> Environment:
    return Environment(
        loader=PackageLoader(_ROOM, "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
