"""Which command lines of the pages are run, and how: the rule of docs/documentation.md."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path

from tests.docs.pages import ROOT

RUNS = ("first", "second", "a", "b", "mine", "example")
"""Runs of the pages that a moment's training stands for."""
FOLLOWED = ("docs/tutorial.md",)
"""Pages that are followed from the first command to the last, with fewer steps and episodes."""
_ALONE = ("version", "config", "scenarios", "certs", "runs", "curves")


def as_it_stands(words: Sequence[str]) -> bool:
    """Whether a command costs about a second at most and all that it names is there."""
    name, *rest = words
    if name not in _ALONE or any(word in rest for word in ("--localizability", "--draw")):
        return False
    if name == "certs" and "--renew" in rest:  # of what there is already
        return False
    return all(map(_is_there, rest))


def shortened(words: Sequence[str]) -> list[str] | None:
    """A command that drives episodes or trains as one that takes a moment; None for others.

    It wants the folder that ``small_run`` has filled.
    """
    name, *rest = words
    if name == "train":
        if "--steps" in rest:
            rest[rest.index("--steps") + 1] = "64"
        return ["train", *([] if "--resume" in rest else ["small.yaml"]), *rest, "--serial"]
    if name in ("evaluate", "lost"):
        if "--episodes" not in rest:
            rest += ["--episodes", "1"]
        rest[rest.index("--episodes") + 1] = "1"
        return [name, *rest, "--workers", "0"]
    if name == "play":
        return [name, *(word.replace(".gif", ".png") for word in rest)]
    # What is run as it stands, or by tests of its own, is not run here again.
    return ["runs"] if list(words) == ["runs"] else None


def shape(words: Sequence[str]) -> tuple[str, ...]:
    """What two commands share that do the same to something else: all but values and names."""
    name, *rest = words
    inner = [rest[0]] if name in ("config", "runs", "figures") and rest else []
    return (name, *inner, *sorted(word for word in rest if word.startswith("--")))


def _is_there(word: str) -> bool:
    """Whether a word names nothing that only a reader has."""
    if word.startswith("runs/"):
        return word.removeprefix("runs/") in RUNS
    if word.isupper() or "NAME" in word:
        return False
    path = Path(word)
    if word.startswith(("docs/", "deploy/")):
        return False  # it would be written
    with contextlib.suppress(OSError):
        return path.suffix not in (".yaml", ".md") or (ROOT / path).exists()
    return True
