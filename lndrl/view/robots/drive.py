"""A live drive in the terminal: map, robot, scan, people, belief, thoughts, and what stops it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from rich.console import Group
from rich.text import Text

from lndrl.robot.driving import DriveView
from lndrl.view.palette import BAD, BELIEF, ECHO, FLOOR, GOAL, GOOD, PERSON, QUIET, TRUTH, WALL
from lndrl.view.text import fit, styled, wrap
from lndrl.view.walk import METRES, direction, disc, half_blocks

Floats = NDArray[np.float64]

_FLOOR, _WALL, _ECHO, _PARTICLE, _GOAL, _PERSON, _ROBOT = range(7)
_COLOURS = (FLOOR, WALL, ECHO, BELIEF, GOAL, PERSON[""], TRUTH)
_GLYPHS = " #'eGoR"
_LEGEND = (("robot, where it believes to be", _ROBOT), ("belief", _PARTICLE), ("people", _PERSON),
           ("goal", _GOAL), ("laser", _ECHO))  # fmt: skip
_BESIDE = 26
"""Characters for the table of actions beside the map."""
_ROOMY = 12
"""Lines of a terminal from which there is one for the belief's health."""
_UNSEEN = 0.03
"""Share of the policy's view that may lack without a word."""
_SHADES = " ░▒▓█"


def drive_screen(
    view: DriveView, head: str, latency: float | None, width: int, height: int, colours: bool = True
) -> Group:
    """``view`` in at most ``width`` x ``height`` characters. ``head`` says what drives whom;
    ``latency`` (s) is the usual time from a scan to its command.
    """
    guard = styled("guard on", GOOD) if view.guard else styled("no guard", BAD)
    if view.doubt:
        guard = styled(f"{guard.plain}, but {view.doubt}", BAD)
    lines = [styled(f"{head}, ", "bold") + guard, *_state(view, width), _numbers(view)]
    if height >= _ROOMY:
        lines.append(_health(view, latency))
    table = _actions(view, colours)
    beside = _BESIDE if table and width >= 70 else 0
    rows = height - len(lines) - 2
    picture = _picture(view, max(width - beside - 1, 1), max(rows, 1), colours)
    if beside:
        picture = _side_by_side(picture, table, width - beside - 1)
    return Group(*(fit(line, width) for line in lines), picture, _legend(colours))


def drive_line(view: DriveView) -> str:
    """The same in a line, for pipes and terminals that cannot draw."""
    first = view.stops[0] if view.stops else None
    state = str(first) if first else f"driving {view.command[0]:.2f} m/s {view.command[1]:+.2f}"
    return f"{_where(view)}; {state}"


def _state(view: DriveView, width: int) -> list[Text]:
    """Driving, or every reason to stand, the first with what to do."""
    if not view.stops:
        v, w = view.command
        held = styled(f"held back by the guard: {view.guarded}" if view.guarded else "", BELIEF)
        return [styled(f"driving   {v:.2f} m/s   {w:+.2f} rad/s", GOOD), held]
    first = view.stops[0]
    style = QUIET if first.reason.is_rest else BAD
    said = wrap(f"standing {first}", width, 2)
    others = ", ".join(stop.reason.label for stop in view.stops[1:])
    found = [styled(line, style) for line in said]
    if len(found) == 1:
        found.append(styled(f"also {others}" if others else "", QUIET))
    return found


def _numbers(view: DriveView) -> Text:
    said = [_where(view)]
    if view.estimate is not None:
        x, y, yaw = np.sqrt(np.maximum(view.estimate.variance, 0.0))
        said.append(f"± {np.hypot(x, y):.2f} m {np.degrees(yaw):.0f}°")
    said.append(f"{view.tally.arrivals} arrived, {view.tally.distance:.0f} m")
    return styled("   ".join(said), QUIET)


def _health(view: DriveView, latency: float | None) -> Text:
    """How well the belief stands, and how quick the answers are."""
    said = []
    health = None if view.estimate is None else view.estimate.health
    if health is not None:
        said.append(f"map explains {100 * health.agreement:.0f} %")
        said.append(f"{100 * health.effective_share:.0f} % matter")
        said.append(f"2nd place {100 * health.second_cluster:.0f} %")
        said.append(f"{health.echoes} echoes")
    if view.unseen > _UNSEEN:
        said.append(f"blind in {100 * view.unseen:.0f} % of its view")
    if latency is not None:
        said.append(f"answers in {1000 * latency:.1f} ms")
    return styled("  ".join(said), QUIET)


def _where(view: DriveView) -> str:
    if view.estimate is None:
        return "no pose yet"
    x, y, yaw = view.estimate.pose
    left = ""
    if view.goal is not None:
        left = f", {np.hypot(*(view.goal - view.estimate.pose[:2])):.1f} m to the goal"
    return f"at ({x:.2f}, {y:.2f}) {np.degrees(yaw):.0f}°{left}"


def _picture(view: DriveView, columns: int, rows: int, colours: bool) -> Text:
    pixels = _pixels(view, columns, rows)
    if colours:
        return half_blocks(pixels, _COLOURS)
    upper, lower = pixels[0::2], pixels[1::2]
    both = np.maximum(upper, lower)
    return Text("\n".join("".join(_GLYPHS[code] for code in row) for row in both), no_wrap=True)


def _pixels(view: DriveView, columns: int, rows: int) -> NDArray[np.uint8]:
    """What is where around the robot, (2 * lines, characters), the highest y first."""
    shape = np.array([columns, 2 * rows])
    span = shape * METRES
    here = np.zeros(3) if view.estimate is None else view.estimate.pose
    low, size, origin = here[:2] - span / 2, span, here[:2] - span / 2
    if view.map is not None:
        origin, size = np.array(view.map.grid.origin), np.array(view.map.grid.size)
        shape = np.minimum(np.ceil(size / METRES).astype(int), shape)
        shape[1] += shape[1] % 2
        span = shape * METRES
        low = np.clip(here[:2] - span / 2, origin, np.maximum(origin + size - span, origin))
    drawn = np.zeros((shape[1], shape[0]), np.uint8)

    def dots(points: Floats, code: int) -> None:
        index = np.floor((points.reshape(-1, 2) - low) / METRES).astype(int)
        index = index[((index >= 0) & (index < shape)).all(axis=1)]
        drawn[index[:, 1], index[:, 0]] = code

    if view.map is not None:
        grid = view.map.grid
        row, column = np.nonzero(grid.mapped)
        dots(origin + (np.stack([column, row], axis=1) + 0.5) * grid.resolution, _WALL)
    dots(view.echoes, _ECHO)
    if view.estimate is not None:
        dots(view.estimate.particles[:, :2], _PARTICLE)
    if view.goal is not None:
        edge = np.clip(view.goal, low + METRES / 2, low + span - METRES / 2)
        inside = (edge == view.goal).all()
        dots(edge + disc(view.arrive_distance if inside else 0.0), _GOAL)
    if view.estimate is not None:
        c, s = np.cos(here[2]), np.sin(here[2])
        turned = np.array([[c, -s], [s, c]])
        for person in view.people:
            dots(here[:2] + turned @ person[:2] + disc(0.3), _PERSON)
        nose = here[:2] + 0.35 * direction(here[2])
        dots(np.vstack([here[:2] + disc(view.robot_radius), nose]), _ROBOT)
    return drawn[::-1]


def _actions(view: DriveView, colours: bool) -> list[Text]:
    """How likely each action was: a row for each speed, turning left on the left."""
    if view.probabilities is None:
        return []
    speeds = np.unique(view.actions[:, 0])[::-1]
    turns = np.unique(view.actions[:, 1])[::-1]
    lines = [styled("what it thinks of", QUIET), Text("")]
    shares = np.asarray(view.probabilities, np.float64)
    for v in speeds:
        line = Text(f"{v:4.1f} ", no_wrap=True)
        for w in turns:
            chosen = (np.abs(view.actions - (v, w)) < 1e-9).all(axis=1)
            share = float(shares[chosen].sum())
            shade = _SHADES[min(int(np.ceil(share * 4.0 - 1e-9)), 4)] if share > 0.01 else "·"
            line.append(shade * 2 + " ", style=TRUTH if colours and share > 0.01 else QUIET)
        lines.append(line)
    lines.append(styled(" m/s  left     right", QUIET))
    best = int(shares.argmax())
    v, w = view.actions[best]
    lines += [Text(""), styled(f"most: {v:.1f} m/s {w:+.1f}", QUIET)]
    lines.append(styled(f"      by {100 * shares[best]:.0f} %", QUIET))
    return lines


def _side_by_side(picture: Text, table: list[Text], width: int) -> Text:
    lines = picture.split("\n", allow_blank=True)
    found = Text(no_wrap=True)
    for i, line in enumerate(lines):
        if i:
            found.append("\n")
        found.append_text(fit(line, width) if i < len(table) else line)
        if i < len(table):
            found.append("  ").append_text(table[i])
    return found


def _legend(colours: bool) -> Text:
    legend = Text(no_wrap=True)
    for word, code in _LEGEND:
        sign = styled("■ ", _COLOURS[code]) if colours else Text(f"{_GLYPHS[code]} ")
        legend.append_text(sign).append(f"{word}   ")
    legend.rstrip()
    return legend
