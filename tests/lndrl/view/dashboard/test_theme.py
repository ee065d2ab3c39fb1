from __future__ import annotations

import pytest

from lndrl.view import palette
from lndrl.view.dashboard.theme import ON_LIGHT, chosen, recoloured
from lndrl.view.text import styled


def luminance(colour: str) -> float:
    """Relative luminance as WCAG 2 defines it."""
    parts = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_colours_are_legible_on_paper() -> None:
    used = {*palette.SERIES, *palette.OUTCOME.values()}
    assert used <= set(ON_LIGHT)
    for colour in ON_LIGHT.values():
        assert 1.05 / (luminance(colour) + 0.05) >= 4.5, colour
    assert len(set(ON_LIGHT.values())) == len(ON_LIGHT)


def test_only_colours_change() -> None:
    line = styled("a", f"bold {palette.GREEN}").append("b", style="dim")
    (light,) = recoloured([line.copy()], "light")
    assert light.plain == "ab"
    assert [str(span.style) for span in light.spans] == ["bold #00704F", "dim"]
    assert recoloured([line], "dark")[0].spans == line.spans


@pytest.mark.parametrize(
    ("environment", "answer", "expected"),
    [
        ({"COLORFGBG": "0;15"}, "", "light"),
        ({"COLORFGBG": "15;default;0"}, "", "dark"),
        ({}, "\x1b]11;rgb:fdfd/f6f6/e3e3\x1b\\\x1b[?1c", "light"),
        ({}, "\x1b]11;rgb:1e/1e/2e\x07", "dark"),
        ({}, "\x1b[?1;2c", "dark"),
        ({"COLORFGBG": "nonsense"}, "", "dark"),
    ],
)
def test_auto_finds_out(environment: dict[str, str], answer: str, expected: str) -> None:
    assert chosen("auto", lambda _: answer, environment) == expected
    assert chosen("light", lambda _: answer, environment) == "light"
