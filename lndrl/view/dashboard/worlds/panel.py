"""A live world on the whole screen: the map around the robot, and beside it what it thinks."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from rich.text import Text

from lndrl.navigation import WorldSnapshot
from lndrl.view.dashboard.panels import Panel
from lndrl.view.dashboard.worlds.onlooker import Onlooker
from lndrl.view.palette import BAD, BELIEF, BLUE, GOOD, OUTCOME, OUTCOME_WORD, WARNING
from lndrl.view.text import beside, fit, number, printable, sparkline, styled
from lndrl.view.walk import walk_legend, walk_picture

SIDE = 33
"""Cells of what stands beside the map."""
_BESIDE = 66
"""Cells from which there is room for that beside it; else some of it stands below."""
_CELL = 4


def world_panel(onlooker: Onlooker, width: int, rows: int, colours: bool = True) -> Panel:
    """What ``onlooker`` sees, in exactly ``rows`` lines of ``width`` cells."""
    snapshot = onlooker.snapshot
    title = f"live world of {printable(onlooker.actor_id)}"
    words = onlooker.words()
    if snapshot is None:
        lines = [fit(styled(words, "dim"), width)]
        lines += [fit(Text(), width) for _ in range(rows - 1)]
        return Panel(title, lines[:rows])
    facts = _facts(snapshot, onlooker, min(SIDE, width))
    legend = [fit(walk_legend(colours, cloud=True), width)] if rows >= 12 else []
    if words:
        legend = [fit(styled(words, WARNING), width)]
    tall = rows - len(legend)
    if width >= _BESIDE:
        room = width - SIDE - 2
        picture = _map(snapshot, room, tall, colours)
        lines = [
            picture[i].append("  ").append_text(facts[i] if i < len(facts) else Text())
            for i in range(tall)
        ]
    else:
        few = facts[: min(len(facts), max(tall - 6, 0), 6)]
        lines = [*_map(snapshot, width, tall - len(few), colours), *few]
    lines = [fit(line, width) for line in [*lines, *legend]]
    note = f"{printable(snapshot.scenario)} · episode {snapshot.episode:,}"
    return Panel(title, lines[:rows], note)


def _map(snapshot: WorldSnapshot, width: int, rows: int, colours: bool) -> list[Text]:
    """Exactly ``rows`` lines of ``width`` cells."""
    rows = max(rows, 0)
    picture = walk_picture(snapshot, width, max(rows, 1), colours, cloud=True).split("\n")
    lines = [fit(line, width) for line in picture]
    lines += [fit(Text(), width) for _ in range(rows - len(lines))]
    return lines[:rows]


def _facts(snapshot: WorldSnapshot, onlooker: Onlooker, width: int) -> list[Text]:
    """What is known of the moment, the most vital first."""
    to_goal = float(np.hypot(*(snapshot.goal - snapshot.pose_true[:2])))
    now = styled(f"{snapshot.time:.1f} s", "bold").append(
        f"  step {snapshot.steps}  {to_goal:.1f} m to go", style="default"
    )
    if snapshot.outcome:
        word = printable(OUTCOME_WORD.get(snapshot.outcome, snapshot.outcome)).upper()
        colour = OUTCOME.get(snapshot.outcome, "default")
        now = styled(f"{word} after {snapshot.time:.1f} s", f"bold {colour}")
    lines = [now, *_belief(snapshot, width), *_reward(snapshot, width), *_actions(snapshot, width)]
    ends = ", ".join(
        f"{n} {printable(OUTCOME_WORD.get(k, k))}" for k, n in onlooker.ends.most_common(4)
    )
    lines.append(styled(f"seen to end: {ends or 'none yet'}", "dim"))
    lines.append(styled(f"weights {onlooker.version:,} · world {snapshot.world}", "dim"))
    return [fit(line, width) for line in lines]


def _belief(snapshot: WorldSnapshot, width: int) -> list[Text]:
    """How far it is off, against what counts as lost, and how that came."""
    share = max(
        snapshot.position_error / max(snapshot.lost_distance, 1e-9),
        snapshot.angle_error / max(snapshot.lost_angle, 1e-9),
    )
    colour = BAD if share > 1.0 else WARNING if share > 0.5 else GOOD
    off = styled(
        f"{snapshot.position_error:.2f} m {math.degrees(snapshot.angle_error):.0f}° off", colour
    )
    limit = f"lost at {snapshot.lost_distance:g} m {math.degrees(snapshot.lost_angle):.0f}°"
    deviation = math.sqrt(max(float(snapshot.variance[:2].sum()), 0.0))
    turned = math.degrees(math.sqrt(max(float(snapshot.variance[2]), 0.0)))
    lines = [beside(off, styled(limit, "dim"), width)]
    lines.append(styled(f"σ {deviation:.2f} m {turned:.1f}°", "dim"))
    both = min(len(snapshot.path), len(snapshot.path_estimated))
    if both:
        apart = snapshot.path[:both] - snapshot.path_estimated[:both]
        room = width - lines[-1].cell_len - 2
        errors = np.hypot(apart[:, 0], apart[:, 1]).tolist()
        lines[-1].append("  ").append(sparkline(errors, room), style=BELIEF)
    return lines


def _reward(snapshot: WorldSnapshot, width: int) -> list[Text]:
    """The parts of the last step, each with a bar to the left of nothing or to its right."""
    title = styled("reward", "bold").append(
        f"  {number(float(snapshot.parts.sum()))}", style="default"
    )
    lines = [beside(title, styled(f"sum {number(snapshot.episode_return)}", "dim"), width)]
    half = max((width - 20) // 2, 1)
    most = max(float(np.abs(snapshot.parts).max(initial=0.0)), 1e-9)
    for name, value in zip(snapshot.part_names, snapshot.parts.tolist(), strict=True):
        cells = round(half * abs(value) / most)
        left = f"{'█' * cells if value < 0 else '':>{half}}"
        right = f"{'█' * cells if value > 0 else '':<{half}}"
        line = styled(f"{printable(name)[:9]:<9} ", "default").append(f"{value:>8.1f} ")
        lines.append(
            line.append(left, style=BAD).append("│", style="dim").append(right, style=GOOD)
        )
    return lines


def _actions(snapshot: WorldSnapshot, width: int) -> list[Text]:
    """Probabilities in percent over speeds (rows) and rates of turning (columns, left is left)."""
    speeds, rates = (np.unique(snapshot.actions[:, i]) for i in (0, 1))
    if not len(speeds):
        return []
    cell = min((width - 4) // len(rates), _CELL)
    known = len(snapshot.probabilities) > 0
    if cell < 3 or len(speeds) > 8:
        return _likeliest(snapshot)
    head = styled("m/s ", "dim")
    for rate in rates[::-1]:
        head.append(f"{_short(rate):>{cell}}", style="dim")
    lines = [styled("actions, %", "bold").append("  turning left is left", style="dim"), head]
    asked = snapshot.actions.tolist() if known else []
    said = snapshot.probabilities.tolist()
    shares = {(v, w): share for (v, w), share in zip(asked, said, strict=True)}
    taken = tuple(snapshot.actions[snapshot.action].tolist()) if snapshot.action >= 0 else None
    for speed in speeds[::-1].tolist():
        line = styled(f"{_short(speed):<4}", "dim")
        for rate in rates[::-1].tolist():
            share = float(shares.get((speed, rate), 0.0))
            words = f"{100 * share:.0f}" if share >= 0.005 else "·"
            style = f"bold {BLUE}" if share > 0.3 else "default" if share >= 0.005 else "dim"
            if (speed, rate) == taken:
                words, style = f"[{words}" if cell > 3 else words, f"reverse {style}"
            line.append(f"{words:>{cell}}", style=style)
        lines.append(line)
    return lines


def _likeliest(snapshot: WorldSnapshot, most: int = 5) -> list[Text]:
    best = np.argsort(-snapshot.probabilities)[:most]
    return [
        Text(
            f"{100 * snapshot.probabilities[i]:3.0f} %  {snapshot.actions[i][0]:g} m/s  "
            f"{snapshot.actions[i][1]:g} rad/s"
        )
        for i in best
    ]


def _short(value: float) -> str:
    return f"{value:.1f}".replace("0.", ".") if abs(value) >= 0.05 else "0"


def empty(words: str, width: int, rows: int) -> Panel:
    """A panel that says why there is no world to see."""
    lines: Sequence[Text] = [fit(styled(words, "dim"), width)]
    return Panel("live world", [*lines, *(fit(Text(), width) for _ in range(rows - 1))][:rows])
