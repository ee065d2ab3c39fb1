"""What stands in an HTML page, by Python's own parser, and what is wrong with it."""

from __future__ import annotations

import re
from collections import Counter
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

VOID = {"meta", "link", "img", "br", "hr", "input"}
FETCHED = ("src", "href", "srcset", "poster", "data", "action", "xlink:href")


class HTMLPage(HTMLParser):
    """The page in ``path``: its elements, ids, headings and words."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.unmatched: list[str] = []
        self.headings: list[tuple[int, str]] = []
        self.words: list[str] = []
        self.text = path.read_text(encoding="utf-8")
        self.feed(self.text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if re.fullmatch("h[1-6]", tag):
            self.headings.append((int(tag[1]), ""))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.unmatched.append(tag)

    def handle_data(self, data: str) -> None:
        if "style" in self.open:
            return
        self.words.append(data)
        if self.open and re.fullmatch("h[1-6]", self.open[-1]):
            level, said = self.headings[-1]
            self.headings[-1] = level, said + data

    @property
    def said(self) -> str:
        """All words, spaces as one."""
        return " ".join(" ".join(self.words).split())

    def of(self, *tags: str) -> list[dict[str, str | None]]:
        """Attributes of every element of ``tags``."""
        return [attributes for tag, attributes in self.elements if tag in tags]

    @property
    def titles(self) -> list[str]:
        """Headings of the chapters."""
        return [said.strip() for level, said in self.headings if level == 2]

    def faults(self) -> list[str]:
        """Sentences: what asks the network, is unnamed, or out of order."""
        found = [f"<{tag}> is not closed in order" for tag in [*self.unmatched, *self.open]]
        ids = Counter(a["id"] for _, a in self.elements if a.get("id"))
        found += [f"id {name} {n} times" for name, n in ids.items() if n > 1]
        for tag, attributes in self.elements:
            for name in FETCHED:
                value = attributes.get(name) or ""
                if value.startswith("#"):
                    found += [] if value[1:] in ids else [f"{value} leads nowhere"]
                elif value and not value.startswith("data:"):
                    found.append(f"<{tag}> asks for {value}")
            for name in ("aria-labelledby", "aria-describedby"):
                label = attributes.get(name)
                found += [f"{name} {label} names nothing"] if label and label not in ids else []
        found += [f"url({u}" for u in re.findall(r"url\((?!#|data:)([^)]*)", self.text)]
        found += ["@import"] if "@import" in self.text else []
        found += ["a script"] if self.of("script") else []
        found += [
            f"no alt: {a.get('title')}" for a in self.of("img") if len(a.get("alt") or "") < 20
        ]
        named = [a for _, a in self.elements if a.get("role") == "img"]
        found += ["an svg without words"] if len(named) != len(self.of("svg")) else []
        found += ["no words" for a in named if len(a.get("aria-label") or "") < 20]
        found += ["a th without scope" for a in self.of("th") if "scope" not in a]
        levels = [level for level, _ in self.headings]
        found += ["h1 is not once and first"] if levels[0] != 1 or levels.count(1) != 1 else []
        pairs = pairwise(levels)
        found += [f"h{b} after h{a}" for a, b in pairs if b > a + 1]
        return found
