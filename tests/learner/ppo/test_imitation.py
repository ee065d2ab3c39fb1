"""The update of a policy that imitates, and of one that PPO holds to its teacher."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from learner.ppo.batch import Batch, assemble
from learner.ppo.example.stage import Stage
from learner.ppo.losses import expected_regret, teacher_divergence
from learner.ppo.update import PPO
from lndrl.policy import prepare
from lndrl.transport.status import GUIDED, IMITATION, REINFORCEMENT
from tests.learner.helpers_learner import random_trajectory, small_config

IMITATING = Stage(IMITATION, temperature=0.5)


@pytest.fixture
def trainer():
    made = []

    def make(dense: bool = False, **changes) -> PPO:
        settings = {
            "ppo": {"teacher": "predictive", "entropy": 0.0, **changes.pop("ppo", {})},
            "imitation": {"learning_rate": 3e-3, "mirror": False, **changes.pop("imitation", {})},
        }
        made.append(PPO(small_config(**settings, **changes), dense))
        return made[-1]

    yield make
    for each in made:
        each.close()


def batch_of(ppo: PPO, liked: int | None = None, taught: bool = True) -> Batch:
    """Random states; the teacher likes action ``liked`` best everywhere."""
    trajectories = [random_trajectory(ppo.config, seed, steps=16, worlds=2) for seed in (1, 2)]
    for i, trajectory in enumerate(trajectories):
        costs = trajectory.teacher
        assert costs is not None
        if liked is not None:
            costs[..., liked] = 0.0
            costs[..., np.arange(28) != liked] += 1.0
        if not taught:
            trajectories[i] = replace(trajectory, teacher=costs[:0])
    return assemble(trajectories)


def divergence(ppo: PPO, batch: Batch) -> float:
    with torch.no_grad():
        logits = ppo.policy(prepare(batch.observation, ppo.config))
    return float(teacher_divergence(logits, torch.from_numpy(batch.teacher), 0.5)[0].mean())


@pytest.mark.parametrize("dense", [False, True])
@pytest.mark.parametrize("joint", [False, True])
def test_whoever_imitates_comes_near_the_teacher(trainer, dense: bool, joint: bool) -> None:
    ppo = trainer(dense, ppo={"joint_gradient_norm": joint})
    batch = batch_of(ppo, liked=5)
    before = divergence(ppo, batch)
    rows = [ppo.update(batch, 0.0, IMITATING) for _ in range(12)]
    assert divergence(ppo, batch) < 0.2 * before
    assert rows[-1]["teacher_kl"] < rows[0]["teacher_kl"]
    assert rows[-1]["teacher_agreement"] == pytest.approx(1.0)
    assert (rows[0]["kl"], rows[0]["clip_fraction"], rows[0]["importance_max"]) == (0.0, 0.0, 1.0)
    assert rows[0]["learning_rate"] == 3e-3


def test_ppo_is_kept_from_what_the_teacher_deems_dangerous_and_free_otherwise(trainer) -> None:
    """No advantage says anything; action 5 is the cheapest, all but 5 and 6 are dangerous."""
    found = {}
    for avoid in (0.0, 5.0):
        ppo = trainer(
            ppo={"normalize_advantages": False}, imitation={"avoid": avoid, "danger": 20.0}
        )
        batch = batch_of(ppo, liked=5)
        assert batch.teacher is not None
        batch.teacher[:] = 30.0
        batch.teacher[:, 5], batch.teacher[:, 6] = 0.0, 10.0
        for trajectory in batch.trajectories:
            trajectory.reward[:] = 0.0
        for _ in range(15):
            ppo.update(batch, 0.0, Stage(temperature=0.1, avoids=avoid > 0.0))
        with torch.no_grad():
            logits = ppo.policy(prepare(batch.observation, ppo.config))
        chance = torch.softmax(logits, dim=1).mean(0)
        found[avoid] = float(1.0 - chance[5] - chance[6])
        ratio = float(chance[6] / chance[5])
    assert found[0.0] > 0.8 > 0.4 > found[5.0]
    assert 0.2 < ratio < 5.0  # the cheaper one is not preferred for being cheaper


def test_regret_makes_the_policy_mind_what_mistakes_cost(trainer) -> None:
    def regret(ppo: PPO, batch: Batch) -> float:
        with torch.no_grad():
            logits = ppo.policy(prepare(batch.observation, ppo.config))
        return float(expected_regret(logits, torch.from_numpy(batch.teacher)).mean())

    ended = {}
    for weight in (0.0, 5.0):
        ppo = trainer(imitation={"regret": weight})
        batch = batch_of(ppo)
        assert batch.teacher is not None
        batch.teacher[:, 7] = 9.0  # one action that costs much more than the others
        for _ in range(6):
            figures = ppo.update(batch, 0.0, IMITATING)
        ended[weight] = regret(ppo, batch)
        assert figures["policy_loss"] >= figures["teacher_kl"] - 1e-6
    assert ended[5.0] < 0.9 * ended[0.0]


def test_the_value_network_learns_from_reward_meanwhile(trainer) -> None:
    ppo = trainer(ppo={"critic_learning_rate": 3e-3})
    batch = batch_of(ppo)
    rows = [ppo.update(batch, 0.0, IMITATING) for _ in range(12)]
    assert rows[-1]["value_loss"] < rows[0]["value_loss"]
    assert rows[-1]["explained_variance"] > rows[0]["explained_variance"]


def test_old_states_are_trained_on_again(trainer) -> None:
    """What came first is imitated as well as what came last."""
    ppo = trainer(imitation={"passes": 8.0})
    first, last = batch_of(ppo, liked=3), batch_of(ppo, liked=3)
    last.observation.goal[:, 0] += 20.0
    ppo.update(first, 0.0, IMITATING)
    halfway = divergence(ppo, first)
    for _ in range(6):
        ppo.update(last, 0.0, IMITATING)
    assert divergence(ppo, first) < halfway
    assert ppo.lessons is not None and len(ppo.lessons) == 7 * len(first)


def test_as_many_states_as_passes_say(trainer) -> None:
    ppo = trainer(imitation={"passes": 2.5}, ppo={"minibatch_size": 16})
    batch = batch_of(ppo)
    steps = []
    plain = ppo._actor.apply

    def counted(norm: torch.Tensor) -> None:
        steps.append(1)
        plain(norm)

    ppo._actor.apply = counted
    ppo.update(batch, 0.0, IMITATING)
    assert len(steps) == 2.5 * len(batch) / 16


def test_a_weight_holds_ppo_to_the_teacher(trainer) -> None:
    """Rewards are noise: what moves the policy to the teacher is the divergence alone."""
    distances = []
    for weight in (0.0, 5.0):
        ppo = trainer(ppo={"actor_learning_rate": 3e-3, "epochs": 4})
        batch = batch_of(ppo, liked=7)
        for _ in range(8):
            figures = ppo.update(batch, 0.0, Stage(GUIDED, temperature=0.5, kl=weight))
        distances.append(divergence(ppo, batch))
        assert figures["teacher_kl"] == pytest.approx(distances[-1], rel=0.5)
    assert distances[1] < 0.3 * distances[0]


def test_without_weight_it_is_plain_ppo(trainer) -> None:
    """Bit for bit what a run without a teacher does."""
    taught = trainer()
    plain = PPO(small_config(ppo={"entropy": 0.0}))
    try:
        batch = batch_of(taught)
        one = taught.update(batch, 0.3, Stage(REINFORCEMENT, temperature=0.1))
        two = plain.update(replace(batch, teacher=None, taught=None), 0.3)
        assert {name: one[name] for name in two} == two
        for name, tensor in plain.policy.state_dict().items():
            assert torch.equal(tensor, taught.policy.state_dict()[name]), name
    finally:
        plain.close()


@pytest.mark.parametrize("dense", [False, True])
def test_states_without_a_label_hold_nothing(trainer, dense: bool) -> None:
    ppo = trainer(dense)
    figures = ppo.update(batch_of(ppo, taught=False), 0.0, Stage(GUIDED, 0.5, kl=1e6))
    assert figures["teacher_kl"] == 0.0 and figures["teacher_agreement"] == 0.0
    assert figures["gradient_norm_policy"] < 1e3


@pytest.mark.parametrize("joint", [False, True])
@pytest.mark.parametrize("dense", [False, True])
def test_imitation_without_any_label_trains_the_value_network_alone(
    trainer, dense: bool, joint: bool
) -> None:
    """As after a step back in a run whose actors were beyond imitation: it must not end there."""
    ppo = trainer(dense, ppo={"joint_gradient_norm": joint})
    before = [{k: v.clone() for k, v in n.state_dict().items()} for n in (ppo.policy, ppo.value)]
    figures = ppo.update(batch_of(ppo, taught=False), 0.0, IMITATING)
    changed = [
        any(not torch.equal(v, old[k]) for k, v in n.state_dict().items())
        for n, old in zip((ppo.policy, ppo.value), before, strict=True)
    ]
    assert changed == [False, True]
    assert "teacher_kl" not in figures and np.isfinite(list(figures.values())).all()
    assert "teacher_kl" in ppo.update(batch_of(ppo), 0.0, IMITATING)


def test_the_memory_ends_with_imitation(trainer) -> None:
    ppo = trainer()
    batch = batch_of(ppo)
    ppo.update(batch, 0.0, IMITATING)
    assert ppo.lessons is not None and len(ppo.lessons)
    ppo.update(batch, 0.0, Stage(GUIDED, 0.5, kl=1.0))
    assert len(ppo.lessons) == 0


def test_dense_and_sparse_imitate_alike(trainer) -> None:
    updates = []
    for dense in (False, True):
        ppo = trainer(dense)
        ppo.update(batch_of(ppo, liked=2), 0.0, IMITATING)
        updates.append(ppo.policy.state_dict())
    for name, tensor in updates[0].items():
        torch.testing.assert_close(tensor, updates[1][name], rtol=2e-3, atol=2e-4, msg=name)
