"""The reference, made from the code: commands, configuration, messages, metrics, Python."""

from __future__ import annotations

from pathlib import Path

from docs.site.reference.commands import command_pages
from docs.site.reference.configuration import configuration_pages
from docs.site.reference.messages import messages_page
from docs.site.reference.metrics import metrics_page
from docs.site.reference.python import python_page
from docs.site.stage import one_dialect

__all__ = ["reference_pages", "write_reference"]


def reference_pages() -> dict[str, str]:
    """File name to Markdown of every page of the reference."""
    return {
        **command_pages(),
        **configuration_pages(),
        "messages.md": messages_page(),
        "metrics.md": metrics_page(),
        "python.md": python_page(),
    }


def write_reference(folder: Path) -> None:
    """Write all pages into ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in reference_pages().items():
        (folder / name).write_text(one_dialect(text), encoding="utf-8")
