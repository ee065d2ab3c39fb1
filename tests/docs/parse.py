"""A command line as the program's own command line reads it, and whether what it names is there.

Nothing is run. Words in capitals stand for what a reader fills in; runs and files may be any.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import typer
from typer.main import get_command

from lndrl.cli import main as command_line
from lndrl.cli.options import check_endpoint, part_settings
from lndrl.config import find_keys, load_config, shipped
from lndrl.errors import UserError
from lndrl.models import load_yaml
from lndrl.planners.factory import RULES
from tests.docs.pages import ROOT

_FILLED_IN = re.compile(r"[A-Z][A-Z_]*")
_SAMPLES = ("1", "tcp/localhost:7447", "newest")
"""What a reader may fill in for a number, an address, a name."""


load_command = cache(command_line.load_command)
keys_of = cache(find_keys)


@cache
def faults(words: tuple[str, ...], mention: bool = False) -> list[str]:
    """What is wrong with ``lndrl`` and ``words``, in sentences; none where it can be run.

    A ``mention`` in a sentence may leave out what the command needs.
    """
    spread = list(command_line._spread_lists(command_line._spread_settings(words)))
    try:
        return list(_named(*_parsed(spread)))
    except typer.TyperException as error:
        told = error.format_message()
        if mention and ("Missing" in told or "requires an argument" in told or not told):
            return []
        return [] if any(not _refused(each) for each in _filled_in(spread)) else [told]
    except UserError as error:
        return [str(error)]


def _refused(words: Sequence[str]) -> bool:
    try:
        _parsed(words)
    except typer.TyperException:
        return True
    return False


def _filled_in(words: Sequence[str]) -> list[list[str]]:
    """``words`` with one of the samples for each in capitals."""
    return [
        [sample if _FILLED_IN.fullmatch(word) else word for word in words] for sample in _SAMPLES
    ]


def _parsed(words: Sequence[str]) -> tuple[str, dict[str, Any]]:
    """The command's words and its parameters; raises TyperException as the program does."""
    if words and words[0].startswith("-"):
        get_command(command_line.app).make_context("lndrl", list(words), resilient_parsing=True)
        return "", {}
    if words[0] not in command_line.SUMMARIES:
        raise typer.BadParameter(f"no command {words[0]}")
    command, rest, name = load_command(words[0]), list(words[1:]), words[0]
    while hasattr(command, "commands"):
        context = command.make_context(name, list(rest))
        given = [*context._protected_args, *context.args]
        if not given:
            return name, context.params
        inner, command, rest = command.resolve_command(context, given)
        name = f"{name} {inner}"
    context = command.make_context(name, rest)
    return name, context.params


def _named(name: str, found: dict[str, Any]) -> Iterator[str]:
    """Faults of what is named: keys, values, configurations, places, planners, methods."""
    for parameter, check in _CHECKS.items():
        value = found.get(parameter)
        for each in value if isinstance(value, list | tuple) else [value]:
            if isinstance(each, str | Path) and (fault := check(str(each))):
                yield f"{parameter} {each}: {fault}"
    if name == "sweep" and not _is_one(found["file"], shipped("sweep")):
        yield f"no sweep {found['file']}"
    if isinstance(settings := found.get("settings"), list | tuple):
        _check_settings(found.get("config"), settings)
    for option in ("planner_set", "shield_set", "guard_set"):
        part_settings(found.get(option), f"--{option.replace('_', '-')}")


def _check_settings(config: str | None, settings: Sequence[str]) -> None:
    """Raises UserError where a key does not exist or a value is not allowed."""
    usable = []
    for setting in settings:
        key, _, value = setting.partition("=")
        keys_of(key)
        # What a user's own file holds is not there to be read.
        if not value.endswith((".yaml", "...")) and ".terms." not in key:
            usable.append(setting)
    if usable:
        known = config is not None and config in shipped("configuration")
        load_config(config if config and known else "lndrl", usable)


def _is_one(name: str, known: object) -> bool:
    """A name that is known, a file or folder, or words for a reader to fill in."""
    return (
        name in known  # type: ignore[operator]
        or "/" in name
        or name.endswith((".yaml", ".yml"))
        or _FILLED_IN.fullmatch(name) is not None
    )


def _configuration(name: str) -> str:
    return "" if _is_one(name, shipped("configuration")) else "no such configuration"


def _places(names: str) -> str:
    known = {*shipped("scenario"), "all"}
    return "" if all(_is_one(n, known) for n in names.split(",")) else "no such place"


@cache
def _methods_of_benches() -> frozenset[str]:
    # As data: the evaluation's models would be seconds of imports.
    return frozenset(m for path in shipped("bench").values() for m in load_yaml(path)["methods"])


def _methods(names: str) -> str:
    known = _methods_of_benches()
    return "" if all(_is_one(n, known) for n in names.split(",")) else "no such method"


def _planner(name: str) -> str:
    known = {*RULES, "shipped", *_methods_of_benches()}
    return "" if ":" in name or _is_one(name, known) else "no such planner"


def _bench(name: str) -> str:
    return "" if _is_one(name, shipped("bench")) else "no such bench"


def _endpoint(name: str) -> str:
    if _FILLED_IN.fullmatch(name):
        return ""
    check_endpoint(name.replace("PORT", "7447"), "endpoint")
    return ""


def _file_of_ours(name: str) -> str:
    ours = name.startswith(("docs/", "deploy/", "configs/"))
    return "no such file" if ours and not (ROOT / name).exists() else ""


_CHECKS: dict[str, Callable[[str], str]] = {
    "config": _configuration,
    "scenario": _places,
    "scenarios": _places,
    "methods": _methods,
    "method": _methods,
    "reference": _methods,
    "planner": _planner,
    "planners": _planner,
    "policy": _planner,
    "spec": _bench,
    "bench": _bench,
    "listen": _endpoint,
    "connect": _endpoint,
    "router": _endpoint,
    "zenoh": _file_of_ours,
    "source": _file_of_ours,
    "subject": _file_of_ours,
}
"""Parameter of a command to what is wrong with its value."""
