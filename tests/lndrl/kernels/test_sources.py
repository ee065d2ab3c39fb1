"""What kernels are made of: the files that their own imports, however far."""

from __future__ import annotations

from pathlib import Path

import pytest

from lndrl.kernels import sources


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Path]:
    """A package of five files, a to e, by name."""
    texts = {
        "a": "from lndrl.b import (\n    one,\n    two,\n)\n",
        "b": "import math\n\nfrom lndrl.room import c  # a module\n",
        "room/__init__": "",
        "room/c": "import lndrl.b\n",
        "d": "def late():\n    from lndrl.b import one\n\nif True:\n    from lndrl.e import x\n",
        "e": "x = 1\n",
    }
    package = tmp_path / "lndrl"
    for name, text in texts.items():
        path = package / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.setattr(sources, "ROOT", tmp_path)
    return {name: package / f"{name}.py" for name in texts}


def digests(files: dict[str, Path]) -> dict[str, str]:
    for cached in (sources.digest, sources._imported, sources._content):
        cached.cache_clear()
    return {name: sources.digest(path) for name, path in files.items()}


@pytest.mark.parametrize(
    ("edited", "others"),
    [
        ("a", {"a"}),
        ("b", {"a", "b", "room/c"}),
        ("room/c", {"a", "b", "room/c"}),
        ("room/__init__", {"a", "b", "room/c", "room/__init__"}),
        ("e", {"e"}),
    ],
)
def test_an_edit_changes_what_is_made_of_it(
    files: dict[str, Path], edited: str, others: set[str]
) -> None:
    before = digests(files)
    files[edited].write_text(files[edited].read_text() + "# more\n")
    after = digests(files)
    assert {name for name in files if before[name] != after[name]} == others
    digests({})


def test_the_place_on_the_machine_does_not_matter(
    files: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = digests(files)
    (tmp_path / "lndrl").rename(tmp_path / "later")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "later").rename(tmp_path / "elsewhere/lndrl")
    monkeypatch.setattr(sources, "ROOT", tmp_path / "elsewhere")
    moved = {name: tmp_path / "elsewhere/lndrl" / f"{name}.py" for name in files}
    assert digests(moved) == before
    digests({})


def test_names_are_those_of_modules() -> None:
    assert sources.name_of(sources.ROOT / "lndrl/world/laser.py") == "lndrl.world.laser"
    assert sources.name_of(Path("/elsewhere/own.py")) == "own"
