"""Tables in Markdown documents: the part between two marks that a command writes anew."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from lndrl.errors import UserError

END = "<!-- end -->"
_TAG = re.compile(r"<(?=[A-Za-z/!?])")

Row = tuple[str, ...]


def write_between_marks(path: Path, kind: str, name: str, text: str) -> None:
    """Put ``text`` between the marks of ``kind`` ``name`` in ``path``, which is made if need be.

    Raises UserError as ``check_document`` does, and where ``path`` cannot be written.
    """
    before, after = check_document(path, kind, name)
    try:
        path.write_text(f"{before}{_begin(kind, name)}\n\n{text}\n\n{END}{after}", encoding="utf-8")
    except OSError as error:
        raise UserError(f"{path}: cannot be written ({error.strerror})") from None


def check_document(path: Path, kind: str, name: str) -> tuple[str, str]:
    """What stands before and after the part of ``kind`` ``name``: before the work, not after.

    Raises UserError for a file without its marks, another ending, or a missing folder.
    """
    if path.suffix != ".md":
        raise UserError(f"--markdown {path}: must end in .md")
    if not path.parent.is_dir():
        raise UserError(f"--markdown {path}: the folder {path.parent} does not exist")
    if not path.exists():
        return "", "\n"
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: cannot be read ({error})") from None
    before, begin, rest = text.partition(_begin(kind, name))
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise UserError(
            f"{path}: has no place for the {kind}; put the lines {_begin(kind, name)} and {END} "
            "into it"
        )
    return before, after


def markdown_table(head: Row, rows: Sequence[Row]) -> str:
    """``rows`` under ``head``; stars, bars and tags are shown, not taken for Markdown."""
    lines = [_line(head), "|" + "---|" * len(head)]
    lines += [_line(tuple(map(_shown, row))) for row in rows]
    return "\n".join(lines)


def _shown(cell: str) -> str:
    return _TAG.sub("&lt;", cell.replace("*", "\\*").replace("|", "\\|"))


def _begin(kind: str, name: str) -> str:
    return f"<!-- {kind} {name} -->"


def _line(cells: Row) -> str:
    return "| " + " | ".join(cells) + " |"
