"""Parts of a user's own: found by name, imported only from where this process trusts.

A configuration, a command line or a run folder may name a part as ``module:Class``, or by the name
under which an installed package offers it as an entry point. Naming costs nothing; importing runs
code. So whoever imports decides: an entry point is trusted because somebody installed it, a module
because this process was told to (``--trust-modules``, ``trust_modules``).
"""

from __future__ import annotations

import difflib
import hashlib
import inspect
import os
import re
import sys
import traceback
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from pydantic import AfterValidator, JsonValue

from lndrl.errors import UserError
from lndrl.numbering import by_number

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

_OWN = re.compile(r"(?P<module>[^\W\d]\w*(\.[^\W\d]\w*)*):(?P<attribute>[^\W\d]\w*)")
_ENTRY_POINT = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
_MODULE = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*")
_trusted: dict[str, None] = {}
PARTS_FOLDER = "LNDRL_PARTS_FOLDER"
"""Environment variable that tells a process which another folder than its own is meant."""


@dataclass(frozen=True)
class Hook:
    """A place where a part of one's own fits: its name in sentences, and its contract.

    ``group`` is that of entry points. The class is called with ``arguments`` and then its settings
    by keyword; ``methods`` are called with so many arguments each.
    """

    what: str
    group: str
    arguments: tuple[str, ...] = ()
    methods: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: MappingProxyType({}))


PLANNER = Hook(
    "planner",
    "lndrl.planners",
    ("config",),
    {"reset": ("seed", "worlds"), "act": ("observation", "rows")},
)
REWARD_TERM = Hook("reward term", "lndrl.rewards", ("config",), {"__call__": ("steps",)})
NETWORK = Hook("policy network", "lndrl.networks", ("config", "outputs"), {"forward": ("inputs",)})
ENCODER = Hook("encoder", "lndrl.encoders", ("config",), {"forward": ("values",)})
GENERATOR = Hook(
    "scenario generator", "lndrl.scenarios", ("scenario",), {"__call__": ("layout", "random")}
)
METRIC = Hook("metric", "lndrl.metrics", (), {"__call__": ("records",)})
HOOKS = (PLANNER, REWARD_TERM, NETWORK, ENCODER, GENERATOR, METRIC)


def _part_name(name: str) -> str:
    if not (is_own(name) or _ENTRY_POINT.fullmatch(name)):
        raise ValueError(
            f"{name!r} names no part; write module:Class, or the name that a package installs"
        )
    return name


PartName: TypeAlias = Annotated[str, AfterValidator(_part_name)]
"""A built-in part, an entry point, or ``module:Class``; whether it is there shows when it is used.
"""
PartSettings: TypeAlias = dict[str, JsonValue]
"""Keyword arguments of a part's class."""


def is_own(name: str) -> bool:
    """Whether ``name`` reads like ``module:Class``."""
    return _OWN.fullmatch(name) is not None


def trust_modules(*prefixes: str) -> None:
    """Let this process import parts from modules ``prefix`` and ``prefix.*``.

    Raises UserError for what cannot be a module's name.
    """
    for prefix in prefixes:
        if not _MODULE.fullmatch(prefix):
            raise UserError(
                f"{prefix!r} is no module to trust; write a package or module, e.g. my_package"
            )
        _trusted[prefix] = None


def trusted_modules() -> tuple[str, ...]:
    """What ``trust_modules`` has been told, for processes that are started from here."""
    return tuple(_trusted)


def parts_folder() -> str:
    """The folder in which trusted modules are looked for last: where the user's command began."""
    return os.environ.get(PARTS_FOLDER) or os.getcwd()


def installed(hook: Hook) -> tuple[str, ...]:
    """Names of the entry points that packages offer for ``hook``."""
    return tuple(sorted({point.name for point in _entry_points(hook.group)}, key=by_number))


def find(hook: Hook, name: str, builtin: Collection[str] = (), where: str = "") -> type | None:
    """The class that ``name`` stands for; None where it is one of the ``builtin`` parts.

    ``where`` (a key, an option) begins the sentences. A built-in part wins over an entry point of
    the same name. Raises UserError for an unknown name, a module that is not trusted or cannot be
    imported, and a class that does not meet the hook's contract.
    """
    said = f"{where}: {hook.what} {name}" if where else f"{hook.what} {name}"
    offered = [point for point in _entry_points(hook.group) if point.name == name]
    if name in builtin:
        if offered:
            _say_once(f"note: {said} is the built-in one; {_owners(offered)} installs another")
        return None
    if is_own(name):
        found = _from_module(hook, name, said)
    elif not offered:
        raise UserError(_unknown(hook, name, builtin, said))
    elif len({point.value for point in offered}) > 1:
        raise UserError(
            f"{said}: {_owners(offered)} install entry points of that name; write module:Class"
        )
    else:
        found = _imported(offered[0].module, offered[0].attr, said)
    _check(hook, found, said)
    return found


def make(hook: Hook, found: type, name: str, *arguments: Any, **settings: Any) -> Any:
    """An object of the class ``found``; raises UserError where its settings or itself fail."""
    try:
        inspect.signature(found).bind(*arguments, **settings)
    except TypeError as error:
        raise UserError(f"{hook.what} {name}: settings {settings} do not fit ({error})") from None
    with calling(hook, name):
        return found(*arguments, **settings)


@contextmanager
def calling(hook: Hook, name: str) -> Iterator[None]:
    """Turn what a part raises into one sentence that names the part and the line.

    A UserError passes as it is.
    """
    try:
        yield
    except UserError:
        raise
    except (Exception, SystemExit) as error:  # sys.exit(0) would end a training as if it were done
        raise UserError(f"{hook.what} {name} failed: {_words(error)}") from error


def fingerprint(found: type) -> str:
    """Twelve hex digits of the file that defines ``found``: another text, another part."""
    file = inspect.getsourcefile(found)
    data = Path(file).read_bytes() if file and Path(file).is_file() else b""
    return hashlib.sha256(data).hexdigest()[:12]


def _from_module(hook: Hook, name: str, said: str) -> Any:
    module, _, attribute = name.partition(":")
    is_installed = any(point.value == name for point in _entry_points(hook.group))
    if not is_installed and not any(
        module == prefix or module.startswith(f"{prefix}.") for prefix in _trusted
    ):
        raise UserError(
            f"{said} is refused: importing it runs code of module {module}, which this process "
            f"does not trust; where you do, add --trust-modules {module.partition('.')[0]}"
        )
    return _imported(module, attribute, said)


def _imported(module: str, attribute: str, said: str) -> Any:
    try:
        loaded = import_module(module)
    except ModuleNotFoundError as error:
        if error.name and (module == error.name or module.startswith(f"{error.name}.")):
            raise UserError(
                f"{said}: there is no module {error.name}; install its package or name its folder "
                "in PYTHONPATH"
            ) from None
        raise UserError(f"{said}: {module} cannot be imported: {_words(error)}") from error
    except (Exception, SystemExit) as error:
        raise UserError(f"{said}: {module} cannot be imported: {_words(error)}") from error
    try:
        return getattr(loaded, attribute)
    except AttributeError:
        known = [each for each in vars(loaded) if inspect.isclass(getattr(loaded, each))]
        close = difflib.get_close_matches(attribute, known, n=1)
        hint = f"; did you mean {close[0]}?" if close else ""
        raise UserError(f"{said}: {module} has no class {attribute}{hint}") from None


def _check(hook: Hook, found: Any, said: str) -> None:
    """Raise UserError where the class cannot be called as ``hook`` says."""
    if not inspect.isclass(found):
        raise UserError(f"{said}: is {type(found).__name__}, not a class")
    try:
        positional = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
        parameters = inspect.signature(found).parameters.values()
        places = [p for p in parameters if p.kind in positional]
        starred = any(p.kind is inspect.Parameter.VAR_POSITIONAL for p in parameters)
        if len(places) < len(hook.arguments) and not starred:
            raise TypeError
    except (TypeError, ValueError):
        raise UserError(
            f"{said}: must be made with ({', '.join((*hook.arguments, '**settings'))})"
        ) from None
    for method, arguments in hook.methods.items():
        shown = f"{method}({', '.join(arguments)})"
        # A class is callable itself; what counts is whether its objects are.
        if not any(method in vars(base) for base in found.__mro__):
            raise UserError(f"{said}: has no method {shown}")
        try:
            inspect.signature(getattr(found, method)).bind(None, *arguments)
        except TypeError:
            raise UserError(f"{said}: its {method} must take ({', '.join(arguments)})") from None


def _unknown(hook: Hook, name: str, builtin: Collection[str], said: str) -> str:
    known = [*builtin, *installed(hook)]
    close = difflib.get_close_matches(name, known, n=1)
    hint = f"did you mean {close[0]}? known" if close else "known"
    return (
        f"{said} is unknown; {hint}: {', '.join(known) or 'none'}; "
        "a class of your own is written module:Class"
    )


@cache
def _entry_points(group: str) -> tuple[EntryPoint, ...]:
    from importlib.metadata import entry_points

    return tuple(entry_points(group=group))


def _owners(points: Collection[EntryPoint]) -> str:
    return " and ".join(sorted({p.dist.name if p.dist else "a package" for p in points}))


@cache
def _say_once(sentence: str) -> None:
    print(sentence, file=sys.stderr)


def _words(error: BaseException) -> str:
    """Kind, message and place of an error, on one line."""
    message = " ".join(str(error).split())
    frames = traceback.extract_tb(error.__traceback__)
    if isinstance(error, SyntaxError) and error.filename:
        place = f" ({Path(error.filename).name}, line {error.lineno})"
        message = error.msg
    else:
        place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}{': ' + message if message else ''}{place}"
