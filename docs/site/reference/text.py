"""Markdown of the reference: tables whose cells hold anything, docstrings as paragraphs."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable, Sequence


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; cells may hold any text."""
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    lines += [f"| {' | '.join(map(_cell, row))} |" for row in rows]
    return "\n".join(lines)


def code(text: object) -> str:
    """``text`` as code, also where it holds backticks; nothing for an empty one."""
    said = str(text)
    return f"`` {said} ``" if "`" in said else f"`{said}`" if said else ""


def said(docstring: str | None) -> str:
    """A docstring as Markdown: code has one backtick, and paragraphs stay."""
    text = inspect.cleandoc(docstring or "")
    return re.sub(r"``(.+?)``", r"`\1`", text)


def plain(text: str) -> str:
    """Words of the program that Markdown must not read: ``*``, ``_``, brackets and ``<``."""
    return re.sub(r"([*_\[\]])", r"\\\1", text).replace("<", "&lt;")


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
