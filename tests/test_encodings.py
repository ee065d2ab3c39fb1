"""Files are read and written as UTF-8 whatever the locale: no call leaves the choice to it."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
FILES = sorted(
    path for top in ("lndrl", "actors", "learner") for path in (ROOT / top).rglob("*.py")
)
# Of each call that makes text of bytes or bytes of text: at which place its encoding may stand.
PLACES = {"read_text": 0, "write_text": 1, "fdopen": 3, "open": 3, "FileHandler": 2}
BINARY_OPENERS = {"os", "Image", "zenoh", "wave", "webbrowser", "RunFolder"}
RUNNERS = {"run", "Popen", "check_output", "check_call", "getoutput"}


def leaves_encoding_open(call: ast.Call) -> bool:
    """Whether the text that ``call`` handles would be of the locale's encoding."""
    function = call.func
    name = getattr(function, "attr", None) or getattr(function, "id", "")
    owner = getattr(getattr(function, "value", None), "id", "")
    given = {keyword.arg: keyword.value for keyword in call.keywords}
    if "encoding" in given:
        return False
    if name in RUNNERS:
        text = any(given.get(key) is not None for key in ("text", "universal_newlines"))
        return text or name == "getoutput"
    if name not in PLACES or owner in BINARY_OPENERS:
        return False
    place = PLACES[name]
    if name in ("open", "fdopen"):
        if isinstance(function, ast.Attribute) and name == "open":
            place -= 1  # Path.open(mode, buffering, encoding)
        modes = [*call.args, *filter(None, [given.get("mode")])]
        constants = [node for mode in modes for node in ast.walk(mode)]
        if any(isinstance(node, ast.Constant) and "b" in str(node.value) for node in constants):
            return False
        if isinstance(function, ast.Attribute) and not call.args and not given:
            return owner == "path"  # a viewer, a lock, a folder: something of ours
    return len(call.args) <= place


def faults(source: str) -> list[str]:
    return [
        f"line {node.lineno}: {ast.unparse(node)[:80]}"
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Call) and leaves_encoding_open(node)
    ]


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_file_depends_on_the_locale(path: Path) -> None:
    assert faults(path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    "source",
    [
        "path.read_text()",
        "path.write_text(x)",
        "(a / b).write_text(x)",
        "open(path)",
        "open(path, 'w')",
        "path.open('w')",
        "path.open()",
        "path.open('a', newline='')",
        "subprocess.run(x, text=True)",
        "logging.FileHandler(path)",
    ],
)
def test_what_depends_on_it_is_seen(source: str) -> None:
    assert len(faults(source)) == 1


@pytest.mark.parametrize(
    "source",
    [
        "path.read_text('utf-8')",
        "path.write_text(x, encoding='utf-8')",
        "open(path, 'rb')",
        "path.open('ab')",
        "os.open(path, os.O_RDONLY)",
        "Image.open(path)",
        "subprocess.run(x)",
        "subprocess.run(x, text=True, encoding='utf-8')",
        "path.open('ab' if more else 'wb')",
        "self.open()",
    ],
)
def test_what_does_not_passes(source: str) -> None:
    assert faults(source) == []
