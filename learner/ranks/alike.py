"""The same networks, moments and random draws on every rank: those of rank 0."""

from __future__ import annotations

import zlib
from typing import Any

from torch import Tensor

from learner.ppo.team import Team
from learner.ppo.update import PPO


def facts(ppo: PPO) -> dict[str, Any]:
    """What rank 0 says beside the tensors, plain data."""
    average = ppo.average
    return {
        "generator": ppo.rng.bit_generator.state,
        "averaged": average.updates if average is not None else 0,
    }


def make_alike(team: Team, ppo: PPO, said: dict[str, Any]) -> None:
    """Give every rank what rank 0 has, of which ``said`` are its facts; all ranks call it."""
    for optimizer in (ppo.policy_optimizer, ppo.value_optimizer):
        optimizer.begin()
    team.spread(_tensors(ppo))
    if team.rank:
        ppo.rng.bit_generator.state = said["generator"]
        if ppo.average is not None:
            ppo.average.updates = int(said["averaged"])


def digest_of(ppo: PPO) -> int:
    """Tells networks apart that are not alike bit for bit."""
    found = 0
    for network in (ppo.policy, ppo.value):
        for parameter in network.parameters():
            found = zlib.crc32(parameter.detach().cpu().contiguous().numpy().data, found)
    return found


def _tensors(ppo: PPO) -> list[Tensor]:
    networks = [ppo.policy, ppo.value]
    if ppo.average is not None:
        networks.append(ppo.average.network)
    found = [t for network in networks for t in (*network.parameters(), *network.buffers())]
    for optimizer in (ppo.policy_optimizer, ppo.value_optimizer):
        for parameter in optimizer.parameters:
            state = optimizer.state[parameter]
            found += [state[name] for name in ("step", "exp_avg", "exp_avg_sq")]
    return found
