"""One PPO update: both networks trained side by side on one batch.

Policy and value network share nothing, so each is trained in its own thread: two matrix
products at a time keep two cores busier than one product that is split over both.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from learner.batch import Batch, batch_advantages
from learner.losses import explained_variance, policy_loss, value_loss
from lndrl.config import RunConfig
from lndrl.navigation import Observation
from lndrl.policy import Inputs, NavigationNetwork, build_policy, build_value, prepare

_FORWARD_ROWS = 256  # rows per pass without gradients: fits the caches, bounds the memory

R = TypeVar("R")
S = TypeVar("S")


class DivergedError(RuntimeError):
    """A loss or gradient was not finite; the networks may be spoilt."""


class PPO:
    """Networks, optimizers and the update rule.

    Attributes:
        policy, value: the two networks.
        policy_optimizer, value_optimizer: Adam, one each.
        rng: order of the minibatches; part of a checkpoint.
    """

    def __init__(self, config: RunConfig, device: str = "cpu") -> None:
        self.config = config
        self.device = device
        torch.manual_seed(config.seed)
        self.policy = build_policy(config).to(device)
        self.value = build_value(config).to(device)
        self.policy_optimizer = self._adam(self.policy, config.ppo.actor_learning_rate)
        self.value_optimizer = self._adam(self.value, config.ppo.critic_learning_rate)
        self.rng = np.random.default_rng([config.seed, 0x9E3779B9])
        cores = config.learner.threads or os.cpu_count() or 1
        self.threads = max(1, cores // 2)
        self._pool = ThreadPoolExecutor(2, "network", initializer=self._limit_threads)

    def close(self) -> None:
        """End the threads."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def update(self, batch: Batch, progress: float) -> dict[str, float]:
        """Train on ``batch``; ``progress`` in [0, 1] drives the learning-rate schedule.

        Returns the figures of the update by name. Raises DivergedError.
        """
        ppo = self.config.ppo
        scale = 1.0 - progress if ppo.learning_rate_schedule == "linear" else 1.0
        self._set_learning_rates(scale)
        proximal, values = self._together(
            lambda: self._proximal_log_prob(batch), lambda: self._values(batch)
        )
        value, final_value = values[: len(batch)], values[len(batch) :]
        advantage, target = batch_advantages(batch, value, final_value, ppo)
        variance = explained_variance(torch.from_numpy(value), torch.from_numpy(target))
        if ppo.normalize_advantages:
            advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
        figures = self.train(batch, proximal, advantage, target)
        figures["explained_variance"] = variance
        figures["learning_rate"] = scale * ppo.actor_learning_rate
        return figures

    def train(
        self,
        batch: Batch,
        proximal: NDArray[np.float32],
        advantage: NDArray[np.float32],
        target: NDArray[np.float32],
    ) -> dict[str, float]:
        """All epochs over ``batch``: proximal log-probabilities, advantages, targets are (N,).

        Returns the means of the figures over the gradient steps. Raises DivergedError.
        """
        orders = [self.rng.permutation(len(batch)) for _ in range(self.config.ppo.epochs)]
        if self.config.ppo.joint_gradient_norm:
            return self._train_jointly(batch, proximal, advantage, target, orders)
        first, second = self._together(
            lambda: self._train_policy(batch, proximal, advantage, orders),
            lambda: self._train_value(batch, target, orders),
        )
        return first | second

    # -- the two networks' work, each in its thread ------------------------------------------

    def _train_policy(
        self,
        batch: Batch,
        proximal: NDArray[np.float32],
        advantage: NDArray[np.float32],
        orders: list[NDArray[np.int64]],
    ) -> dict[str, float]:
        figures = _Means()
        for order in orders:
            kl = _Means()
            for rows in self._minibatches(order):
                self.policy_optimizer.zero_grad(set_to_none=False)
                loss, numbers = self._policy_backward(batch, proximal, advantage, rows)
                norm = self._clip([self.policy], loss)
                self.policy_optimizer.step()
                figures.add(numbers | {"gradient_norm_policy": norm})
                kl.add({"kl": numbers["kl"]})
            if self.config.ppo.target_kl and kl.mean()["kl"] > self.config.ppo.target_kl:
                break
        return figures.mean()

    def _train_value(
        self, batch: Batch, target: NDArray[np.float32], orders: list[NDArray[np.int64]]
    ) -> dict[str, float]:
        figures = _Means()
        for order in orders:
            for rows in self._minibatches(order):
                self.value_optimizer.zero_grad(set_to_none=False)
                loss = self._value_backward(batch, target, rows)
                norm = self._clip([self.value], loss)
                self.value_optimizer.step()
                figures.add({"value_loss": loss, "gradient_norm_value": norm})
        return figures.mean()

    def _train_jointly(
        self,
        batch: Batch,
        proximal: NDArray[np.float32],
        advantage: NDArray[np.float32],
        target: NDArray[np.float32],
        orders: list[NDArray[np.int64]],
    ) -> dict[str, float]:
        """As published by the group: one gradient norm over both networks."""
        figures = _Means()
        for order in orders:
            for rows in self._minibatches(order):
                self.policy_optimizer.zero_grad(set_to_none=False)
                self.value_optimizer.zero_grad(set_to_none=False)
                (loss, numbers), value = self._together(
                    partial(self._policy_backward, batch, proximal, advantage, rows),
                    partial(self._value_backward, batch, target, rows),
                )
                norm = self._clip([self.policy, self.value], loss + value)
                self._together(self.policy_optimizer.step, self.value_optimizer.step)
                figures.add(
                    numbers
                    | {"value_loss": value, "gradient_norm_policy": norm}
                    | {"gradient_norm_value": norm}
                )
            if self.config.ppo.target_kl and figures.mean()["kl"] > self.config.ppo.target_kl:
                break
        return figures.mean()

    def _policy_backward(
        self,
        batch: Batch,
        proximal: NDArray[np.float32],
        advantage: NDArray[np.float32],
        rows: NDArray[np.int64],
    ) -> tuple[float, dict[str, float]]:
        """Accumulate the policy's gradient over ``rows``; its loss and figures."""
        ppo = self.config.ppo
        figures = _Means()
        total = 0.0
        for part in _parts(rows):
            share = len(part) / len(rows)
            loss = policy_loss(
                self.policy(self._inputs(batch.observation.take(part))),
                self._tensor(batch.action[part]),
                self._tensor(batch.log_prob[part]),
                self._tensor(proximal[part]),
                self._tensor(advantage[part]),
                ppo.clip,
                ppo.dual_clip,
                ppo.entropy,
                ppo.max_importance,
            )
            (loss.total * share).backward()
            total += float(loss.total.detach()) * share
            numbers = {
                "policy_loss": float(loss.policy),
                "entropy": float(loss.entropy),
                "kl": float(loss.kl),
                "clip_fraction": float(loss.clip_fraction),
                "importance_max": float(loss.importance_max),
            }
            figures.add(numbers, share)
        return total, figures.mean()

    def _value_backward(
        self, batch: Batch, target: NDArray[np.float32], rows: NDArray[np.int64]
    ) -> float:
        total = 0.0
        for part in _parts(rows):
            value = self.value(self._inputs(batch.observation.take(part))).squeeze(1)
            loss = value_loss(value, self._tensor(target[part]), self.config.ppo.value_loss)
            share = len(part) / len(rows)
            (loss * share).backward()
            total += float(loss.detach()) * share
        return total

    def _proximal_log_prob(self, batch: Batch) -> NDArray[np.float32]:
        logits = self._forward(self.policy, batch.observation)
        log_probabilities = torch.log_softmax(logits, dim=1)
        action = torch.from_numpy(batch.action).unsqueeze(1)
        return log_probabilities.gather(1, action).squeeze(1).numpy()

    def _values(self, batch: Batch) -> NDArray[np.float32]:
        observation = Observation.concatenate([batch.observation, batch.final_observation])
        return self._forward(self.value, observation).squeeze(1).numpy()

    # -- small steps -------------------------------------------------------------------------

    def _forward(self, network: NavigationNetwork, observation: Observation) -> Tensor:
        with torch.no_grad():
            parts = [
                network(self._inputs(observation.take(slice(i, i + _FORWARD_ROWS)))).float().cpu()
                for i in range(0, len(observation), _FORWARD_ROWS)
            ]
        return torch.cat(parts)

    def _inputs(self, observation: Observation) -> Inputs:
        return prepare(observation, self.config, self.device)

    def _tensor(self, array: NDArray[np.generic]) -> Tensor:
        return torch.from_numpy(array).to(self.device)

    def _minibatches(self, order: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
        """Equal shares of about ``minibatch_size`` rows; none is tiny."""
        size = self.config.ppo.minibatch_size or len(order)
        yield from np.array_split(order, max(1, round(len(order) / size)))

    def _clip(self, networks: list[NavigationNetwork], loss: float) -> float:
        parameters = [p for network in networks for p in network.parameters()]
        norm = float(torch.nn.utils.clip_grad_norm_(parameters, self.config.ppo.gradient_norm))
        if not (np.isfinite(norm) and np.isfinite(loss)):
            raise DivergedError(f"loss {loss:g} with gradient norm {norm:g}")
        return norm

    def _set_learning_rates(self, scale: float) -> None:
        ppo = self.config.ppo
        for optimizer, rate in (
            (self.policy_optimizer, ppo.actor_learning_rate),
            (self.value_optimizer, ppo.critic_learning_rate),
        ):
            for group in optimizer.param_groups:
                group["lr"] = rate * scale

    def _adam(self, network: NavigationNetwork, rate: float) -> torch.optim.Adam:
        return torch.optim.Adam(
            network.parameters(), lr=rate, eps=self.config.ppo.adam_eps, fused=True
        )

    def _limit_threads(self) -> None:
        # torch's thread count belongs to the calling thread.
        torch.set_num_threads(self.threads)

    def _together(self, first: Callable[[], R], second: Callable[[], S]) -> tuple[R, S]:
        one, other = self._pool.submit(first), self._pool.submit(second)
        return one.result(), other.result()


class _Means:
    """Weighted running means by name."""

    def __init__(self) -> None:
        self._sums: dict[str, float] = {}
        self._weight = 0.0

    def add(self, numbers: dict[str, float], weight: float = 1.0) -> None:
        for name, number in numbers.items():
            self._sums[name] = self._sums.get(name, 0.0) + weight * number
        self._weight += weight

    def mean(self) -> dict[str, float]:
        return {name: total / self._weight for name, total in self._sums.items()}


def _parts(rows: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Pieces of at most 512 rows, so that a full-batch step needs no more memory than that."""
    return np.array_split(rows, -(-len(rows) // 512))
