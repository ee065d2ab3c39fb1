"""Which key somebody meant who wrote one that there is not: a slip of the pen, never a guess.

Keys are words between underscores. ``laser_min_range`` looks much like ``laser_max_range`` and
means the opposite, so likeness of whole keys says nothing: word by word, only what is no word of
any key can be a slip, and numbers are never one.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Iterable

_ALIKE = 0.75
"""Least likeness of a mistyped word: ``cuont`` and ``count`` have 0.8, ``reward`` and ``ward``
0.8, ``approach`` and ``arrive`` 0.43."""


def meant_key(unknown: str, known: Iterable[str], vocabulary: Collection[str]) -> str | None:
    """The one of ``known`` keys that ``unknown`` stands for, None where that is not plain.

    It has the same words, with slips (``cuont``), in the other number (``beam``), another order
    (``max_range``) or run together (``maxrange``), or the last or first of them where no other key
    has those (``sigma_hit``, ``alpha1``).
    ``vocabulary``: all words of all keys, which are no slips of each other.
    """
    known = list(known)
    words = unknown.lower().split("_")
    for key in known:
        if sorted(key.split("_")) == sorted(words) or key.replace("_", "") == "".join(words):
            return key
    likeness = {key: _likeness(words, key.split("_"), vocabulary) for key in known}
    best = max(likeness, key=lambda key: likeness[key], default=None)
    if best is not None and likeness[best] > 0.0:
        return best
    part = "_".join(words)
    whole = [key for key in known if key.endswith(f"_{part}") or key.startswith(f"{part}_")]
    telling = len(words) > 1 or part[-1:].isdigit()  # a lone scale may be of anything
    return whole[0] if telling and len(whole) == 1 else None


def _likeness(words: list[str], others: list[str], vocabulary: Collection[str]) -> float:
    """0 where a word is another one, else how alike the least alike two words are, at most 1."""
    if len(words) != len(others):
        return 0.0
    return min(_word_likeness(*pair, vocabulary) for pair in zip(words, others, strict=True))


def _word_likeness(word: str, other: str, vocabulary: Collection[str]) -> float:
    if word == other:
        return 1.0
    if other in (f"{word}s", word.removesuffix("s"), word.removesuffix("y") + "ies"):
        return 0.95
    if word in vocabulary or re.findall(r"\d+", word) != re.findall(r"\d+", other):
        return 0.0
    alike = difflib.SequenceMatcher(None, word, other).ratio()
    return alike if alike >= _ALIKE and min(len(word), len(other)) >= 3 else 0.0
