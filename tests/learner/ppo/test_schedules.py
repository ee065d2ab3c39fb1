"""What changes over a run: its ends, its middle, and that it is off unless it is set."""

from __future__ import annotations

import pytest
import torch

from learner.ppo.batch import assemble
from learner.ppo.graphs import GraphedStep
from learner.ppo.schedules import batch_size, entropy_weight
from learner.ppo.update import PPO
from lndrl.config import PPOConfig
from lndrl.errors import UserError
from tests.learner.helpers_learner import random_trajectory, small_config


def test_entropy_goes_on_a_line_and_stays_where_no_end_is_named() -> None:
    annealed = PPOConfig(entropy=0.01, entropy_final=0.002)
    weights = [entropy_weight(annealed, progress) for progress in (0.0, 0.25, 1.0)]
    assert weights == pytest.approx([0.01, 0.008, 0.002])
    assert entropy_weight(PPOConfig(entropy=0.01, entropy_final=0.0), 1.0) == 0.0
    assert {entropy_weight(PPOConfig(entropy=0.01), p) for p in (0.0, 0.5, 1.0)} == {0.01}


def test_batches_double_at_equal_distances() -> None:
    ppo = PPOConfig(batch_size=2048, batch_size_final=16_384)
    sizes = [batch_size(ppo, progress) for progress in (0.0, 0.24, 0.25, 0.5, 0.74, 0.75, 1.0)]
    assert sizes == [2048, 2048, 4096, 8192, 8192, 16_384, 16_384]
    uneven = PPOConfig(batch_size=1000, batch_size_final=2500)
    assert [batch_size(uneven, p) for p in (0.0, 0.4, 0.9, 1.0)] == [1000, 2000, 2500, 2500]
    assert batch_size(PPOConfig(batch_size=64, batch_size_final=64), 0.7) == 64
    assert {batch_size(PPOConfig(batch_size=64), p) for p in (0.0, 0.5, 1.0)} == {64}


def test_batches_that_shrink_or_grow_in_lockstep_are_refused() -> None:
    with pytest.raises(UserError, match="batch_size_final 16 must be batch_size 32 or more"):
        small_config(ppo={"batch_size_final": 16})
    with pytest.raises(UserError, match=r"needs learner\.mode: async; in lockstep a batch is a"):
        small_config(ppo={"batch_size_final": 64}, learner={"mode": "lockstep"})


@pytest.fixture
def trainer():
    made: list[PPO] = []

    def make(dense: bool = False, **settings) -> PPO:
        made.append(PPO(small_config(ppo=settings), dense))
        return made[-1]

    yield make
    for each in made:
        each.close()


def weights(ppo: PPO) -> torch.Tensor:
    return torch.cat([p.detach().flatten() for p in ppo.policy.parameters()])


@pytest.mark.parametrize("dense", [False, True])
def test_an_update_uses_the_weight_of_its_moment(trainer, dense: bool) -> None:
    """Half way from 0.2 to 0.4 is as 0.3 all the time, also where it is read from memory."""
    annealed = trainer(dense, entropy=0.2, entropy_final=0.4)
    constant, first = trainer(dense, entropy=0.3), trainer(dense, entropy=0.2)
    batch = assemble([random_trajectory(annealed.config, 1)])
    figures = [ppo.update(batch, 0.5) for ppo in (annealed, constant, first)]
    assert figures[0].pop("entropy_weight") == pytest.approx(0.3)
    assert figures[0] == pytest.approx(figures[1], rel=1e-4)
    assert torch.allclose(weights(annealed), weights(constant), atol=1e-6)
    assert not torch.allclose(weights(annealed), weights(first), atol=1e-6)


def test_recorded_steps_see_it_change(trainer) -> None:
    """A graph that is replayed reads the weight anew."""
    graphed, eager = (
        trainer(dense=True, entropy=0.5, entropy_final=0.0, minibatch_size=16) for _ in range(2)
    )
    record = lambda step: step  # noqa: E731  (replaying is doing it again)
    for trainee in (graphed._actor, graphed._critic):
        trainee.graphed = GraphedStep(trainee._whole_step, record)
    for number, progress in enumerate((0.0, 0.5, 1.0)):
        batch = assemble([random_trajectory(eager.config, number)])
        graphed.update(batch, progress)
        eager.update(batch, progress)
    assert isinstance(graphed._entropy, torch.Tensor) and float(graphed._entropy) == 0.0
    assert torch.allclose(weights(graphed), weights(eager), atol=1e-6)
