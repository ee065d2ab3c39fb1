from __future__ import annotations

from rich.cells import cell_len

from lndrl.view.chart import Interval, area, area_chart, bars, interval_chart


def test_area_rises_with_its_values() -> None:
    rows = area([0.0, 0.5, None, 1.0], 4, 2)
    assert rows[1][0] == "▁" and rows[1][2] == " " and rows[0][3] == rows[1][3] == "█"
    assert rows[0][0] == " "
    assert area([], 5, 3) == ["", "", ""]
    assert area([0.5], 1, 1, low=0.0, high=1.0) == ["▅"]


def test_charts_have_their_width() -> None:
    for width in (9, 20, 77):
        lines = area_chart([1.0, 2.0, 3.0] * 50, width, 4, "red", str)
        points = [Interval(float(i), 0.1 * i, 0.1 * i - 0.05, 0.1 * i + 0.05) for i in range(9)]
        lines += interval_chart(points, width, 6, "red", str)
        lines += bars([("0", 0.25), ("1", 0.75)], width, "red")
        assert {cell_len(line.plain) for line in lines} == {width}


def test_an_interval_reaches_as_far_as_it_does() -> None:
    points = [Interval(0.0, 0.5, 0.0, 1.0), Interval(1.0, 0.5, 0.4, 0.6)]
    lines = interval_chart(points, 8 + 11, 11, "red", lambda v: f"{v:.1f}")
    columns = ["".join(line.plain[8 + x] for line in lines) for x in (0, 10)]
    assert columns[0] == "│││││●│││││"
    assert columns[1] == "    │●│    "
    assert lines[0].plain.split()[0] == "1.0" and lines[-1].plain.split()[0] == "0.0"


def test_the_longest_bar_fills_its_row() -> None:
    few, many = bars([("0", 0.2), ("1", 0.8)], 30, "red")
    assert many.plain.count("█") == 30 - 2 - 9
    assert few.plain.count("█") == many.plain.count("█") // 4
    assert many.plain.endswith("80.0 %")
