"""Pages: words stay words, files are whole or not there, charts are in the page's colours."""

from __future__ import annotations

from pathlib import Path

import pytest
from matplotlib.figure import Figure

from lndrl.errors import UserError
from lndrl.view.palette import INK, PAPER
from lndrl.view.pictures.rates import Share, rates_figure
from lndrl.view.report.embedded import chart
from lndrl.view.report.page import check_page, render, write_page
from lndrl.view.report.parts import (
    Command,
    Facts,
    Folded,
    Gallery,
    Listing,
    Page,
    Part,
    Section,
    Table,
    Text,
    Tile,
    Tiles,
)
from tests.lndrl.cli.reporting.html_page import HTMLPage

EVIL = "<script>alert('1')</script>\" & \x27"
SHARES = [
    Share("ours", 0.9, (0.85, 0.95), 0.8),
    Share("a method with quite a long name of its own", 0.1, (0.0, 0.2)),
]


def page_of(words: str) -> Page:
    table = Table(words, (words, "n"), [(words, "1"), (words, words)], tones={words: "good"})
    figures = [
        chart(f"chart{i}", rates_figure("arrived", SHARES), f"{words}, a chart of two", words)
        for i in range(2)
    ]
    parts: list[Part] = [
        Text(words),
        Command(words, words),
        Facts([(words, words)]),
        Tiles([Tile(words, words, words, "bad")]),
        table,
        Gallery(figures),
        Listing(words),
    ]
    section = Section("all", words, [*parts, Folded(words, [Text(words), table])])
    return Page(words, words, [section], words, words, "lost")


def test_words_stay_words_whoever_wrote_them(tmp_path: Path) -> None:
    write_page(page_of(EVIL), tmp_path / "page.html")
    page = HTMLPage(tmp_path / "page.html")
    assert page.faults() == []
    assert page.said.count(EVIL) > 20
    assert page.of("table")[0]["aria-labelledby"] != page.of("table")[1]["aria-labelledby"]


def test_the_same_page_is_the_same_bytes() -> None:
    assert render(page_of("x")) == render(page_of("x"))


def test_a_chart_has_the_pages_ink_and_anchors_of_its_own() -> None:
    figures = [chart(name, rates_figure("lost", SHARES), "alt", "") for name in ("a", "b")]
    for picture in figures:
        assert "var(--ink)" in picture.svg and "var(--pink)" in picture.svg
        assert INK.lower() not in picture.svg.lower() and PAPER.lower() not in picture.svg.lower()
        assert "http" not in picture.svg and "<svg viewBox=" in picture.svg
    assert figures[0].svg != figures[1].svg
    assert figures[0].svg.replace("a-", "b-") == figures[1].svg.replace("a-", "b-")


def test_a_half_page_never_stands_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "page.html"
    write_page(page_of("before"), out)
    before = out.read_bytes()

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_page(page_of("after"), out)
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]
    assert out.read_bytes() == before


def test_a_disk_that_refuses_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(UserError, match=r"page.html: cannot be written \(No space left"):
        write_page(page_of("x"), tmp_path / "page.html")
    assert list(tmp_path.iterdir()) == []


def test_where_no_page_can_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "folder.html").mkdir()
    for name, sentence in (
        ("page.png", "must end in .html"),
        ("none/page.html", "does not exist"),
        ("folder.html", "is a folder; name a file"),
    ):
        with pytest.raises(UserError, match=sentence):
            check_page(tmp_path / name)
    # Root may write everywhere, so the system's answer is made up.
    monkeypatch.setattr("os.access", lambda *_: False)
    with pytest.raises(UserError, match="cannot be written; name another file"):
        check_page(tmp_path / "page.html")


def test_a_figure_of_another_make_fits_too() -> None:
    figure = Figure(figsize=(2.0, 1.0))
    figure.add_subplot().plot([0, 1])
    picture = chart("x", figure, "alt", "")
    assert (picture.width, picture.height) == (192, 96)
