"""What stands in the pages: command lines of ``lndrl`` and blocks of code, with where they are."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    [
        *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")),
        *ROOT.glob("docs/*.md"),
        *ROOT.glob("docs/extend/*.md"),
        *ROOT.glob("deploy/*.md"),
    ]
)
_FENCE = re.compile(r"^(\s*)```(\w*)\s*$")
_INLINE = re.compile(r"(?<!`)`((?:[\w.]*/)*lndrl [^`]+)`(?!`)")
_ENDS = {"|", "||", "&&", "&", ";", ">", ">>", "2>&1", "<"}


class Command(NamedTuple):
    """A command line: ``words`` after ``lndrl``; ``block``: by itself, not in a sentence."""

    page: str
    line: int
    words: tuple[str, ...]
    block: bool

    def __str__(self) -> str:
        return f"{self.page}:{self.line}: lndrl {shlex.join(self.words)}"


class Block(NamedTuple):
    """A fenced block."""

    page: str
    line: int
    language: str
    text: str


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def blocks(path: Path) -> Iterator[Block]:
    """Every fenced block of a page."""
    opened: tuple[int, str, str] | None = None
    lines: list[str] = []
    for number, line in enumerate(path.read_text("utf-8").splitlines(), 1):
        fence = _FENCE.match(line)
        if fence and opened is None:
            opened, lines = (number, fence[1], fence[2]), []
        elif fence and opened is not None:
            text = "\n".join(each.removeprefix(opened[1]) for each in lines)
            yield Block(name_of(path), opened[0], opened[2], text + "\n")
            opened = None
        elif opened is not None:
            lines.append(line)


def commands(path: Path) -> Iterator[Command]:
    """Every command line of a page, those of blocks first line by line, then those in sentences."""
    fenced, language = False, ""
    text = path.read_text("utf-8")
    prose: list[str] = []
    continued = ""
    for number, line in enumerate(text.splitlines(), 1):
        fence = _FENCE.match(line)
        if fence:
            fenced, language = not fenced, fence[2]
            prose.append("")
            continue
        if (fenced and language in ("", "sh", "bash", "console")) or (
            not fenced and line.startswith("    ")
        ):
            line = continued + line.strip()
            continued = line[:-1] if line.endswith("\\") else ""
            if not continued:
                yield from (
                    Command(name_of(path), number, words, True) for words in command_lines(line)
                )
            prose.append("" if fenced or not _is_prose(line) else line)
        else:
            prose.append("" if fenced else line)
    whole = "\n".join(prose)
    for match in _INLINE.finditer(whole):
        number = whole.count("\n", 0, match.start()) + 1
        for words in command_lines(" ".join(match[1].split())):
            yield Command(name_of(path), number, words, False)


def _is_prose(line: str) -> bool:
    """Whether an indented line is a list's, not a block's."""
    return "`" in line


def command_lines(line: str) -> Iterator[tuple[str, ...]]:
    """What follows ``lndrl`` in a shell's line, once for every command of ``lndrl`` in it."""
    if "..." in line or "…" in line:  # something is left out
        return
    try:
        words = _split(line)
    except ValueError:  # an apostrophe: a sentence
        return
    found: list[str] | None = None
    for word in words:
        if word in _ENDS:
            if found:
                yield tuple(found)
            found = None
        elif found is not None:
            found.append(word)
        elif word == "lndrl" or word.endswith("/lndrl"):
            found = []
        elif not _may_precede(word):
            return
    if found:
        yield tuple(found)


def _may_precede(word: str) -> bool:
    """Whether ``word`` leaves it open that a command follows."""
    return "=" in word or word in ("nohup", "time", "exec", "sudo", "srun", "uvx", "$")


def _split(line: str) -> list[str]:
    lexer = shlex.shlex(line, posix=True, punctuation_chars=";&|<>")
    lexer.whitespace_split = True
    lexer.commenters = "#"
    return list(lexer)
