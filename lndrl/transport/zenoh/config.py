"""zenoh's configuration from our settings, the operator's file applied last."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import zenoh

from lndrl.errors import UserError
from lndrl.transport.security.identity import Security, check_exposure


def build(settings: Mapping[str, Any], security: Security | None = None) -> zenoh.Config:
    """The configuration of ``settings`` (path to value) and the overlay of ``security``.

    Raises UserError for what is not safe, unless there is no ``security`` to ask. An overlay is
    merged key by key; its lists replace ours.
    """
    nested: dict[str, Any] = {}
    for path, value in settings.items():
        nested = merged(nested, _at(path.split("/"), value))
    if security is not None and security.overlay is not None:
        overlay = read_overlay(security.overlay)
        nested = merged(nested, overlay)
        _check(overlay, security.overlay)
    if security is not None:
        check_exposure(nested, security.insecure)
    return zenoh.Config.from_json5(json.dumps(nested))


def read_overlay(path: Path) -> dict[str, Any]:
    """The settings of a JSON5 file; raises UserError. zenoh's own reader parses it."""
    carrier = zenoh.Config()
    try:
        # `metadata` takes any JSON5 and gives it back as it was written, without defaults.
        carrier.insert_json5("metadata", path.read_text("utf-8"))
    except FileNotFoundError:
        raise UserError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError):
        raise UserError(f"{path}: cannot be read as text in UTF-8") from None
    except zenoh.ZError as error:
        # zenoh's text quotes the line, which may hold a password.
        found = re.search(r"line: (\d+), column: (\d+)", str(error))
        where = f", line {found[1]}, column {found[2]}" if found else ""
        raise UserError(f"{path}{where}: is not JSON5") from None
    data = json.loads(carrier.get_json("metadata"))
    if not isinstance(data, dict):
        raise UserError(f"{path}: must hold keys and values between braces")
    return data


def merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """``below`` with what ``above`` says, key by key."""
    result = dict(below)
    for key, value in above.items():
        old = result.get(key)
        if isinstance(old, Mapping) and isinstance(value, Mapping):
            value = merged(old, value)
        result[key] = value
    return result


def _check(overlay: Mapping[str, Any], path: Path) -> None:
    """Name the key that zenoh does not accept, and never its value."""
    if _accepted(overlay):
        return
    for keys, value in _leaves(overlay):
        if not _accepted(_at(keys, value)):
            raise UserError(f"{path}: {'/'.join(keys)} is not a setting of zenoh, or not so")
    raise UserError(f"{path}: zenoh does not accept these settings together")


def _accepted(nested: Mapping[str, Any]) -> bool:
    try:
        zenoh.Config.from_json5(json.dumps(nested))
    except zenoh.ZError:
        return False
    return True


def _leaves(nested: Mapping[str, Any], above: tuple[str, ...] = ()) -> Iterator[tuple[Any, Any]]:
    for key, value in nested.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, (*above, key))
        else:
            yield (*above, key), value


def _at(keys: Any, value: Any) -> dict[str, Any]:
    for key in reversed(keys):
        value = {key: value}
    return value
