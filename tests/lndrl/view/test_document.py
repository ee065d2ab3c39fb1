"""Tables in Markdown: cells are shown as they are."""

from __future__ import annotations

from lndrl.view.document import markdown_table


def test_a_cell_is_shown_not_read() -> None:
    table = markdown_table(("p", "machine"), [("<0.001", "A|B <b>*x*</b>"), ("a < b", "<!-- end")])
    lines = table.splitlines()
    assert lines[2] == r"| <0.001 | A\|B &lt;b>\*x\*&lt;/b> |"
    assert lines[3] == "| a < b | &lt;!-- end |"
