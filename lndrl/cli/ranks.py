"""Learners of several processes: started by torchrun, or by ``--ranks`` on this machine."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Annotated

import typer

from lndrl.config import DEFAULTS, RunConfig, load_config
from lndrl.errors import UserError
from lndrl.machine.signals import stop_handler

if TYPE_CHECKING:
    from learner.ppo.team import Team
    from learner.ranks.agree import Asked
    from lndrl.transport import Security

MOST = 64

Ranks = Annotated[
    int,
    typer.Option(
        "--ranks",
        min=1,
        max=MOST,
        metavar="K",
        help="Train in K processes that share actors and minibatches; over several machines "
        "torchrun starts them (docs/ranks.md).",
    ),
]


def joined() -> Team | None:
    """The team that torchrun has started this process for; None where it did not.

    Raises UserError when the others do not come.
    """
    if not (os.environ.get("RANK") and os.environ.get("MASTER_PORT")):
        return None  # what follows imports torch
    from learner.ppo.team import Team

    return Team.of_environment()


@contextmanager
def leading(team: Team | None, ranks: int, options: Sequence[str]) -> Iterator[Team | None]:
    """The team that this process leads: ``team``, or ``ranks`` that it starts; None for one rank.

    ``options`` are those that all ranks need, see ``shared_options``.
    """
    if team is not None:
        if ranks > 1:
            raise UserError("--ranks does not go with torchrun, which starts the ranks itself")
        try:
            yield team
        finally:
            team.close()
    elif ranks > 1:
        from learner.ranks.local import LocalRanks

        with LocalRanks(ranks, options) as started:
            yield started
    else:
        yield None


def asked_for(
    config_name: str | None,
    run: str | None,
    resume: bool,
    checkpoint: str | None,
    overrides: Sequence[str],
) -> Asked | None:
    """What this rank was started with; None where it leaves all to rank 0. Raises UserError."""
    from learner.ranks.agree import Asked

    if not (config_name or run or resume or overrides):
        return None
    config: RunConfig | None = None
    if not resume:
        config = load_config(config_name or DEFAULTS["configuration"], list(overrides))
    return Asked(config, run, resume, checkpoint, tuple(overrides))


def lead(team: Team, config: RunConfig, folder: Path, asked: Asked | None) -> None:
    """Tell the other ranks what this one was started with; raises UserError if they disagree."""
    from learner.ranks import agree

    agree.lead(team, config, folder, asked or agree.Asked(config))


def follow(team: Team, asked: Asked | None, security: Callable[[RunConfig], Security]) -> None:
    """Be another rank than 0 until the job ends; raises UserError."""
    from learner.ranks import agree
    from learner.ranks.follower import run_follower

    stop = Event()

    def handle(number: int, frame: object) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()  # rank 0 hears of it with the next word, and says what all do then

    try:
        with stop_handler(handle):
            agreed = agree.follow(team, asked)
            run_follower(team, agreed.config, agreed.path, security(agreed.config), stop)
    finally:
        team.close()


def shared_options(
    certs: Path | None = None,
    users: Path | None = None,
    zenoh: Path | None = None,
    insecure: bool = False,
    user: str | None = None,
    password_file: Path | None = None,
    trust_modules: Sequence[str] | None = None,
) -> list[str]:
    """The options of this process that its other ranks are started with; no password is one."""
    given = {
        "--certs": certs,
        "--users": users,
        "--zenoh": zenoh,
        "--user": user,
        "--password-file": password_file,
    }
    options = [word for name, value in given.items() if value for word in (name, str(value))]
    options += ["--insecure"] if insecure else []
    return options + [
        word for module in trust_modules or [] for word in ("--trust-modules", module)
    ]
