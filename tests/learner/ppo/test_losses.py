"""The losses by hand and by their gradients."""

from __future__ import annotations

import math

import pytest
import torch

from learner.ppo.losses import (
    WORST,
    expected_regret,
    explained_variance,
    policy_loss,
    teacher_divergence,
    value_loss,
)


def loss_of(ratio: float, advantage: float, importance: float = 1.0, **settings: object):
    """A single sample of action 0 of two, with the wanted probability ratio."""
    proximal = 0.3
    probability = proximal * ratio
    logits = torch.tensor([[math.log(probability), math.log(1 - probability)]], requires_grad=True)
    options = {"clip": 0.2, "dual_clip": None, "entropy_weight": 0.0, "max_importance": 10.0}
    loss = policy_loss(
        logits,
        torch.tensor([0]),
        torch.tensor([math.log(proximal / importance)]),
        torch.tensor([math.log(proximal)]),
        torch.tensor([advantage]),
        **(options | settings),  # type: ignore[arg-type]
    )
    loss.total.backward()
    return loss, logits.grad


@pytest.mark.parametrize(
    ("ratio", "advantage", "expected"),
    [(1.0, 2.0, -2.0), (1.5, 1.0, -1.2), (0.5, 1.0, -0.5), (1.5, -1.0, 1.5), (0.5, -1.0, 0.8)],
)
def test_clipped_surrogate(ratio: float, advantage: float, expected: float) -> None:
    assert loss_of(ratio, advantage)[0].policy.item() == pytest.approx(expected, rel=1e-5)


def test_gradient_raises_good_actions_and_stops_at_the_clip() -> None:
    assert loss_of(1.0, 1.0)[1][0, 0] < 0  # descent raises the logit
    assert loss_of(1.0, -1.0)[1][0, 0] > 0
    assert torch.all(loss_of(1.5, 1.0)[1] == 0)


def test_dual_clip_bounds_what_bad_actions_cost() -> None:
    assert loss_of(3.2, -1.0, dual_clip=3.0)[0].policy.item() == pytest.approx(3.0, rel=1e-5)
    assert loss_of(3.2, -1.0)[0].policy.item() == pytest.approx(3.2, rel=1e-5)
    assert loss_of(3.2, 1.0, dual_clip=3.0)[0].policy.item() == pytest.approx(-1.2, rel=1e-5)


def test_behaviour_correction_weights_and_is_capped() -> None:
    assert loss_of(1.0, 1.0, importance=2.0)[0].policy.item() == pytest.approx(-2.0, rel=1e-5)
    capped = loss_of(1.0, 1.0, importance=3.0, max_importance=1.5)[0]
    assert capped.policy.item() == pytest.approx(-1.5, rel=1e-5)
    assert capped.importance_max.item() == pytest.approx(3.0, rel=1e-5)


def test_entropy_is_rewarded_and_measured_in_nats() -> None:
    loss, _ = loss_of(1.0, 0.0, entropy_weight=0.5)
    expected = -(0.3 * math.log(0.3) + 0.7 * math.log(0.7))
    assert loss.entropy.item() == pytest.approx(expected, rel=1e-5)
    assert loss.total.item() == pytest.approx(-0.5 * expected, rel=1e-5)


def test_kl_is_zero_at_the_proximal_policy_and_positive_elsewhere() -> None:
    assert loss_of(1.0, 1.0)[0].kl.item() == pytest.approx(0.0, abs=1e-6)
    assert loss_of(1.3, 1.0)[0].kl.item() > 0
    assert loss_of(1.3, 1.0)[0].clip_fraction.item() == 1.0


def test_value_loss_and_explained_variance() -> None:
    value, target = torch.tensor([1.0, 3.0]), torch.tensor([0.0, 0.0])
    assert value_loss(value, target, 0.5).item() == pytest.approx(2.5)
    spread = torch.tensor([0.0, 1.0, 2.0])
    assert explained_variance(spread, spread) == pytest.approx(1.0)
    assert explained_variance(torch.zeros(3), spread) == pytest.approx(0.0)
    assert explained_variance(spread, torch.ones(3)) == 0.0


def test_divergence_from_a_teacher_by_hand() -> None:
    cost = torch.tensor([[0.0, 0.4 * math.log(3.0)], [0.0, 0.0]])
    logits = torch.log(torch.tensor([[0.5, 0.5], [0.25, 0.75]]))
    divergence, agrees = teacher_divergence(logits, cost, 0.4)
    expected = [
        0.75 * math.log(1.5) + 0.25 * math.log(0.5),
        0.5 * math.log(2.0) + 0.5 * math.log(2.0 / 3.0),
    ]
    assert divergence.tolist() == pytest.approx(expected, rel=1e-5)
    assert agrees.tolist() == [1.0, 1.0]  # where two are cheapest, either will do


def test_divergence_vanishes_where_the_policy_is_the_teacher() -> None:
    cost = torch.tensor([[0.0, 1.0, 60_000.0]], dtype=torch.float16)
    logits = (-cost.float() / 0.1).requires_grad_()
    divergence, agrees = teacher_divergence(logits, cost, 0.1)
    divergence.sum().backward()
    assert divergence.item() == pytest.approx(0.0, abs=1e-6) and agrees.item() == 1.0
    assert logits.grad is not None and logits.grad.abs().max() < 1e-6


def test_descent_on_the_divergence_raises_what_the_teacher_likes() -> None:
    logits = torch.zeros(1, 3, requires_grad=True)
    divergence, agrees = teacher_divergence(logits, torch.tensor([[2.0, 0.0, 2.0]]), 0.5)
    divergence.sum().backward()
    assert logits.grad is not None
    assert logits.grad[0, 1] < 0 < logits.grad[0, 0]
    assert agrees.item() == 0.0  # of equal logits the first is taken


def test_regret_is_what_wrong_actions_cost_and_bounded() -> None:
    logits = torch.log(torch.tensor([[0.5, 0.25, 0.25]]))
    cost = torch.tensor([[0.0, 2.0, 700.0]], dtype=torch.float16)
    assert float(expected_regret(logits, cost)) == pytest.approx(0.25 * 2.0 + 0.25 * WORST)
    sure = torch.tensor([[20.0, 0.0, 0.0]])
    assert float(expected_regret(sure, cost)) < 1e-6


def test_regret_pushes_down_what_costs_most() -> None:
    logits = torch.zeros(1, 3, requires_grad=True)
    expected_regret(logits, torch.tensor([[0.0, 0.5, 8.0]])).sum().backward()
    assert logits.grad is not None
    cheapest, dearer, touching = (-logits.grad[0]).tolist()
    assert cheapest > dearer > 0.0 > touching
