"""Pages of the repository as pages of the site: other places, links that follow, one dialect.

The pages are written for a code host. A site has another builder, which reads indented lists and
blocks otherwise, and it does not hold the whole repository.
"""

from __future__ import annotations

import posixpath
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]
PROJECT = {
    "CONTRIBUTING.md": "project/contributing.md",
    "CHANGELOG.md": "project/changelog.md",
    "SECURITY.md": "project/security.md",
}
"""Pages from the top of the repository, and where they are in the site."""
CITE = "project/cite.md"
_SHELL = re.compile(
    r"(?:# |\$ |[A-Z_]+=\S+ )*(?:\S*/)?"
    r"(lndrl|make|pip|uv|python3?|sbatch|kubectl|docker|podman|curl|scp|ssh|sky|tar|cd|git|ros2)\b"
)
_LINK = re.compile(r"(\[[^\[\]]*\]\()([^)\s]+)(\))")
_ITEM = re.compile(r"([-*] |\d{1,2}\. )")
_FENCE = re.compile(r"\s*(```|~~~)")


def pages() -> dict[str, str]:
    """Page of the repository to page of the site, both relative paths."""
    found = {}
    for path in sorted([*ROOT.glob("docs/**/*.md"), *ROOT.glob("deploy/*.md")]):
        name = path.relative_to(ROOT).as_posix()
        if not name.startswith("docs/site/"):
            found[name] = _as_index(name.removeprefix("docs/"))
    return found | PROJECT


def stage(target: Path) -> None:
    """Write all pages and what they show into ``target``.

    Raises ValueError for links to files that are not there, naming all.
    """
    places, shown, missing = pages(), set(), []
    for name, place in places.items():
        text = (ROOT / name).read_text(encoding="utf-8")
        text, files = _relink(name, place, text, places)
        missing += [f"{name} links to {f}" for f in sorted(files) if not (ROOT / f).exists()]
        shown |= files
        _write(target / place, one_dialect(text))
    if missing:
        raise ValueError(f"{', '.join(missing)}: no such file")
    for file in sorted(shown):
        copy = target / _asset(file)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / file, copy)
    _write(target / CITE, _citation())


def one_dialect(text: str) -> str:
    """Markdown as code hosts read it as Markdown that Python's library reads alike."""
    return "\n".join(map(_cells, _fenced(_indented(text.splitlines())))) + "\n"


def _cells(line: str) -> str:
    """A row of a table: hosts want a bar in code escaped, Python's library wants it as it is."""
    if not line.lstrip().startswith("|"):
        return line
    return re.sub(r"`[^`]+`", lambda code: code[0].replace("\\|", "|"), line)


def _relink(name: str, place: str, text: str, places: dict[str, str]) -> tuple[str, set[str]]:
    """``text`` with the links of the site, and the files that it shows or leads to."""
    files: set[str] = set()

    def follow(match: re.Match[str]) -> str:
        link = match[2]
        if re.match(r"[a-z]+:|#", link):
            return match[0]
        path, _, anchor = link.partition("#")
        meant = posixpath.normpath(posixpath.join(posixpath.dirname(name), path))
        if (ROOT / meant).is_dir():  # which a site has no page for
            return match[1].removeprefix("[").removesuffix("](")
        if meant not in places:
            files.add(meant)
        to = _to(place, places.get(meant) or _asset(meant))
        return f"{match[1]}{to}{'#' + anchor if anchor else ''}{match[3]}"

    lines, fenced = [], False
    for line in text.splitlines():
        fenced ^= _FENCE.match(line) is not None
        lines.append(line if fenced else _LINK.sub(follow, line))
    return "\n".join(lines) + "\n", files


def _asset(name: str) -> str:
    """Where a file that is no page lies in the site."""
    return name.removeprefix("docs/")


def _to(place: str, target: str) -> str:
    return posixpath.relpath(target, posixpath.dirname(place) or ".")


def _as_index(name: str) -> str:
    return re.sub(r"(^|/)README\.md$", r"\1index.md", name)


def _indented(lines: list[str]) -> Iterator[str]:
    """What belongs to a list's item four columns in, however wide its mark is.

    A list begins, and an item of several paragraphs ends, with an empty line.
    """
    width, fenced, loose, last = 0, False, False, ""
    for line in lines:
        if _FENCE.match(line):
            fenced = not fenced
        mark = None if fenced else _ITEM.match(line)
        if mark:
            if last.strip() and (loose or not width):
                yield ""
            width, loose = len(mark[0]), False
        elif line.strip() and not line.startswith(" ") and not fenced:
            width = 0
        loose = loose or (width > 0 and not line.strip())
        last = line
        if not mark and width and line.startswith(" " * width):
            yield " " * 4 + line[width:]
        else:
            yield line


def _fenced(lines: Iterator[str]) -> Iterator[str]:
    """Indented blocks that stand in no list as fenced ones, which can be copied and searched."""
    block: list[str] = []
    listed = fenced = False
    last = ""
    for line in lines:
        if block and (line.startswith("    ") or not line.strip()):
            block.append(line)
            continue
        if block:
            yield from _closed(block)
            block = []
        if _FENCE.match(line):
            fenced = not fenced
        elif not fenced and not listed and line.startswith("    ") and not last.strip():
            block = [line]
            continue
        if line.strip() and not fenced:
            listed = bool(_ITEM.match(line)) or (listed and line.startswith("    "))
        last = line
        yield line
    if block:
        yield from _closed(block)


def _closed(block: list[str]) -> Iterator[str]:
    lines = [line[4:] for line in block]
    while not lines[-1].strip():
        lines.pop()
    yield "```sh" if _SHELL.match(lines[0]) else "```text"
    yield from lines
    yield "```"
    yield ""


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def _citation() -> str:
    """How to cite, from CITATION.cff."""
    data = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    paper = data["references"][0]
    names = " and ".join(
        f"{each['family-names']}, {each['given-names']}" for each in paper["authors"]
    )
    doi = next(each["value"] for each in paper["identifiers"] if each["type"] == "doi")
    return f"""# How to cite

{data["message"]} CITATION.cff at the top of the repository says the same for programs.

```bibtex
@software{{lndrl,
  title   = {{{data["title"]}}},
  author  = {{{{{data["authors"][0]["name"]}}}}},
  version = {{{data["version"]}}},
  license = {{{data["license"]}}}
}}

@article{{chen{paper["year"]}localizability,
  title   = {{{paper["title"]}}},
  author  = {{{names}}},
  journal = {{{paper["journal"]}}},
  year    = {{{paper["year"]}}},
  doi     = {{{doi}}},
  url     = {{{paper["url"]}}}
}}
```

Say which version made your figures (`lndrl version`), under which bench
([the test bench](../bench.md) prints its version and hashes), and with which seed.
"""
