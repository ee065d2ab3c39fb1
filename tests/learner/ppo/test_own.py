"""PPO on networks and encoders of somebody's own, on the CPU and the way a GPU does it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from learner.ppo.batch import assemble
from learner.ppo.update import PPO
from learner.run.checkpoint import Counters, load_checkpoint, save_checkpoint
from tests.learner.helpers_learner import random_trajectory, small_config

TEXT = """
    import torch
    from torch import nn

    class Net(nn.Module):
        def __init__(self, config, outputs):
            super().__init__()
            self.maps = nn.Conv2d(3, 2, 3)
            self.unused = nn.Linear(2, 2)
            self.head = nn.Linear(2 + 720 + 6, outputs)
            nn.init.zeros_(self.head.weight)

        def forward(self, inputs):
            people = self.maps(inputs.people).amax(dim=(2, 3))
            return self.head(torch.cat([people, inputs.scan, inputs.goal], dim=1))

    class Maps(nn.Module):
        def __init__(self, config):
            super().__init__()
            self.features = 4
            self.layer = nn.Conv2d(3, 4, 3, stride=4)

        def forward(self, maps):
            return torch.relu(self.layer(maps)).mean(dim=(2, 3))
"""


@pytest.mark.parametrize("key, kind", [("policy", "Net"), ("map_encoder", "Maps")])
def test_it_learns_the_same_dense_and_on_the_cpu(
    own_module: Callable[..., str], tmp_path: Path, key: str, kind: str
) -> None:
    config = small_config(network={key: f"{own_module(TEXT)}:{kind}"})
    batch = assemble([random_trajectory(config, seed) for seed in (1, 2)])
    learned = []
    for dense in (False, True):
        ppo = PPO(config, dense=dense)
        before = [p.detach().clone() for p in ppo.policy.parameters()]
        figures = ppo.update(batch, 0.0)
        assert all(torch.isfinite(torch.tensor(value)) for value in figures.values())
        after = list(ppo.policy.parameters())
        assert any(not torch.equal(a, b) for a, b in zip(before, after, strict=True))
        learned.append(ppo)
    for one, other in zip(*(p.policy.parameters() for p in learned), strict=True):
        torch.testing.assert_close(one, other, atol=1e-4, rtol=1e-3)
    kept = save_checkpoint(tmp_path, learned[0], Counters(steps=1), {}, 3)
    fresh = PPO(config)
    load_checkpoint(kept, fresh)
    for one, other in zip(learned[0].value.parameters(), fresh.value.parameters(), strict=True):
        assert torch.equal(one, other)
    for ppo in (*learned, fresh):
        ppo.close()
