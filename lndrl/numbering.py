"""Names that hold numbers, in the order of these: actor-2 before actor-10."""

from __future__ import annotations

import re
from pathlib import Path

_DIGITS = re.compile(r"([0-9]+)")
BEST = "best"
"""Folder beside the checkpoints, of the policy that did best in validation; no checkpoint itself:
training never goes on from it."""

_CHECKPOINT = re.compile(r"step-([0-9]+)")

Key = tuple[tuple[str | tuple[int, str], ...], str]


def by_number(name: str | Path) -> Key:
    """Sort key of a name or path: digits compare as the numbers they are, the rest as text.

    Takes any number of digits, which names from the network may have; names that differ in leading
    zeros alone are ordered as text.
    """
    text = str(name)
    parts = _DIGITS.split(text)
    # As int() would compare them, which refuses more than 4,300 digits.
    numbers = [(len(digits.lstrip("0")), digits.lstrip("0")) for digits in parts[1::2]]
    keys: list[str | tuple[int, str]] = [*parts]
    keys[1::2] = numbers
    return tuple(keys), text


def checkpoint_name(steps: int) -> str:
    """What the checkpoint after ``steps`` environment steps is called."""
    return f"step-{steps:09d}"


def checkpoints_in(folder: Path) -> list[Path]:
    """The checkpoints in ``folder``, oldest first; folders of other names are none."""
    found = [path for path in folder.glob("step-*") if _CHECKPOINT.fullmatch(path.name)]
    return sorted((path for path in found if path.is_dir()), key=step_of)


def step_of(checkpoint: Path) -> int:
    """Environment steps before a checkpoint, by its name; raises ValueError for another name."""
    match = _CHECKPOINT.fullmatch(checkpoint.name)
    if match is None:
        raise ValueError(f"{checkpoint.name} is not the name of a checkpoint")
    return int(match[1])
