"""The PPO losses as pure functions of tensors.

Sources: Schulman et al. 2017 (clip); Ye et al. 2020 (dual clip); Hilton et al. 2021, "Batch size
invariance for policy optimization" (decoupled objective: the behaviour policy corrects for where
the data came from, the proximal policy is what the step stays close to).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

WORST = 10.0
"""Cost beyond which an action is simply wrong: a metre of the way, in the planners' units."""


@dataclass(frozen=True)
class PolicyLoss:
    """Scalars of one minibatch; ``total`` carries the gradient."""

    total: Tensor
    policy: Tensor
    entropy: Tensor
    kl: Tensor
    clip_fraction: Tensor
    importance_max: Tensor


def policy_loss(
    logits: Tensor,
    action: Tensor,
    behaviour_log_prob: Tensor,
    proximal_log_prob: Tensor,
    advantage: Tensor,
    clip: float,
    dual_clip: float | None,
    entropy_weight: float | Tensor,
    max_importance: float,
) -> PolicyLoss:
    """Clipped surrogate around the proximal policy, weighted back to the behaviour policy.

    ``logits`` (N, actions), all others (N,). ``kl`` estimates KL(proximal || current) by
    ``(r - 1) - log r``.
    """
    log_probabilities = torch.log_softmax(logits, dim=1)
    log_prob = log_probabilities.gather(1, action.unsqueeze(1)).squeeze(1)
    log_ratio = log_prob - proximal_log_prob
    ratio = log_ratio.exp()
    surrogate = torch.minimum(ratio * advantage, ratio.clamp(1.0 - clip, 1.0 + clip) * advantage)
    if dual_clip is not None:
        floor = dual_clip * advantage
        surrogate = torch.where(advantage < 0, torch.maximum(surrogate, floor), surrogate)
    importance = (proximal_log_prob - behaviour_log_prob).exp()
    policy = -(importance.clamp(max=max_importance) * surrogate).mean()
    entropy = -(log_probabilities.exp() * log_probabilities).sum(1).mean()
    with torch.no_grad():
        kl = ((ratio - 1.0) - log_ratio).mean()
        clip_fraction = ((ratio - 1.0).abs() > clip).float().mean()
    return PolicyLoss(
        total=policy - entropy_weight * entropy,
        policy=policy.detach(),
        entropy=entropy.detach(),
        kl=kl,
        clip_fraction=clip_fraction,
        importance_max=importance.max(),
    )


def teacher_divergence(
    logits: Tensor, cost: Tensor, temperature: Tensor | float
) -> tuple[Tensor, Tensor]:
    """KL(teacher || policy) and whether both like the same action best, both (N,).

    ``logits`` (N, actions); ``cost`` (N, actions) of every action above the cheapest, which make
    the teacher's probabilities by a softmax at ``temperature``.
    """
    cost = cost.float()
    target = torch.log_softmax(-cost / temperature, dim=1)
    divergence = (target.exp() * (target - torch.log_softmax(logits, dim=1))).sum(1)
    with torch.no_grad():
        chosen = logits.argmax(1, keepdim=True)
        agrees = (cost.gather(1, chosen).squeeze(1) <= cost.amin(1)).float()
    return divergence, agrees


def expected_regret(logits: Tensor, cost: Tensor) -> Tensor:
    """What the policy's actions cost above the cheapest on average, each at most WORST; (N,).

    ``logits`` and ``cost`` (N, actions), the latter above the cheapest. A divergence minds how
    likely a wrong action is, this how wrong it is (Ross and Bagnell 2014, "Reinforcement and
    imitation learning via interactive no-regret learning").
    """
    return (torch.softmax(logits, dim=1) * cost.float().clamp(max=WORST)).sum(1)


def dangerous_share(logits: Tensor, cost: Tensor, danger: float) -> Tensor:
    """Chance that the policy takes an action of ``danger`` or more; (N,).

    ``logits`` and ``cost`` (N, actions), the latter above the teacher's cheapest. It says nothing
    of how to choose among the others, as a divergence from the teacher would.
    """
    return (torch.softmax(logits, dim=1) * (cost.float() >= danger)).sum(1)


def value_loss(value: Tensor, target: Tensor, weight: float) -> Tensor:
    """``weight`` times the mean squared error; both (N,)."""
    return weight * (value - target).square().mean()


def explained_variance(value: Tensor, target: Tensor) -> float:
    """1 - Var(target - value) / Var(target); 0 when the targets do not vary."""
    variance = target.var(unbiased=False)
    if variance <= 1e-12:
        return 0.0
    return float(1.0 - (target - value).var(unbiased=False) / variance)
