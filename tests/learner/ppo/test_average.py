"""Averaged weights, against the sum written out."""

from __future__ import annotations

import pytest
import torch

from learner.ppo.average import Average
from learner.ppo.batch import assemble
from learner.ppo.update import PPO, DivergedError
from lndrl.errors import UserError
from lndrl.policy import build_policy
from tests.learner.helpers_learner import random_trajectory, small_config

DEVICES = ["cpu", pytest.param("cuda", marks=pytest.mark.cuda)]


@pytest.mark.parametrize("device", DEVICES)
def test_the_first_updates_count_alike_and_later_ones_fade(device: str) -> None:
    torch.manual_seed(3)
    network = build_policy(small_config()).to(device)
    average = Average(network, decay=0.75)
    versions: list[torch.Tensor] = []
    expected = torch.zeros(0)
    for update in range(1, 9):
        with torch.no_grad():
            for parameter in network.parameters():
                parameter.add_(torch.randn_like(parameter))
        average.add(network)
        versions.append(torch.cat([p.detach().flatten() for p in network.parameters()]).double())
        if update <= 4:
            expected = torch.stack(versions).mean(0)
        else:
            expected = 0.75 * expected + 0.25 * versions[-1]
        mine = torch.cat([p.flatten() for p in average.network.parameters()]).double()
        assert torch.allclose(mine, expected, atol=1e-5)
    assert not any(p.requires_grad for p in average.network.parameters())


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("acting", ["current", "average"])
def test_who_acts_and_what_is_tested(device: str, acting: str) -> None:
    learner = {"average": 0.9, "acting": acting, "device": device}
    ppo, plain = PPO(small_config(learner=learner)), PPO(small_config(learner={"device": device}))
    try:
        for seed in range(3):
            batch = assemble([random_trajectory(ppo.config, seed)])
            assert ppo.update(batch, 0.0) == plain.update(batch, 0.0)
        assert ppo.average is not None
        assert ppo.tested is ppo.average.network is not ppo.policy
        assert ppo.acting is (ppo.tested if acting == "average" else ppo.policy)
        assert plain.tested is plain.acting is plain.policy
    finally:
        ppo.close()
        plain.close()


def test_an_update_that_diverged_is_not_averaged(monkeypatch) -> None:
    ppo = PPO(small_config(learner={"average": 0.5}))
    try:
        batch = assemble([random_trajectory(ppo.config, 1)])
        ppo.update(batch, 0.0)
        before = [p.clone() for p in ppo.tested.parameters()]
        monkeypatch.setattr(ppo._safeguard, "is_finite", lambda: False)
        with pytest.raises(DivergedError):
            ppo.update(batch, 0.0)
        assert ppo.average is not None and ppo.average.updates == 1
        assert all(map(torch.equal, before, ppo.tested.parameters()))
    finally:
        ppo.close()


def test_acting_on_an_average_needs_one() -> None:
    with pytest.raises(UserError, match="acting: average needs average above 0"):
        small_config(learner={"acting": "average"})
