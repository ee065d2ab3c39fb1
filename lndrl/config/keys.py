"""The keys of a configuration file: what each means, its default and its limits."""

from __future__ import annotations

import difflib
import types
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import yaml
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from lndrl.config.run import RunConfig
from lndrl.errors import UserError
from lndrl.models import MOST, Model

SOURCES = {
    "PAPER": "LNDRL, arXiv 2303.12354",
    "LAUNCH": "the AMCL launch file that its authors published",
    "GROUP": "the code of the same group, which the paper refers to",
}
"""Where numbers come from, as descriptions say it in brackets; with a number, theirs is that."""

_LIMITS = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}


@dataclass(frozen=True)
class Key:
    """One key of a configuration, such as ``ppo.epochs``.

    ``kind`` says in words what it may hold, ``default`` is YAML. ``is_value`` is False for a key
    that holds other keys.
    """

    name: str
    kind: str
    default: str
    description: str
    is_value: bool


def keys(model: type[Model] = RunConfig) -> dict[str, Key]:
    """Every key of ``model`` by its dotted name, in the order of a file.

    Those of a list's entries stand below the list's name.
    """
    return {key.name: key for key in _walk(model, "")}


def find_keys(name: str) -> list[Key]:
    """The key ``name`` and all that it holds; raises UserError with the nearest for others.

    A name that a user gave an entry may stand in it, as it does in files and sentences.
    """
    known = keys()
    name = _without_given_name(name, known)
    if name not in known:
        last = name.rpartition(".")[2]
        close = difflib.get_close_matches(name, known, n=3)
        close += [k for k in known if k.rpartition(".")[2] == last and k not in close]
        hint = f"did you mean {' or '.join(close)}?" if close else "lndrl config explain lists all"
        raise UserError(f"key {name} is unknown; {hint}")
    return [key for key in known.values() if f"{key.name}.".startswith(f"{name}.")]


def _without_given_name(name: str, known: Mapping[str, Key]) -> str:
    """``task.reward.terms.use`` for ``task.reward.terms.mine.use``."""
    for holder, key in known.items():
        if not key.is_value and key.default == "{}" and name.startswith(f"{holder}."):
            _, _, below = name.removeprefix(f"{holder}.").partition(".")
            meant = f"{holder}.{below}" if below else holder
            return meant if name not in known and meant in known else name
    return name


def flatten(data: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested mappings as one, with dotted keys; lists are values."""
    flat: dict[str, Any] = {}
    for key, value in data.items():
        if isinstance(value, Mapping) and value:
            flat |= flatten(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def differences(one: Model, other: Model) -> dict[str, tuple[Any, Any]]:
    """Dotted keys in which two configurations differ, with both values; None: it has no such key.

    Whatever they leave to defaults counts as said.
    """
    flat = [flatten(each.model_dump(mode="json")) for each in (one, other)]
    return {
        key: (flat[0].get(key), flat[1].get(key))
        for key in dict.fromkeys([*flat[0], *flat[1]])
        if flat[0].get(key) != flat[1].get(key)
    }


def _walk(model: type[Model], prefix: str, above: tuple[type[Model], ...] = ()) -> Iterator[Key]:
    """Keys of ``model``; what holds one of its own kind is not entered again."""
    for name, field in model.model_fields.items():
        inner = list(_models(field.annotation))
        yield Key(
            prefix + name,
            _words(field.annotation, [*field.metadata]),
            _default(field, bool(inner)),
            field.description or "",
            not inner,
        )
        for each in inner:
            if each not in above:
                yield from _walk(each, f"{prefix}{name}.", (*above, model))


def _models(annotation: Any) -> Iterator[type[Model]]:
    if isinstance(annotation, type) and issubclass(annotation, Model):
        yield annotation
    for inner in get_args(annotation):
        yield from _models(inner)


def _default(field: FieldInfo, holds_keys: bool) -> str:
    value = field.get_default(call_default_factory=True)
    if value is PydanticUndefined:
        return "none; must be given"
    if holds_keys and isinstance(value, Model):
        return "its keys' own"
    plain = list(value) if isinstance(value, tuple) else value
    plain = str(plain) if isinstance(plain, PurePath) else plain
    return yaml.safe_dump(plain, default_flow_style=True, width=10**6).split("\n...")[0].strip()


_NAMES = {bool: "true or false", int: "whole number", float: "number", str: "text"}


def _words(annotation: Any, metadata: list[Any]) -> str:
    """What a value may be, in words: ``whole number, at least 1``."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _words(inner[0], [*inner[1:], *metadata])
    if origin is Literal:
        words = " or ".join(str(each) for each in inner)
    elif origin in (Union, types.UnionType):
        words = " or ".join("null" if a is type(None) else _words(a, []) for a in inner)
    elif origin is tuple:
        words = f"[{', '.join(_words(each, []) for each in inner)}]"
    elif origin is list:
        words = "list of entries" if list(_models(inner[0])) else f"list of {_words(inner[0], [])}"
    else:
        holds = origin is dict or any(_models(annotation))
        words = _NAMES.get(annotation, "keys" if holds else "any value")
    return words + "".join(f", {limit}" for limit in _limits(metadata))


def _limits(metadata: list[Any]) -> Iterator[str]:
    for each in metadata:
        for part in getattr(each, "metadata", [each]):  # a Field inside Annotated holds its own
            for name, word in _LIMITS.items():
                bound = getattr(part, name, None)
                if bound is not None and bound != MOST:  # which nobody comes near
                    yield f"{word} {bound:g}"
            if getattr(part, "min_length", None):
                yield f"at least {part.min_length} of them"
            if getattr(part, "max_length", None):
                yield f"at most {part.max_length} of them"
