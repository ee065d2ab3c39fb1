"""Run folders: which folder and which configuration a command works with.

Nothing is created here; the learner makes the folder once it holds its port.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from learner.run.folder import RunFolder
from lndrl.cli.again import resuming_command
from lndrl.cli.notes import say_notes
from lndrl.cli.signals import Stop, say, telling
from lndrl.config import DEFAULTS, RunConfig, load_config
from lndrl.errors import UserError
from lndrl.numbering import by_number, checkpoints_in
from lndrl.scenario import BLOCKS

if TYPE_CHECKING:
    from learner.run.record import RunSummary

RUNS = Path("runs")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


def choose_run(
    config_name: str | None, name: str | None, resume: bool, overrides: Sequence[str]
) -> tuple[RunConfig, Path]:
    """Configuration and folder of a new run, or of the run that is resumed.

    ``config_name`` is what ``load_config`` takes, by default lndrl. A resumed run takes its
    configuration from its own ``config.yaml``; ``overrides`` apply to either. Raises UserError
    when the folder exists (or, resumed, does not), for what ``load_config`` refuses, and for a
    scenario whose regions leave the robot no room.
    """
    if name is not None and not _NAME.fullmatch(name):
        raise UserError(
            f"--run {name}: must be one folder name of letters, digits, '.', '_' and '-'"
        )
    if resume:
        config, folder = _resumed(config_name, name, overrides)
    else:
        config, folder = _new(config_name or DEFAULTS["configuration"], name, overrides)
    _check_place(config)
    return config, folder


@contextmanager
def going_on(folder: Path) -> Iterator[None]:
    """Say, when the training of ``folder`` is ended at once, how it goes on."""

    def words() -> str:
        kept = checkpoints_in(folder / "checkpoints")
        if not kept:
            return f"{folder} holds no checkpoint"
        return f"{kept[-1]} is kept; go on with: {resuming_command(folder.name)}"

    with telling(words):
        yield


def concluded(summary: RunSummary, folder: Path, stop: Stop) -> int:
    """Say how the run in ``folder`` ended and how it goes on; the exit code of its command.

    A finished run has succeeded, also where a signal cut short what it only waited for.
    """
    typer.echo(str(summary))
    if summary.finished:
        return 0
    if stop.is_set():
        say(f"go on with: {resuming_command(folder.name)}")
    return stop.exit_code


def _check_place(config: RunConfig) -> None:
    """Refuse a scenario that no episode can start in, before anything is written.

    Says what its place's notes say. Layouts of a generator of one's own are the actors' business:
    the learner does not import it.
    """
    from lndrl.world import Place

    for scenario in config.scenario.parts:
        if scenario.random is not None and scenario.random.generator != BLOCKS:
            continue
        place = Place.build(
            scenario, config.world.robot_radius, arrive_distance=config.task.arrive_distance
        )
        say_notes(place.notes)


def _new(config_name: str, name: str | None, overrides: Sequence[str]) -> tuple[RunConfig, Path]:
    config = load_config(config_name, list(overrides))
    folder = RUNS / (name or f"{Path(config_name).stem}-{datetime.now():%Y%m%d-%H%M%S}")
    if folder.exists():
        raise UserError(
            f"{folder} exists already; continue it with --resume or choose another --run NAME"
        )
    return config, folder


def _resumed(
    config_name: str | None, name: str | None, overrides: Sequence[str]
) -> tuple[RunConfig, Path]:
    if name is None:
        raise UserError(f"--resume needs --run NAME; {_known()}")
    folder = RUNS / name
    if not folder.is_dir():
        raise UserError(f"{folder} does not exist, so it cannot be resumed; {_known()}")
    # Here already, as "the port is in use" would be half the truth. The learner takes the lock.
    RunFolder.check_free(folder)
    own = folder / "config.yaml"
    if config_name is not None:
        given, kept = load_config(config_name), load_config(own)
        if given.content_hash() != kept.content_hash():
            say_notes([f"{folder} goes on with its own {own}, not {config_name}"])
    return load_config(own, list(overrides)), folder


def _known() -> str:
    names = sorted((path.parent.name for path in RUNS.glob("*/config.yaml")), key=by_number)
    return f"runs that exist: {', '.join(names)}" if names else "no run exists here yet"
