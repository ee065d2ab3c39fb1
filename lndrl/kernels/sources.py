"""What a kernel is made of: its file, and the files of the package that this one imports.

A compiled kernel holds the code of those that it calls and the values of the globals that it
names, wherever these come from. So what is kept of it is good for exactly these files.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = Path(__file__).resolve().parents[1].name

# All that kernels get from this room: how they are kept does not change what they are.
_DECORATOR = Path(__file__).with_name("decorator.py")
_HERE = f"{PACKAGE}.kernels"

# Imports at the left margin: what stands in a function or under TYPE_CHECKING is no global.
_IMPORTS = re.compile(
    rf"^(?:from ({PACKAGE}[\w.]*) import (?:\(([^)]*)\)|([^\n#]*))|import ({PACKAGE}[\w.]+))",
    re.MULTILINE,
)


def name_of(file: Path) -> str:
    """The module's name, for people."""
    parts = file.with_suffix("").relative_to(ROOT).parts if file.is_relative_to(ROOT) else ()
    return ".".join(parts) or file.stem


@cache
def digest(file: Path) -> str:
    """Hash, 16 hex digits, of ``file`` and of all in the package that it imports, however far."""
    found = {_DECORATOR}
    waiting = [file]
    while waiting:
        path = waiting.pop()
        if path not in found:
            found.add(path)
            waiting += _imported(path)
    total = hashlib.sha256()
    for path in sorted(found):
        # By its place in the package, not on this machine: every clone shares what is kept.
        place = path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else path.name
        total.update(f"{place} {_content(path)[0]}\n".encode())
    return total.hexdigest()[:16]


@cache
def _imported(path: Path) -> tuple[Path, ...]:
    return tuple(_imports(path))


def _imports(path: Path) -> Iterator[Path]:
    for module, several, one, whole in _IMPORTS.findall(_content(path)[1]):
        if (module or whole).startswith(_HERE):
            continue
        base = ROOT.joinpath(*(module or whole).split("."))
        if base.with_suffix(".py").is_file():
            yield base.with_suffix(".py")
            continue
        yield from _existing(base / "__init__.py")
        for name in re.findall(r"\w+", several or one):
            yield from _existing(base / f"{name}.py")


def _existing(path: Path) -> Iterator[Path]:
    if path.is_file():
        yield path


@cache
def _content(path: Path) -> tuple[str, str]:
    """Hash and text, as they were when they were first asked for: a process runs what it read."""
    data = path.read_bytes()
    return hashlib.sha256(data).hexdigest(), data.decode("utf-8", "replace")
