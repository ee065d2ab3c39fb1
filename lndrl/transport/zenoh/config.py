"""zenoh's configuration from our settings, the operator's file applied last."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import zenoh

from lndrl.errors import UserError
from lndrl.transport.security.exposure import check_exposure, check_interfaces, endpoints_of
from lndrl.transport.security.identity import Security
from lndrl.transport.zenoh.overlay import at, check_overlay, read_overlay


def build(settings: Mapping[str, Any], security: Security | None = None) -> zenoh.Config:
    """The configuration of ``settings`` (path to value) and the overlay of ``security``.

    Raises UserError for what is not safe, unless there is no ``security`` to ask. An overlay is
    merged key by key; its lists replace ours.
    """
    nested: dict[str, Any] = {}
    for path, value in settings.items():
        nested = merged(nested, at(path.split("/"), value))
    if security is not None and security.overlay is not None:
        overlay = read_overlay(security.overlay)
        check_overlay(overlay, security.overlay)
        nested = merged(nested, overlay)
    if security is not None:
        check_exposure(nested, security.insecure)
        check_interfaces(nested)
    try:
        return zenoh.Config.from_json5(json.dumps(nested))
    except zenoh.ZError:
        if security is None or security.overlay is None:
            raise
        raise UserError(
            f"{security.overlay}: zenoh does not accept these settings beside those of lndrl"
        ) from None


def destination(endpoint: str, security: Security | None) -> str:
    """Where a client of ``endpoint`` truly connects to, in words: an overlay's list replaces it."""
    if security is None or security.overlay is None:
        return endpoint
    overlay = read_overlay(security.overlay)
    check_overlay(overlay, security.overlay)
    endpoints = " or ".join(endpoints_of(overlay, "connect"))
    return f"{endpoints} (from {security.overlay})" if endpoints else endpoint


def merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """``below`` with what ``above`` says, key by key."""
    result = dict(below)
    for key, value in above.items():
        old = result.get(key)
        if isinstance(old, Mapping) and isinstance(value, Mapping):
            value = merged(old, value)
        result[key] = value
    return result
