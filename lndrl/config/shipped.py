"""Configurations that come with the program, by name, and the user's own files, by path."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Literal

from lndrl.errors import UserError
from lndrl.numbering import by_number

_HERE = Path(__file__).resolve().parent
# A wheel carries the configurations inside the package; a checkout has them beside it.
_IN_WHEEL = _HERE.parent / "configs"
REPOSITORY_CONFIGS = _IN_WHEEL if _IN_WHEEL.is_dir() else _HERE.parent.parent / "configs"

SHIPPED_POLICY = "shipped"
"""The name of the policy that comes with the program, wherever a run folder is taken."""
ROBOT_POLICY = "shipped-robot"
"""The same for bases whose velocities take time; see configs/shipped-robot.yaml."""
SHIPPED_POLICIES = (SHIPPED_POLICY, ROBOT_POLICY)

Kind = Literal["configuration", "scenario", "sweep", "bench", "calibration", "robot"]
PLACES: dict[Kind, str] = {
    "configuration": "*.yaml",
    "scenario": "scenarios/*.yaml",
    "sweep": "sweeps/*.yaml",
    "bench": "benchmark*.yaml",
    "calibration": "calibration*.yaml",
    "robot": "robots/*.yaml",
}
"""Where the files of a kind lie below REPOSITORY_CONFIGS."""
DEFAULTS: dict[Kind, str] = {
    "configuration": "lndrl",
    "bench": "benchmark",
    "calibration": "calibration",
}
"""What a command takes that is given none."""
_ENDINGS = (".yaml", ".yml")


def shipped(kind: Kind) -> dict[str, Path]:
    """Files of ``kind`` that come with the program, by name, in alphabetical order."""
    paths = {path.stem: path for path in REPOSITORY_CONFIGS.glob(PLACES[kind])}
    found = {name: paths[name] for name in sorted(paths, key=by_number)}
    if kind == "configuration":  # the others of that folder are of a kind of their own
        others = {*shipped("bench"), *shipped("calibration")}
        found = {n: p for n, p in found.items() if n not in others}
    return found


def find(kind: Kind, named: Path | str, beside: Path | None = None) -> Path:
    """The file that ``named`` means.

    A word is a name: that of a file that comes with the program. Whatever ends in .yaml or has a
    slash is a path from the working folder. A run folder stands for its own configuration.

    ``beside`` is the folder of a file that names another: paths are from there, if there is such a
    file; NAME.yaml that is nowhere comes with the program, so that a copy of a file that came with
    it works in any folder. Raises UserError that lists the names.
    """
    text, path = str(named), Path(named)
    known = shipped(kind)
    if not _is_path(path, text) and text in known:
        return known[text]
    if beside is not None and (beside / path).is_file():
        return beside / path
    if kind == "configuration" and (path / "config.yaml").is_file():
        return path / "config.yaml"
    if path.is_file():
        return path
    if beside is not None and path.name == text and path.stem in known:
        return known[path.stem]
    if _is_path(path, text):
        problem = "is a folder, not a YAML file" if path.is_dir() else "no such file"
        raise UserError(f"{text}: {problem}; {_known(kind, path.stem)}")
    raise UserError(f"{kind} {text!r} is unknown; {_known(kind, text)}, or give a YAML file")


def _is_path(path: Path, text: str) -> bool:
    return path.suffix in _ENDINGS or "/" in text


def _known(kind: Kind, name: str) -> str:
    """The names of ``kind``, with what ``name`` may have meant."""
    known = list(shipped(kind))
    close = difflib.get_close_matches(name, known, n=1)
    hint = f"did you mean {close[0]}? known" if close else "known"
    return f"{hint} by name: {', '.join(known)}"
