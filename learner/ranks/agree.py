"""Whether all ranks were started alike: by the same command, with the same program."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch

from learner.ppo.team import Team
from lndrl.config import RunConfig, parse_config
from lndrl.config.keys import flatten
from lndrl.errors import UserError
from lndrl.version import VERSION

_ADVICE = "start all ranks with the same command"


@dataclass(frozen=True)
class Asked:
    """What a rank was started with; ``config`` is None for a run that is resumed."""

    config: RunConfig | None
    run: str | None = None
    resume: bool = False
    checkpoint: str | None = None
    overrides: tuple[str, ...] = ()


@dataclass(frozen=True)
class Agreed:
    """What all ranks work on."""

    config: RunConfig
    path: Path


def lead(team: Team, config: RunConfig, path: Path, asked: Asked) -> None:
    """Tell the others what rank 0 was started with; raises UserError where one disagrees."""
    if config.learner.mode == "lockstep":
        why = (
            "learner.mode lockstep promises the same bits on every machine, and sums over ranks "
            "are rounded otherwise; use mode async, or one rank"
        )
        team.say({"refused": why})
        raise UserError(why)
    word = {
        "versions": _versions(),
        "config": config.model_dump(mode="json"),
        "path": str(path),
        "asked": _plain(asked),
    }
    team.say(word)
    _check(team, "")


def follow(team: Team, asked: Asked | None) -> Agreed:
    """What rank 0 was started with; ``asked`` None takes it as it is. Raises UserError."""
    word = team.hear()
    if "refused" in word:
        raise UserError(f"rank 0 has refused to begin: {word['refused']}")
    here = team.name(team.rank)
    misfit = _version_misfit(here, word["versions"])
    config = None if misfit else parse_config(word["config"], "configuration from rank 0")
    if asked is not None and config is not None:
        misfit = _misfit(here, asked, word["asked"], config)
    _check(team, misfit)
    assert config is not None
    return Agreed(config, Path(word["path"]))


def _check(team: Team, misfit: str) -> None:
    found = [word["misfit"] for word in team.gather({"misfit": misfit}) if word["misfit"]]
    if found:
        raise UserError(found[0])


def _versions() -> dict[str, str]:
    return {"lndrl": VERSION, "torch": torch.__version__.partition("+")[0]}


def _version_misfit(here: str, theirs: dict[str, str]) -> str:
    for name, mine in _versions().items():
        if mine != theirs.get(name):
            return f"{here} has {name} {mine}, rank 0 has {theirs.get(name)}; install the same"
    return ""


def _plain(asked: Asked) -> dict[str, Any]:
    told = {k: v for k, v in asdict(asked).items() if k != "config"}
    return {**told, "overrides": list(asked.overrides)}


def _misfit(here: str, asked: Asked, theirs: dict[str, Any], config: RunConfig) -> str:
    mine = _plain(asked)
    if mine["resume"] != theirs["resume"]:
        with_it, without = ("rank 0", here) if theirs["resume"] else (here, "rank 0")
        return f"{with_it} was started with --resume, {without} without; {_ADVICE}"
    if asked.config is None:
        for name in ("run", "checkpoint", "overrides"):
            if mine[name] != theirs[name]:
                option = "--set" if name == "overrides" else f"--{name}"
                return (
                    f"{option}: {here} was started with {_words(mine[name])}, rank 0 with "
                    f"{_words(theirs[name])}; {_ADVICE}"
                )
        return ""
    own, other = (flatten(each.model_dump(mode="json")) for each in (asked.config, config))
    for key in [*own, *(key for key in other if key not in own)]:
        if own.get(key) != other.get(key):
            return (
                f"{key} is {_words(own.get(key))} on {here} and {_words(other.get(key))} on rank "
                f"0; start all ranks with the same configuration"
            )
    return ""


def _words(value: Any) -> str:
    text = "none" if value is None or value == [] else str(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
