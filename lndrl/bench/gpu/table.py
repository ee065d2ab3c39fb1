"""The figures of ``lndrl bench gpu`` as a table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.table import Table

from lndrl.bench.gpu.parts import SKIPPED
from lndrl.bench.report import flatten, value_text

_HIDDEN = ("trace", "which_failed", "curve")
"""Too long for a table; the file has them."""


def table(content: Mapping[str, Any]) -> Table:
    """``script.content`` as rows: each part with what became of it, then its figures."""
    kind = "rehearsal on the CPU, of no meaning" if content["rehearsal"] else "GPU"
    took, allowed = content["seconds"], content["seconds_allowed"]
    made = Table(title=f"{kind}: {took:.0f} of {allowed:.0f} s", title_justify="left")
    made.add_column("figure")
    made.add_column("value", justify="right")
    for name, part in content["parts"].items():
        took = "" if part["state"] == SKIPPED else f", {part['seconds']:.0f} s"
        made.add_row(f"[bold]{name}[/bold]", f"{part['state']}{took}")
        if part["why"]:
            made.add_row("  why", part["why"])
        shown = {key: value for key, value in part["figures"].items() if key not in _HIDDEN}
        for key, value in flatten(shown):
            made.add_row(f"  {key}", value_text(value))
        made.add_section()
    return made
