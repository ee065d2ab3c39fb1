"""What all configuration models share: frozen, strict about keys, errors as sentences."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, TypeVar

import yaml
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from lndrl.errors import UserError
from lndrl.hints import meant_key

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
MOST = 2**53
"""Whole numbers up to it are understood by every program that reads JSON or msgpack."""
Count = Annotated[int, Field(ge=1, le=MOST)]
Seconds = Annotated[float, Field(ge=0.001, le=86_400)]
"""A duration: from a millisecond, the shortest that networks can be told, to a day."""
TEMPERATURES = (0.01, 100.0)
"""Of sampling, least and most; below, it is greedy for all that float32 can tell."""
Temperature = Annotated[float, Field(ge=TEMPERATURES[0], le=TEMPERATURES[1])]
Probability = Annotated[float, Field(ge=0.0, le=1.0)]

_TURN = 2.0 * math.pi * 1.001  # rad; with room for those who round


def _within_a_turn(angle: float) -> float:
    if abs(angle) > _TURN:
        raise ValueError(
            f"{angle:g} is more than a turn; angles are in radians, and {angle:g} degrees are "
            f"{math.radians(angle):.4g}"
        )
    return angle


def _variance_within_a_turn(variance: float) -> float:
    if variance > _TURN**2:
        root = math.sqrt(variance)
        raise ValueError(
            f"{variance:g} is the square of more than a turn; it is in radians squared, and "
            f"({root:.4g} degrees)^2 are {math.radians(root) ** 2:.4g}"
        )
    return variance


Angle = Annotated[float, Field(ge=0), AfterValidator(_within_a_turn)]
"""rad, 0 to a turn."""
PositiveAngle = Annotated[float, Field(gt=0), AfterValidator(_within_a_turn)]
"""rad, above 0 to a turn."""
AngleVariance = Annotated[float, Field(ge=0), AfterValidator(_variance_within_a_turn)]
"""rad^2, 0 to the square of a turn."""


class Model(BaseModel):
    """A frozen model that refuses unknown keys and non-finite numbers."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", validate_default=True, allow_inf_nan=False
    )


M = TypeVar("M", bound=Model)


class Later:
    """Marks a key that came after hashes were frozen, see ``effective``.

    ``neutral`` is the value at which all is as it was before the key existed, by default the key's
    default; a key whose default is something new names the old behaviour.
    """

    def __init__(self, *neutral: Any) -> None:
        self._neutral = neutral

    def neutral(self, default: Any) -> Any:
        """The value that changes nothing, of a key with ``default``."""
        return self._neutral[0] if self._neutral else default


LATER = Later()
"""``Annotated[T, LATER]``: a later key that does nothing unless it is set."""


def effective(model: Model) -> dict[str, Any]:
    """``model`` as plain JSON data, for hashes that say whether two behave alike.

    A key that is marked as ``Later`` is left out where it has its neutral value: so what was hashed
    before the key existed still has its hash.
    """
    data = model.model_dump(mode="json")
    for name, field in type(model).model_fields.items():
        value = getattr(model, name)
        default = field.get_default(call_default_factory=True)
        marks = [mark for mark in field.metadata if isinstance(mark, Later)]
        if marks and value == marks[0].neutral(default):
            del data[name]
        else:
            data[name] = _effective_value(value, data[name])
    return data


def _effective_value(value: Any, dumped: Any) -> Any:
    if isinstance(value, Model):
        return effective(value)
    if isinstance(value, (list, tuple)):
        return [_effective_value(v, d) for v, d in zip(value, dumped, strict=True)]
    if isinstance(value, dict):
        return {key: _effective_value(value[key], dumped[key]) for key in dumped}
    return dumped


def as_recorded(model: type[Model], data: Any) -> Any:
    """``data`` for ``model``, with the neutral values of later keys if it is a record from before.

    A record names every key that there was, as a run folder's does; who writes by hand leaves out
    what need not be said. So a run from before a key goes on in the world that it was begun in.
    """
    if not isinstance(data, dict):
        return data
    later = {
        name: marks[0].neutral(field.get_default(call_default_factory=True))
        for name, field in model.model_fields.items()
        if (marks := [mark for mark in field.metadata if isinstance(mark, Later)])
    }
    whole = all(name in data for name in model.model_fields if name not in later)
    return {**later, **data} if whole else data


def load_yaml(path: Path) -> dict[str, Any]:
    """Read a YAML file that holds a mapping; raises UserError with file and line otherwise."""
    try:
        text = path.read_text("utf-8")
    except FileNotFoundError:
        raise UserError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: cannot be read ({error})") from None
    try:
        data = yaml.safe_load(text)
    except RecursionError:
        raise UserError(f"{path}: is nested too deeply") from None
    except (yaml.YAMLError, ValueError) as error:  # a date of month 99 is a ValueError
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or f"not valid YAML ({error})"
        raise UserError(f"{path}{where}: {problem}") from None
    if not isinstance(data, dict):
        raise UserError(f"{path}: must hold keys and values, not {type(data).__name__}")
    return data


def validate(model: type[M], data: Any, where: str) -> M:
    """Build ``model`` from plain data; raises UserError naming ``where``, key and mend."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise UserError("; ".join(_sentence(model, e, where) for e in error.errors()[:3])) from None


def _sentence(model: type[Model], error: Any, where: str) -> str:
    key = ".".join(str(part) for part in error["loc"])
    if error["type"] == "extra_forbidden":
        known = _keys_at(model, error["loc"][:-1])
        meant = meant_key(str(error["loc"][-1]), known, _vocabulary())
        hint = f"did you mean {meant}?" if meant else f"known: {', '.join(known)}"
        return f"{where}: unknown key {key}; {hint}"
    if error["type"] == "missing":
        return f"{where}: {key} is missing"
    message = error["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:]
    if error["type"] == "value_error":
        return f"{where}: {key + ': ' if key else ''}{message}"
    return f"{where}: {key} = {error['input']!r}: {message}"


def _vocabulary() -> set[str]:
    """All words of all keys of all models."""
    models: list[type[BaseModel]] = [Model]
    for model in models:
        models += model.__subclasses__()
    return {word for model in models for key in model.model_fields for word in key.split("_")}


def _keys_at(model: type[Model], location: tuple[Any, ...]) -> list[str]:
    current: Any = model
    for part in location:
        if isinstance(part, str) and part in getattr(current, "model_fields", {}):
            annotation = current.model_fields[part].annotation
            inner = [a for a in getattr(annotation, "__args__", ()) if hasattr(a, "model_fields")]
            current = inner[0] if inner else annotation
    return sorted(getattr(current, "model_fields", {}))
