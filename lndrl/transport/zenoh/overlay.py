"""The operator's file of zenoh settings: read, and refused in a sentence where zenoh would not."""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import zenoh

from lndrl.errors import UserError

DEEPEST = 64
"""Levels of brackets; zenoh's reader ends the whole process at some thousand."""
MODES = {"router", "peer", "client"}
_OWN_BUSINESS = ("plugins", "metadata")  # anything may stand there


def read_overlay(path: Path) -> dict[str, Any]:
    """The settings of a JSON5 file; raises UserError. zenoh's own reader parses it."""
    try:
        text = path.read_text("utf-8")
    except FileNotFoundError:
        raise UserError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError):
        raise UserError(f"{path}: cannot be read as text in UTF-8") from None
    if _depth(text) > DEEPEST:
        raise UserError(f"{path}: is nested too deeply")
    carrier = zenoh.Config()
    try:
        # `metadata` takes any JSON5 and gives it back as it was written, without defaults.
        carrier.insert_json5("metadata", text)
    except zenoh.ZError as error:
        # zenoh's text quotes the line, which may hold a password.
        found = re.search(r"line: (\d+), column: (\d+)", str(error))
        where = f", line {found[1]}, column {found[2]}" if found else ""
        raise UserError(f"{path}{where}: is not JSON5") from None
    data = json.loads(carrier.get_json("metadata"))
    if not isinstance(data, dict):
        raise UserError(f"{path}: must hold keys and values between braces")
    return data


def check_overlay(overlay: Mapping[str, Any], path: Path) -> None:
    """Name the key that zenoh does not accept, or would pass over, and never its value."""
    read = _read(overlay)
    if read is not None:
        for keys, problem in _misread(overlay, read, json.loads(str(zenoh.Config()))):
            raise UserError(f"{path}: {_named(keys)} {problem}")
        return
    for keys, value in _leaves(overlay):
        if _read(at(keys, value)) is None:
            hint = _meant(keys, json.loads(str(zenoh.Config())))
            raise UserError(f"{path}: {_named(keys)} is not a setting of zenoh, or not so{hint}")
    raise UserError(f"{path}: zenoh does not accept these settings together")


def at(keys: Any, value: Any) -> dict[str, Any]:
    """``value`` below ``keys``, from the outermost to the innermost."""
    for key in reversed(keys):
        value = {key: value}
    return value


def _read(nested: Mapping[str, Any]) -> dict[str, Any] | None:
    """What zenoh reads from ``nested``, defaults added; None where it refuses."""
    try:
        return json.loads(str(zenoh.Config.from_json5(json.dumps(nested))))
    except zenoh.ZError:
        return None


def _misread(
    given: Any, read: Any, default: Any, above: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], str]]:
    """Keys that zenoh passes over in silence or takes for something else, and what is wrong."""
    if above and above[0] in _OWN_BUSINESS:
        return
    if isinstance(given, Mapping):
        for key, value in given.items():
            below = (*above, key)
            if not isinstance(read, Mapping) or key not in read:
                yield below, f"is not a setting of zenoh{_meant((key,), read)}"
                continue
            usual = default.get(key) if isinstance(default, Mapping) else None
            yield from _misread(value, read[key], usual, below)
    elif isinstance(given, list) and isinstance(read, Mapping):
        yield above, "must hold keys and values between braces"
    elif isinstance(given, list) and isinstance(read, list) and len(given) == len(read):
        for number, (value, taken) in enumerate(zip(given, read, strict=True)):
            if isinstance(value, Mapping):
                yield from _misread(value, taken, None, (*above, str(number)))
    elif given is None and default is not None and not _is_per_mode(default):
        yield above, "must not be null; leave it out for zenoh's own value"


def _meant(keys: tuple[str, ...], known: Any) -> str:
    """A hint where the first of ``keys`` that ``known`` lacks, level by level, is close to one."""
    for key in keys:
        if not isinstance(known, Mapping) or not known:
            break
        if key not in known:
            close = difflib.get_close_matches(key, list(known), n=1)
            return f"; did you mean {close[0]}?" if close else ""
        known = known[key]
    return ""


def _is_per_mode(default: Any) -> bool:
    return isinstance(default, Mapping) and set(default) <= MODES


def _leaves(nested: Mapping[str, Any], above: tuple[str, ...] = ()) -> Iterator[tuple[Any, Any]]:
    for key, value in nested.items():
        if isinstance(value, Mapping) and value:
            yield from _leaves(value, (*above, key))
        else:
            yield (*above, key), value


def _named(keys: tuple[str, ...]) -> str:
    return "/".join(key if key.isprintable() and key else json.dumps(key) for key in keys)


def _depth(text: str) -> int:
    """Most brackets that are open at once, or more where some stand in words and comments."""
    depth = deepest = 0
    for letter in text:
        if letter in "[{":
            depth += 1
            deepest = max(deepest, depth)
        elif letter in "]}":
            depth = max(0, depth - 1)
    return deepest
