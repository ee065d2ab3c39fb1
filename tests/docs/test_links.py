"""Links of the pages: each leads to a file and a heading, on a code host and in the site."""

from __future__ import annotations

import posixpath
import re
import tomllib
import unicodedata
from pathlib import Path

import pytest

from docs.site.__main__ import CONFIG
from docs.site.reference import reference_pages
from docs.site.stage import CITE, one_dialect, pages, stage

LINK = re.compile(r"(?<!\\)\]\(([^)\s]+)\)")


@pytest.fixture(scope="module")
def staged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All pages of the site, the reference among them, as its builder reads them."""
    folder = tmp_path_factory.mktemp("pages")
    stage(folder)
    (folder / "reference").mkdir()
    for name, text in reference_pages().items():
        (folder / "reference" / name).write_text(text)
    return folder


def prose(text: str) -> str:
    """A page without its blocks and its code."""
    text = re.sub(r"^( *)```.*?^\1```", "", text, flags=re.DOTALL | re.MULTILINE)
    return re.sub(r"`[^`\n]+`", "", text)


def headings(text: str) -> list[str]:
    without = re.sub(r"^( *)```.*?^\1```", "", text, flags=re.DOTALL | re.MULTILINE)
    return re.findall(r"^#{1,6} (.+?)\s*$", without, re.MULTILINE)


def of_the_site(heading: str) -> str:
    """The anchor that Python's Markdown makes."""
    plain = unicodedata.normalize("NFKD", heading).encode("ascii", "ignore").decode()
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", plain).strip().lower())


def of_a_host(heading: str) -> str:
    """The anchor that code hosts make."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


def test_every_link_leads_to_a_file_and_a_heading(staged: Path) -> None:
    wrong = []
    for page in sorted(staged.rglob("*.md")):
        name = page.relative_to(staged).as_posix()
        for link in LINK.findall(prose(page.read_text())):
            path, _, anchor = link.partition("#")
            if re.match(r"[a-z]+:", link):
                continue
            meant = posixpath.normpath(posixpath.join(posixpath.dirname(name), path or page.name))
            if not (staged / meant).is_file():
                wrong.append(f"{name}: {link}: no such file")
            elif anchor:
                found = headings((staged / meant).read_text())
                wrong += [
                    f"{name}: {link}: no such heading ({made.__name__})"
                    for made in (of_the_site, of_a_host)
                    if anchor not in map(made, found)
                ]
    assert wrong == []


def test_every_page_has_a_place_and_every_place_a_page(staged: Path) -> None:
    def files(entries: list[dict[str, object]]) -> list[str]:
        found = []
        for entry in entries:
            for value in entry.values():
                found += files(value) if isinstance(value, list) else [str(value)]
        return found

    placed = files(tomllib.loads(CONFIG.read_text())["project"]["nav"])
    there = {path.relative_to(staged).as_posix() for path in staged.rglob("*.md")}
    assert len(placed) == len(set(placed))
    assert set(placed) == there, "give it a place in docs/site/zensical.toml"
    assert {*pages().values(), CITE} <= there


def test_a_link_to_nothing_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs/a.md").write_text("[b](b.md)\n")
    monkeypatch.setattr("docs.site.stage.ROOT", tmp_path)
    monkeypatch.setattr("docs.site.stage.PROJECT", {})
    with pytest.raises(ValueError, match=r"docs/a.md links to docs/b.md: no such file"):
        stage(tmp_path / "site")


def test_a_folder_is_no_page(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "docs/results").mkdir(parents=True)
    (tmp_path / "docs/a.md").write_text("see [all of it](results), ![a](a.png)\n")
    (tmp_path / "docs/a.png").write_bytes(b"")
    monkeypatch.setattr("docs.site.stage.ROOT", tmp_path)
    monkeypatch.setattr("docs.site.stage.PROJECT", {})
    monkeypatch.setattr("docs.site.stage._citation", str)
    stage(tmp_path / "site")
    assert (tmp_path / "site/a.md").read_text() == "see all of it, ![a](a.png)\n"
    assert (tmp_path / "site/a.png").exists()


def test_lists_and_blocks_become_the_builders_dialect() -> None:
    text = (
        "1. one\n   more\n\n   | a |\n   |---|\n\n2. two\n\nThen\n\n"
        "    lndrl runs\n\n    lndrl demo\n\nor\n\n    up = 1\n\n| `a\\|b` \\| c |\n"
    )
    assert one_dialect(text) == (
        "1. one\n    more\n\n    | a |\n    |---|\n\n2. two\n\nThen\n\n"
        "```sh\nlndrl runs\n\nlndrl demo\n```\n\nor\n\n```text\nup = 1\n```\n\n| `a|b` \\| c |\n"
    )


def test_the_reference_says_what_the_code_says() -> None:
    found = reference_pages()
    assert "`ppo.epochs`" in found["configuration.md"]
    assert "| 130 | interrupted by Ctrl-C (SIGINT) |" in found["commands.md"]
    assert (
        "## runs" in found["commands-training.md"]
        and "### runs rm" in found["commands-training.md"]
    )
    assert "`lndrl_actors_wanted_ratio`" in found["metrics.md"]
    assert "## chunk" in found["messages.md"] and "`sequence`" in found["messages.md"]
    assert "### lndrl.load_policy" in found["python.md"]
