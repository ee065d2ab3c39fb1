"""What a page says of where it was made."""

from __future__ import annotations

import os
import platform
import time

from lndrl.cli.version import versions
from lndrl.machine.cores import usable_cores
from lndrl.machine.processor import model
from lndrl.version import VERSION
from lndrl.view.report.parts import Facts, Section
from lndrl.wording import counted


def made() -> str:
    """By what a page was made, and when."""
    return f"Made by lndrl {VERSION} on {time.strftime('%Y-%m-%d at %H:%M %Z')}."


def machine_section(said: list[tuple[str, str]]) -> Section:
    """What is ``said`` of where the figures are from, and the machine that made the page."""
    here = [
        ("this page was made on", platform.node() or "an unnamed machine"),
        ("processor", model()),
        ("cores", counted(usable_cores(), "usable core")),
        ("memory", f"{_memory():.1f} GB"),
        ("system", f"{platform.system()} {platform.release()}, {platform.machine()}"),
        *((f"version of {name}", found) for name, found in versions().items()),
    ]
    return Section("machine", "Machine and versions", [Facts([*said, *here])])


def _memory() -> float:
    """GB that the machine has."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9
