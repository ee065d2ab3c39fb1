"""The machines of a run: who works there, how busy CPU and memory are, the busiest first."""

from __future__ import annotations

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
    return fit(words.append(f" ({printable(fullest.name)})", style="dim"), width)


def machines(status: Status, width: int, rows: int) -> Panel:
    """A row for each machine, at most ``rows`` lines with the heading."""
    found = hosts_of(status)
    bar = max((width - 62) // 2, 0)
    heading = f"{'host':<20} {'work':<18} {'CPU':>6} {'':<{bar}} {'memory':>8} {'':<{bar}} "
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
        lines.append(cells.append(f" {number(host.rate):>7}"))
    rest = len(found) - (len(lines) - 1)
    if rest:
        lines.append(styled(f"+{rest} more", "dim"))
    return Panel("machines", [fit(line, width) for line in lines[:rows]], f"{len(found)} in all")
