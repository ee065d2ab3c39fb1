"""Numbers in sentences: how many of what, and from how many to how many."""

from __future__ import annotations


def counted(count: int, one: str, many: str = "") -> str:
    """``count`` with its noun: ``1 chunk``, ``1,024 chunks``; ``many`` defaults to one + s."""
    return f"{count:,} {one if count == 1 else many or one + 's'}"


def span(low: float, high: float) -> str:
    """From ``low`` to ``high`` in words, one number where both read the same."""
    ends = (f"{low:g}", f"{high:g}")
    return ends[0] if ends[0] == ends[1] else f"{ends[0]} to {ends[1]}"


def people(count: tuple[int, int]) -> str:
    """A crowd of ``count`` (fewest, most): ``4 people``, ``1 person``, ``no people``, ``8 to 12
    people``.
    """
    if count == (0, 0):
        return "no people"
    return f"{span(*count)} {'person' if count == (1, 1) else 'people'}"
