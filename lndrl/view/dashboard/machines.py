"""The machines of a run: who works there, how busy CPU, memory and GPUs are, the busiest first."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rich.text import Text

from lndrl.transport.status import Machine, Status
from lndrl.view.dashboard.panels import Panel
from lndrl.view.palette import GREEN, SKY
from lndrl.view.text import MISSING, fit, number, percent, printable, progress_bar, styled
from lndrl.wording import counted


@dataclass
class Host:
    """One machine; ``actors`` are those that are not gone."""

    name: str
    machine: Machine
    learns: bool = False
    actors: int = 0
    rate: float = 0.0

    @property
    def work(self) -> str:
        """Who works there, in words."""
        parts = ["learner"] if self.learns else []
        return ", ".join([*parts, *([counted(self.actors, "actor")] if self.actors else [])])


def hosts_of(status: Status) -> list[Host]:
    """The machines that somebody works on, the learner's first, then by CPU in use."""
    found: dict[str, Host] = {}
    if status.host:
        found[status.host] = Host(status.host, status.machine, learns=True)
    for actor in status.actors:
        if actor.state == "gone" or not actor.host:
            continue
        host = found.setdefault(actor.host, Host(actor.host, actor.machine))
        if not host.machine.cores:
            host.machine = actor.machine
        host.actors += 1
        host.rate += actor.rate
    return sorted(found.values(), key=lambda host: (not host.learns, -host.machine.cpu, host.name))


def line(status: Status, width: int) -> Text:
    """All machines in one line: how many, and the busiest."""
    known = [host for host in hosts_of(status) if host.machine.cores]
    words = styled("machines", "bold")
    if not known:
        return fit(words.append("  nothing is known of them", style="dim"), width)
    busiest = max(known, key=lambda host: host.machine.cpu)
    fullest = max(known, key=lambda host: host.machine.memory)
    words.append(f"  {len(known)}", style="default")
    words.append("  CPU up to ", style="dim").append(percent(busiest.machine.cpu, 0))
    words.append(f" ({printable(busiest.name)})", style="dim")
    words.append("  memory up to ", style="dim").append(percent(fullest.machine.memory, 0))
    words.append(f" ({printable(fullest.name)})", style="dim")
    if with_one := [host for host in known if host.machine.gpus]:
        hottest = max(with_one, key=lambda host: host.machine.gpu)
        words.append("  GPU up to ", style="dim").append(percent(hottest.machine.gpu, 0))
        words.append(f" ({printable(hottest.name)})", style="dim")
    return fit(words, width)


_GPU: tuple[tuple[str, int, Callable[[Machine], float]], ...] = (
    ("GPU", 6, lambda machine: machine.gpu),
    ("its mem.", 8, lambda machine: machine.gpu_memory),
)
"""Columns of GPUs, where a machine has one: title, cells, share."""
_ALL_OF_GPU = 81
"""Cells from which there is room for both."""


def _have_gpus(hosts: Sequence[Host]) -> bool:
    return any(host.machine.gpus for host in hosts)


def machines(status: Status, width: int, rows: int) -> Panel:
    """A row for each machine, at most ``rows`` lines with the heading."""
    found = hosts_of(status)
    graphics = (_GPU if width >= _ALL_OF_GPU else _GPU[:1]) if _have_gpus(found) else ()
    bar = max((width - 65 - sum(room + 1 for _, room, _ in graphics)) // 2, 0)
    heading = f"{'host':<20} {'work':<18} {'CPU':>6} {'':<{bar}} {'memory':>8} {'':<{bar}} "
    heading += "".join(f"{title:>{room}} " for title, room, _ in graphics)
    lines = [styled(f"{heading}{'steps/s':>7}", "dim")]
    for host in found[: max(rows - 2, 0) if len(found) > rows - 1 else len(found)]:
        cells = Text(no_wrap=True)
        name = fit(Text(printable(host.name)), 20)
        cells.append_text(name).append(" ").append_text(fit(Text(host.work), 18)).append(" ")
        known = host.machine.cores > 0
        cpu = percent(host.machine.cpu, 0) if known else MISSING
        memory = percent(host.machine.memory, 0) if known else MISSING
        cells.append(f"{cpu:>6} ").append_text(progress_bar(host.machine.cpu, bar, GREEN))
        cells.append(f" {memory:>8} ").append_text(progress_bar(host.machine.memory, bar, SKY))
        for _, room, of in graphics:
            share = percent(of(host.machine), 0) if host.machine.gpus else MISSING
            cells.append(f" {share:>{room}}")
        lines.append(cells.append(f" {number(host.rate):>7}"))
    rest = len(found) - (len(lines) - 1)
    if rest:
        lines.append(styled(f"+{rest} more", "dim"))
    return Panel("machines", [fit(line, width) for line in lines[:rows]], f"{len(found)} in all")
