"""What a page is made of, as plain data: the template alone knows HTML."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Literal

Tone = Literal["", "good", "bad", "lost", "quiet"]
"""What a figure or a badge means: arrived or met, collided or not met, lost, all else."""

OUTCOME_TONE: dict[str, Tone] = {
    "arrived": "good",
    "collided": "bad",
    "lost": "lost",
    "timeout": "quiet",
}


@dataclass(frozen=True)
class Tile:
    """A large figure, what it is, and a line below."""

    name: str
    value: str
    note: str = ""
    tone: Tone = ""


@dataclass(frozen=True)
class Tiles:
    """Large figures beside each other."""

    tiles: Sequence[Tile]
    kind: ClassVar[str] = "tiles"


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    words: str
    kind: ClassVar[str] = "text"


@dataclass(frozen=True)
class Command:
    """A command line to copy, and what it does."""

    line: str
    does: str
    kind: ClassVar[str] = "command"


@dataclass(frozen=True)
class Facts:
    """Terms and what they are."""

    facts: Sequence[tuple[str, str]]
    kind: ClassVar[str] = "facts"


@dataclass(frozen=True)
class Table:
    """Rows under ``head``, each headed by its first cell; ``caption`` says what they are.

    ``words`` are the columns that stand left, ``quiet`` the rows that are there to compare with,
    ``tones`` cells by what they say.
    """

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: frozenset[int] = frozenset({0})
    quiet: frozenset[int] = frozenset()
    tones: dict[str, Tone] = field(default_factory=dict)
    kind: ClassVar[str] = "table"


@dataclass(frozen=True)
class Picture:
    """A drawing: ``svg`` (markup) or ``uri`` (data:), ``alt`` in words with its figures.

    ``wide``: too small on a phone's screen, so it may be moved sideways there. ``badge`` and
    ``tone`` say how the episode that it shows ended.
    """

    alt: str
    caption: str
    width: int
    height: int
    svg: str = ""
    uri: str = ""
    wide: bool = False
    badge: str = ""
    tone: Tone = ""
    kind: ClassVar[str] = "picture"


@dataclass(frozen=True)
class Gallery:
    """Pictures beside each other, as many in a row as have room at ``least`` pixels each."""

    pictures: Sequence[Picture]
    least: int = 300
    kind: ClassVar[str] = "gallery"


@dataclass(frozen=True)
class Listing:
    """Text as it stands in a file."""

    text: str
    kind: ClassVar[str] = "listing"


Part = Tiles | Text | Command | Facts | Table | Picture | Gallery | Listing


@dataclass(frozen=True)
class Folded:
    """Parts that are shown when asked for, and printed."""

    summary: str
    parts: Sequence[Part]
    kind: ClassVar[str] = "folded"


@dataclass(frozen=True)
class Section:
    """A chapter; ``name`` is its anchor, unique on the page."""

    name: str
    title: str
    parts: Sequence[Part | Folded]


@dataclass(frozen=True)
class Page:
    """A whole page. ``badge`` says how its subject stands; ``made`` by what and when."""

    title: str
    lead: str
    sections: Sequence[Section]
    made: str
    badge: str = ""
    tone: Tone = ""
