"""A page about what programs of one's own import, from signatures and docstrings."""

from __future__ import annotations

import inspect
import re
from importlib import import_module
from typing import Any

import lndrl
from docs.site.reference.text import said

BESIDE = (
    ("lndrl.extensions", "trust_modules"),
    ("lndrl.navigation.terms", "Steps"),
    ("lndrl.planners.interface", "Planner"),
    ("lndrl.robot.guard", "CommandGuard"),
    ("lndrl.robot.shapes", "load_shape"),
)
"""Beside the front door: what the pages about parts of one's own and the guard import."""


def python_page() -> str:
    """The front door, then what other pages import from rooms."""
    front = [name for name in lndrl.__all__ if not name.startswith("__")]
    parts = [_OPENING, "## lndrl"]
    parts += [_thing(f"lndrl.{name}", getattr(lndrl, name)) for name in front]
    parts.append("## From its rooms")
    for module, name in BESIDE:
        parts.append(_thing(f"{module}.{name}", getattr(import_module(module), name)))
    return "\n\n".join(parts) + "\n"


_LONGEST = 88
_OPENING = """# Python

`import lndrl` is the front door: it costs milliseconds, and each name is imported when it is
first asked for. Everything else is a room of the program ([how the parts
fit](../architecture.md)), and may change from version to version without a word in the changelog.
The task as an environment: [Gymnasium](../gymnasium.md); parts of your own:
[extensions](../extend/index.md)."""


def _thing(name: str, thing: Any) -> str:
    head = f"### {name}\n\n```python\n{_signature(name, thing)}\n```\n\n{said(thing.__doc__)}"
    if not inspect.isclass(thing):
        return head
    members = []
    for each, member in vars(thing).items():
        if each.startswith("_"):
            continue
        function = getattr(member, "__func__", member)
        if isinstance(member, property):
            members.append(f"`{each}`\n\n{_quoted(member.__doc__)}")
        elif inspect.isfunction(function) and function.__doc__:
            signature = _signature(each, function)
            members.append(f"```python\n{signature}\n```\n\n{_quoted(function.__doc__)}")
    return "\n\n".join([head, *members])


def _quoted(docstring: str | None) -> str:
    return "\n".join(f"> {line}".rstrip() for line in said(docstring).splitlines())


def _signature(name: str, thing: Any) -> str:
    try:
        found = inspect.signature(thing)
    except (TypeError, ValueError):
        return name
    without = [each for each in found.parameters.values() if each.name not in ("self", "cls")]
    if len(without) > 12:  # a model's keys, which stand on the page about configuration
        return f"{name}(**keys)"
    parameters = [_unquoted(str(each)) for each in without]
    by_name = [each.kind is each.KEYWORD_ONLY for each in without]
    if True in by_name:
        parameters.insert(by_name.index(True), "*")
    returned = inspect.formatannotation(found.return_annotation)
    end = "" if found.return_annotation in (found.empty, "None") else f" -> {_unquoted(returned)}"
    line = f"{name}({', '.join(parameters)}){end}"
    if len(line) <= _LONGEST or not parameters:
        return line
    return "\n".join([f"{name}(", *(f"    {each}," for each in parameters), f"){end}"])


def _unquoted(annotation: str) -> str:
    """Annotations are text where they are not evaluated."""
    return re.sub(r"'([^']*)'", r"\1", annotation)
